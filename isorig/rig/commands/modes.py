"""Modes with shapes from many transfer functions at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any

from isorig.rig.options import OutputFolder

if TYPE_CHECKING:
    from isorig.analysis.campaign import Run
    from isorig.analysis.spectra.modal_analysis import ModalModel
    from isorig.analysis.spectra.operating import OperatingModes
    from isorig.rig.frf.transfer import Transfer


def modes(
    campaign: Path,
    *,
    band: tuple[float, float],
    output: OutputFolder,
    configuration: str | None = None,
    gain: float | None = None,
    reference: tuple[str, ...] = (),
    response: tuple[str, ...] = (),
    resolution: float = 0.25,
    count: int | None = None,
    operating: bool = False,
) -> None:
    """Find the modes in a band that all transfer functions of one set-up share, with their shapes.

    With --operating only the responses are used: for a machine in operation, whose excitation is not measured. Its modes come
    from the longest run of the set-up by stochastic subspace identification (pip install 'isorig[operating]').

    Example: rig modes campaign.h5 --band 140 190 --configuration locked --gain 7 --reference table -o modes

    Parameters
    ----------
    campaign
        A recording.
    band
        Lowest and highest frequency, Hz.
    output
        The folder for modes.json, modes.csv, and modes.html with the shapes in motion and the stabilization diagram.
    configuration
        The set-up's configuration; by default that of the first set-up that covers the band.
    gain
        The set-up's gain, likewise.
    reference
        The channel that drives, once for each if several drive at the same time; by default those of the rig's description.
    response
        The response channels; by default all others that record the same quantity as the first.
    resolution
        Frequency resolution of the transfer functions, Hz.
    count
        Number of modes to keep, the clearest; by default as many as the errors justify.
    operating
        Whether the excitation is unknown.
    """
    from isorig.analysis.errors import DataError
    from isorig.analysis.spectra.modal_analysis import modal_analysis
    from isorig.rig.files.recording import open_recording
    from isorig.rig.files.rigfile import references_of
    from isorig.rig.frf.transfer import transfer_functions
    from isorig.rig.report.modes import modes_page

    if not 0.0 <= band[0] < band[1]:
        raise DataError(f"the band {band[0]:g} to {band[1]:g} Hz has no width; give the lower frequency first")

    def chosen_set_up(item: Run | Transfer) -> bool:
        return configuration in (None, item.configuration) and (gain is None or isclose(item.gain, gain))

    if operating:
        _operating(campaign, band, output, chosen_set_up, response, resolution, count)
        return
    with open_recording(campaign) as measured:
        found = transfer_functions(
            measured, reference=reference or references_of(measured), responses=response, resolution=resolution
        )
    setups: dict[str, list[Transfer]] = {}
    for item in filter(chosen_set_up, found):
        setups.setdefault(item.label, []).append(item)
    chosen = next((same for same in setups.values() if same[0].band[0] <= band[0] and band[1] <= same[0].band[1]), None)
    if chosen is None:
        has = "; ".join(dict.fromkeys(f"{item.label}: {item.band[0]:g} to {item.band[1]:g} Hz" for item in found))
        raise DataError(
            f"no such set-up of {campaign.name} covers {band[0]:g} to {band[1]:g} Hz ({has}); give another band or set-up"
        )
    # One power of i omega for all: responses of another quantity are left out, unless they were asked for.
    chosen = [item for item in chosen if response or item.units == chosen[0].units]
    model = modal_analysis(chosen, band, count=count)
    content = {
        "format": "rig-modes", "format_version": 1, "campaign": campaign.name, "set_up": chosen[0].label, "band_hz": list(band),
        "responses": list(model.responses), "references": list(model.references), "misfit": model.misfit,
        "warnings": list(model.warnings),
    }  # fmt: skip
    title = f"{campaign.name}, {chosen[0].label}"
    _write(output, content, model, title, modes_page(model, title, chosen[0].units, ()))


def _operating(
    campaign: Path, band: tuple[float, float], output: Path, chosen_set_up: Callable[[Run], bool],
    response: tuple[str, ...], resolution: float, count: int | None,
) -> None:  # fmt: skip
    import numpy as np

    from isorig.analysis.campaign import SI_UNIT
    from isorig.analysis.errors import DataError
    from isorig.analysis.spectra.operating import operating_modes
    from isorig.rig.files.recording import open_recording
    from isorig.rig.files.rigfile import references_of
    from isorig.rig.report.modes import operating_page

    with open_recording(campaign) as measured:
        run = max(filter(chosen_set_up, measured.runs), key=lambda run: len(run) / run.sample_rate, default=None)
        if run is None:
            has = "; ".join(f"{run.id}: {run.configuration}, gain {run.gain:g}" for run in measured.runs)
            raise DataError(f"{campaign.name} has no such run ({has}); give another configuration or gain")
        drives = references_of(measured)
        names = response or [name for name in run.sensors if name not in drives]
        alike = [name for name in names if response or run.channel(name).quantity == run.channel(names[0]).quantity]
        records = np.stack([run.read(name) for name in alike])
        unit = SI_UNIT[run.channel(alike[0]).quantity]
    found = operating_modes(records, run.sample_rate, band, responses=alike, resolution=resolution, count=count)
    content = {
        "format": "rig-operating-modes", "format_version": 1, "campaign": campaign.name, "run": run.id, "band_hz": list(band),
        "responses": list(found.responses), "warnings": list(found.warnings),
    }  # fmt: skip
    title = f"{campaign.name}, run {run.id}"
    _write(output, content, found, f"{title}, in operation", operating_page(found, title, unit, ()))


def _write(output: Path, content: Mapping[str, Any], found: ModalModel | OperatingModes, title: str, page: str) -> None:
    # modes.json, modes.csv and modes.html; the table on the terminal.
    import numpy as np

    from isorig.analysis.wording import sized
    from isorig.rig.files.output import write_csv, write_json, write_text
    from isorig.rig.process.terminal import show_table

    numbers, shapes, shown = [], [], []
    for mode in found.modes:
        numbers.append({
            "frequency_hz": mode.frequency, "frequency_std": mode.frequency_std, "damping": mode.damping,
            "damping_std": mode.damping_std, "collinearity": mode.collinearity,
        })  # fmt: skip
        if hasattr(mode, "variation"):
            numbers[-1]["envelope_variation"] = mode.variation
        parts = dict(zip(found.responses, mode.shape.tolist(), strict=True))
        shapes.append({name: [part.real, part.imag] for name, part in parts.items()})
        frequency = sized(mode.frequency, "Hz", mode.frequency_std).removesuffix(" Hz")
        shape = ", ".join(f"{name} {part.real:+.2f}" for name, part in parts.items())
        shown.append((frequency, sized(mode.damping, "1", mode.damping_std), shape))
    rows = [{**values, "shape": shape} for values, shape in zip(numbers, shapes, strict=True)]
    write_json(output / "modes.json", {**content, "modes": rows})
    write_csv(output / "modes.csv", {key: np.array([row[key] for row in numbers]) for key in numbers[0]})
    write_text(output / "modes.html", page)
    show_table(title, ("Hz", "damping ratio", "shape"), shown)
    print(*found.warnings, output / "modes.html", sep="\n")
