"""Universal file format: type 58 and its binary form 58b (SDRC universal file, dataset 58, function at nodal DOF)."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from analysis.measured import Spectrum
from rig.errors import RecordingError
from rig.exchange.table import Column, ForeignTable

#: Function types of dataset 58 that are over frequency, and what the recording format calls them.
KINDS = {2: "auto_spectrum", 3: "cross_spectrum", 4: "transfer_function", 6: "coherence"}
TIME_RESPONSE = 1
#: Ordinate data types of dataset 58 with their SI units; files hold SI throughout (dataset 164, units code 1).
UNITS = {8: "m", 11: "m/s", 12: "m/s^2", 13: "N"}
AXES = {0: "", 1: "+x", -1: "-x", 2: "+y", -2: "-y", 3: "+z", -3: "-z"}


def read_uff(path: Path) -> ForeignTable:
    """Time records as columns, functions of frequency as spectra."""
    import pyuff

    try:
        # The package prints what it does.
        with contextlib.redirect_stdout(io.StringIO()):
            file = pyuff.UFF(str(path))
            places = [k for k, kind in enumerate(file.get_set_types()) if int(kind) == 58]
            sets = [file.read_sets(k) for k in places]
    except Exception as error:
        # The package raises bare exceptions for anything that it does not understand.
        told = (str(error).splitlines() or [type(error).__name__])[0]
        raise RecordingError(f"{path} cannot be read as a universal file ({told}); export it again as dataset 58") from None
    columns: dict[str, Column] = {}
    spectra: list[Spectrum] = []
    for item in sets:
        x = np.asarray(item["x"], dtype=np.float64)
        kind = int(item.get("func_type", 0))
        if kind in KINDS:
            spectra.append(_spectrum(item, x, KINDS[kind], spectra))
        elif kind in (0, TIME_RESPONSE) and len(x) > 1:
            name = _unused(_place(item, "rsp"), columns)
            columns[name] = Column(values=np.real(np.asarray(item["data"])), sample_rate=_rate(item, x), unit=_unit(item))
    return ForeignTable(path=path, columns=columns, spectra=tuple(spectra))


def _rate(item: dict[str, Any], x: np.ndarray) -> float | None:
    step = float(item.get("abscissa_inc") or 0.0) or float(x[-1] - x[0]) / (len(x) - 1)
    if not step > 0.0:
        return None
    # The increment has six digits: a whole number of samples a second within its rounding is what was meant.
    whole = round(1.0 / step)
    return float(whole) if abs(1.0 / step - whole) <= 5e-6 * whole else 1.0 / step


def _place(item: dict[str, Any], end: str) -> str:
    name = str(item.get(f"{end}_ent_name", "")).strip()
    if name and name.upper() != "NONE":
        return name
    return f"{int(item.get(f'{end}_node', 0))}{AXES.get(int(item.get(f'{end}_dir', 0)), '')}"


def _unit(item: dict[str, Any]) -> str:
    label = str(item.get("ordinate_axis_units_lab", "")).strip()
    return label if label and label.upper() != "NONE" else UNITS.get(int(item.get("ordinate_spec_data_type", 0)), "")


def _unused(name: str, taken: dict[str, Column]) -> str:
    return name if name not in taken else next(f"{name}#{k}" for k in range(2, len(taken) + 3) if f"{name}#{k}" not in taken)


def _spectrum(item: dict[str, Any], x: np.ndarray, kind: str, before: list[Spectrum]) -> Spectrum:
    values = np.asarray(item["data"])
    return Spectrum(
        name=f"{len(before):03d}", kind=kind, response=_place(item, "rsp"), reference=_place(item, "ref"), frequency=x,
        values=values.astype(np.complex128) if np.iscomplexobj(values) else values.astype(np.float64), unit=_unit(item) or "1",
    )  # fmt: skip
