"""Transmissibility of any rig: one channel over another, and its ratio between two configurations, measured and simulated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.errors import DataError
from isorig.analysis.isolation.ratio import magnitude_ratio, rms_ratio
from isorig.analysis.wording import by_factor, displayed_unit, with_std
from isorig.rig.errors import PlanError
from isorig.rig.files.output import write_csv, write_json
from isorig.rig.files.rigfile import rig_of
from isorig.rig.frf.figures import ratio_figure, save
from isorig.rig.frf.transfer import Transfer, transfer_functions
from isorig.rig.model.prediction import Model, measured_and_simulated


@dataclass(frozen=True, kw_only=True)
class Ratio:
    """|response / reference| at a gain, in one configuration or relative to another one, shape (bins,), at frequencies in Hz.

    `name` is "measured" or that of a model; `mean` is the root mean square over the bins, of numerator over denominator.
    """

    name: str
    gain: float
    frequency: FloatArray
    value: FloatArray
    std: FloatArray
    mean: float
    mean_std: float


@dataclass(frozen=True, kw_only=True)
class Transmitted:
    """The ratios, the measured ones first, with what they are of.

    `configurations` are the configuration and the one in the denominator ("" where there is none).
    """

    reference: str
    response: str
    configurations: tuple[str, str]
    unit: str
    ratios: Sequence[Ratio]


def transmissibility(
    campaign: Campaign,
    models: Sequence[Model],
    *,
    reference: str | None,
    response: str | None,
    configurations: tuple[str, str] | None,
    resolution: float,
) -> Transmitted:
    """The magnitude of one channel over another by gain, and between two configurations where both were measured.

    The simulations of the `models` go through the same estimate. By default the channels are the first drive and the last sensor
    of the rig's description, and the configurations, numerator and denominator, the first two that were measured, or the only one
    alone. Raises PlanError if a configuration was not measured, DataError if no gain was measured in both.
    """
    rig = rig_of(campaign)
    usual, drive, _ = rig.usual_ratio
    reference = reference or drive
    response = response or (usual if usual != reference else drive)
    measured = list(dict.fromkeys(run.configuration for run in campaign.runs))
    if configurations is None:
        order = [name for name in rig.configurations if name in measured] or measured
        configurations = (order[0], order[1] if len(order) > 1 else "")
    for name in configurations:
        if name and name not in measured:
            raise PlanError(f"{campaign.source} has no run in the configuration {name!r}; it has {', '.join(measured)}")
    ratios: list[Ratio] = []
    for name, each in measured_and_simulated(campaign, models).items():
        found = transfer_functions(each, reference=reference, responses=[response], resolution=resolution)
        ratios += _ratios(name, found, configurations, campaign.source)
    units = [next(run.channels[name].unit for run in campaign.runs if name in run.channels) for name in (response, reference)]
    of = "1" if configurations[1] or units[0] == units[1] else f"{units[0]} per {units[1]}"
    return Transmitted(reference=reference, response=response, configurations=configurations, unit=of, ratios=ratios)


def _ratios(name: str, found: Sequence[Transfer], configurations: tuple[str, str], source: str) -> list[Ratio]:
    above, below = ({t.gain: t for t in found if t.configuration == each} for each in configurations)
    ratios = []
    for gain, item in above.items():
        upper = item.within_band()
        if configurations[1] and gain not in below:
            continue
        lower = (
            below[gain].within_band()
            if configurations[1]
            else replace(upper, value=np.ones_like(upper.value), magnitude_std=np.zeros_like(upper.magnitude_std))
        )
        frequency, *bins = np.intersect1d(upper.frequency, lower.frequency, return_indices=True)
        upper, lower = (frf.bins(k) for frf, k in zip((upper, lower), bins, strict=True))
        value, std = magnitude_ratio(upper, lower)
        mean, mean_std = rms_ratio(np.abs(upper.value), upper.magnitude_std, np.abs(lower.value), lower.magnitude_std)
        ratios.append(Ratio(name=name, gain=gain, frequency=frequency, value=value, std=std, mean=mean, mean_std=mean_std))
    if not ratios:
        raise DataError(
            f"{source} has no gain with a broad-band drive in both {configurations[0]!r} and {configurations[1]!r}; measure one"
        )
    return ratios


def sentences(found: Transmitted) -> list[str]:
    """The result in words."""
    configuration, relative_to = found.configurations
    compared = f" {configuration}, relative to {relative_to}," if relative_to else ""
    said = [
        f"{r.name.capitalize()}: |{found.response} / {found.reference}|{compared} from {r.frequency[0]:.3g} to "
        f"{r.frequency[-1]:.3g} Hz at gain {r.gain:g} is {with_std(r.mean, r.mean_std)}"
        f"{'' if found.unit == '1' else f' {displayed_unit(found.unit)}'} (rms over frequency)."
        for r in found.ratios
    ]
    measured = {r.gain: r for r in found.ratios if r.name == "measured"}
    for r in found.ratios:
        one = measured[r.gain]
        if r is not one and len(one.value) == len(r.value):
            off = float(np.median(np.abs(np.log(r.value / one.value))))
            if np.isfinite(off):
                said.append(
                    f"At gain {r.gain:g} the {r.name} ratio differs from the measured one by {by_factor(off)} (median over "
                    "frequency bins)."
                )
    return said


def write_transmissibility(folder: Path, found: Transmitted) -> list[str]:
    """Write isolation.csv for each gain, isolation.json and isolation.png; the sentences."""
    said = sentences(found)
    configuration, relative_to = found.configurations
    for r in found.ratios:
        columns = {"frequency_hz": r.frequency, "ratio": r.value, "ratio_std": r.std}
        write_csv(folder / f"isolation-{r.name}-gain{r.gain:g}.csv", columns)
    rows = [
        {
            "name": r.name, "gain": r.gain, "configuration": configuration, "relative_to": relative_to,
            "band_hz": [float(r.frequency[0]), float(r.frequency[-1])], "mean": r.mean, "mean_std": r.mean_std,
        }
        for r in found.ratios
    ]  # fmt: skip
    content = {
        "format": "rig-isolation", "format_version": 1, "reference": found.reference, "response": found.response,
        "unit": found.unit, "ratios": rows, "text": said,
    }  # fmt: skip
    write_json(folder / "isolation.json", content)
    curves = {f"{r.name}, gain {r.gain:g}": (r.frequency, r.value, r.std) for r in found.ratios}
    relative = f", {configuration} relative to {relative_to}" if relative_to else ""
    title = f"|{found.response} / {found.reference}|{relative}"
    save(ratio_figure(curves, title, displayed_unit(found.unit)), folder / "isolation.png")
    return said
