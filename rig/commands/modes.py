"""rig modes: natural frequencies, damping ratios and mode shapes of all sensors together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from isorig.analysis.spectra.modal import ModalModel
    from isorig.rig.modal.geometry import Geometry
    from isorig.rig.modal.source import Source

COLUMNS = ("mode", "frequency, Hz", "std", "damping, %", "std, %", "MPC", "bins in bandwidth")


def modes(
    file: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    reference: tuple[str, ...] = (),
    response: tuple[str, ...] = (),
    band: tuple[float, float] | None = None,
    count: int | None = None,
    order: int | None = None,
    guess: tuple[tuple[float, float], ...] = (),
    resolution: float = 0.25,
    configuration: str | None = None,
    gain: float | None = None,
    points: Path | None = None,
) -> None:
    """Fit modes with common poles to the transfer functions of all sensors (poly-reference least squares).

    The number of modes is determined from the stabilisation diagram and the errors. Damping is free of the window's bias where
    the transfer functions are estimated here.

    Example: rig modes hammer.h5 --reference hammer --band 5 200 -o modes

    Parameters
    ----------
    file
        A recording (noise, sweep or hammer test), or transfer functions of another program (.mat, .uff, .csv, .npz ...).
    output
        The folder for modes.html with the animated mode shapes, modes.json, modes.csv, shapes.csv, mac.csv and the pictures
        stabilisation.png, fit.png, shapes.png and mac.png.
    reference
        The channel that drives, once for each that drives at the same time. The head if absent, or all references of another
        program's file.
    response
        The channels that answer; all others that measure a motion where absent.
    band
        Lowest and highest frequency of the fit, Hz; the driven band where absent.
    count
        Number of modes to keep; as many as the errors justify where absent.
    order
        Largest model order of the stabilisation diagram.
    guess
        Natural frequency (Hz) and damping ratio of a mode; repeatable. The stabilisation diagram is then not needed.
    resolution
        Frequency resolution of a recording's transfer functions, Hz.
    configuration, gain
        The set-up, if the recording has several.
    points
        A CSV file with the columns channel, x, y, z, direction: where the sensors are. Without it, the bodies of the rig's
        description are drawn, or the sensors in a row.
    """
    from isorig.analysis.errors import DataError
    from isorig.analysis.spectra.modal import modal_analysis
    from isorig.rig.modal.source import transfer_functions_of
    from isorig.rig.terminal import show_table

    source = transfer_functions_of(
        file, references=reference, responses=response, resolution=resolution, configuration=configuration, gain=gain
    )
    fitted = band or source.band
    if not 0.0 <= fitted[0] < fitted[1]:
        raise DataError(f"the band {fitted[0]:g} to {fitted[1]:g} Hz has no width; give the lower frequency first")
    found = modal_analysis(source.frfs, fitted, guesses=guess, count=count, order=order)
    text = [*source.text, *(f"{warning[0].upper()}{warning[1:]}." for warning in found.warnings)]
    driven = source.band
    if fitted[0] < driven[0] - source.frfs[0].resolution or fitted[1] > driven[1] + source.frfs[0].resolution:
        text.append(f"The drive covers only {driven[0]:.4g} to {driven[1]:.4g} Hz; modes outside are not reliable.")
    geometry = _geometry(found, source, points)
    rows = [
        (
            str(k + 1), f"{mode.frequency:.5g}", f"{mode.frequency_std:.2g}", f"{100.0 * mode.damping:.4g}",
            f"{100.0 * mode.damping_std:.2g}", f"{mode.collinearity:.3f}", f"{mode.lines:.1f}",
        )
        for k, mode in enumerate(found.modes)
    ]  # fmt: skip
    _write(output, file.name, found, geometry, text, rows)
    where = f", {source.set_up}" if source.set_up else ""
    show_table(f"{file.name}{where}: {len(rows)} modes from {fitted[0]:g} to {fitted[1]:g} Hz", COLUMNS, rows)
    for sentence in text:
        print(sentence)
    print(output / "modes.html")


def _geometry(found: ModalModel, source: Source, points: Path | None) -> Geometry:
    from isorig.rig.modal.geometry import of_description, of_file, of_row

    if points is not None:
        return of_file(points, found.responses)
    drawn = None if source.rig is None else of_description(source.rig, found.responses)
    return drawn or of_row(found.responses)


def _write(
    output: Path, name: str, found: ModalModel, geometry: Geometry, text: list[str], rows: Sequence[Sequence[str]]
) -> None:
    import numpy as np

    from isorig.rig.figures import save
    from isorig.rig.files.output import write_csv, write_json, write_text
    from isorig.rig.modal.figures import auto_mac, fit_figure, mac_figure, shapes_figure, stabilisation_figure
    from isorig.rig.modal.page import modes_page

    pictures = {"fit": fit_figure(found), "shapes": shapes_figure(found, geometry), "mac": mac_figure(found)}
    headings = {
        "stabilisation": "Stabilisation diagram",
        "mac": "MAC of the mode shapes",
        "fit": "Fit",
        "shapes": "All mode shapes",
    }
    if found.poles:
        functions = found.measured.reshape(-1, found.measured.shape[-1])
        pictures["stabilisation"] = stabilisation_figure(found, functions)
    for key, figure in pictures.items():
        save(figure, output / f"{key}.png")
    columns = ("frequency", "frequency_std", "damping", "damping_std", "collinearity", "lines")
    write_csv(output / "modes.csv", {key: np.array([getattr(mode, key) for mode in found.modes]) for key in columns})
    similarity = auto_mac(found)
    write_csv(output / "mac.csv", {f"mode_{k + 1}": column for k, column in enumerate(similarity.T)})
    shapes = found.shapes()
    header = ["response", *(f"mode_{k + 1}_{part}" for k in range(len(found.modes)) for part in ("real", "imag"))]
    lines = [
        ",".join([f'"{response}"', *(f"{x:.9g}" for value in row.tolist() for x in (value.real, value.imag))])
        for response, row in zip(found.responses, shapes, strict=True)
    ]
    write_text(output / "shapes.csv", "\n".join([",".join(header), *lines]) + "\n")
    content = {
        "format": "rig-modes", "format_version": 1, "file": name, "responses": list(found.responses),
        "references": list(found.references), "band_hz": [float(found.frequency[0]), float(found.frequency[-1])],
        "misfit": None if np.isnan(found.misfit) else found.misfit, "text": text,
        "modes": [
            {
                "frequency_hz": mode.frequency, "frequency_std_hz": mode.frequency_std, "damping": mode.damping,
                "damping_std": mode.damping_std, "modal_phase_collinearity": mode.collinearity, "bins_in_bandwidth": mode.lines,
                "shape": [[value.real, value.imag] for value in mode.shape.tolist()],
                "participation": [[value.real, value.imag] for value in mode.participation.tolist()],
            }
            for mode in found.modes
        ],
        "mac": similarity.tolist(),
    }  # fmt: skip
    write_json(output / "modes.json", content)
    embedded = [(heading, output / f"{key}.png") for key, heading in headings.items() if key in pictures]
    write_text(output / "modes.html", modes_page(f"Modes of {name}", found, geometry, text, COLUMNS, rows, embedded))
