"""The page of a modal analysis: table, animated mode shapes, pictures. It opens without a network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import jinja2
import msgspec

from isorig.analysis.spectra.modal import ModalModel
from isorig.rig.modal.geometry import Geometry

HERE = Path(__file__).parent


def modes_page(
    title: str, found: ModalModel, geometry: Geometry, text: Sequence[str], columns: Sequence[str],
    rows: Sequence[Sequence[str]], pictures: Sequence[tuple[str, Path]],
) -> str:  # fmt: skip
    """The page as HTML; pictures are PNG files that are embedded."""
    modes = [
        {
            "label": f"{k + 1}: {mode.frequency:.5g} Hz, {100.0 * mode.damping:.3g} %",
            "shape": {name: [value.real, value.imag] for name, value in zip(found.responses, mode.shape.tolist(), strict=True)},
        }
        for k, mode in enumerate(found.modes)
    ]
    data = msgspec.json.encode({"geometry": geometry, "modes": modes}).decode()
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.get_template("page.html").render(
        title=title, text=text, columns=columns, rows=rows, geometry=geometry,
        pictures=[(heading, base64.b64encode(path.read_bytes()).decode()) for heading, path in pictures],
        # Within a script element only "<" can end it.
        data=data.replace("<", "\\u003c"), script=(HERE / "page.js").read_text(encoding="utf-8"),
    )  # fmt: skip
