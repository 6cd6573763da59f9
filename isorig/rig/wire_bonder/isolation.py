"""The measured isolation ratio compared with simulated ones, and sentences about them."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isorig.analysis.campaign import Campaign, broad
from isorig.analysis.errors import AnalysisError, DataError
from isorig.analysis.isolation.ratio import (
    ABOVE,
    MOSTLY_STUCK,
    STITCH,
    Isolated,
    IsolationRatio,
    friction_bound,
    isolated_share,
    isolation_frequency,
    isolation_ratio,
    stuck_share,
)
from isorig.analysis.spectra.gain_levels import by_level, changes
from isorig.analysis.spectra.quality import Fault, fault_sentences, faults, without
from isorig.analysis.wording import by_factor, with_std
from isorig.rig.choices import Method
from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.files.output import write_csv, write_json
from isorig.rig.files.rigfile import read_model
from isorig.rig.model.baseline import baseline_model
from isorig.rig.model.prediction import Model, measured_and_simulated
from isorig.rig.wire_bonder.four_set_ups import evaluated_set_ups, rig_of_set_ups
from isorig.rig.wire_bonder.parameters import CALLED, read_rig_values
from isorig.rig.wire_bonder.peak_offset import PeakOffset, peak_offset


@dataclass(frozen=True, kw_only=True)
class ComparedRatios:
    """Ratios by name ("measured", and those of the models), and the share of time stuck by gain.

    `isolated` is the isolation as one number, and `offsets` are the offsets of the heatblock's peaks, by the same names;
    `offset_refused` is the reason why there are none. `faults` are those of the records; faulty runs are left out if others
    remain. `swept` are the runs whose gain changed.
    """

    ratios: dict[str, IsolationRatio]
    stuck: dict[float, float]
    isolated: dict[str, Isolated]
    offsets: dict[str, PeakOffset]
    offset_refused: str
    faults: tuple[Fault, ...]
    swept: tuple[str, ...]

    @property
    def measured(self) -> IsolationRatio:
        """The measured ratio."""
        return self.ratios["measured"]


def given_models(model: Path | None, parameters: Path | None, method: Method | None) -> tuple[list[Model], list[str]]:
    """The models given by a user, and notes about them: that of a model.json, and the wire bonder of a parameters.json.

    The latter is by the joint fit and by half-power, or by one method. Raises PlanError if a file is invalid, or half-power is
    requested and the table does not have it.
    """
    models, notes = [], []
    if model is not None:
        rig, origin, _ = read_model(model)
        models.append(Model(name="simulated", rig=rig, origin=origin))
    if parameters is None and method is not None:
        raise PlanError("--method needs a parameter table; give one with --parameters")
    if parameters is not None:
        for each in CALLED if method is None else (method,):
            try:
                seed = read_rig_values(parameters, each)
            except PlanError as error:
                if method is not None or each == "joint":
                    raise
                notes.append(f"Half-power is not shown: {error}.")
                continue
            models.append(Model(name=CALLED[each], rig=seed.model))
            notes += [sentence for sentence in seed.remarks if sentence not in notes]
    return models, notes


def compared_isolation(
    campaign: Campaign, models: Sequence[Model], *, stitch: float = STITCH, resolution: float = 0.25
) -> ComparedRatios:
    """The ratio of a campaign, and of the same runs simulated with each model; the same estimate for all.

    A run whose gain changed counts as one run for each gain.
    """
    wrong = faults(campaign, reference="head")
    whole = without(campaign, wrong, ("head", "heatblock"))
    campaigns = {name: by_level(each) for name, each in measured_and_simulated(whole, models).items()}
    ratios = {name: isolation_ratio(each, stitch=stitch, resolution=resolution) for name, each in campaigns.items()}
    stuck: dict[float, float] = {}
    if models:
        for piece in ratios["measured"].pieces:
            runs = broad(campaigns["measured"].select(configuration="unlocked", gain=piece.gain))
            stuck[piece.gain] = float(np.mean([stuck_share(models[0].rig, run) for run in runs]))
    isolated: dict[str, Isolated] = {}
    offsets: dict[str, PeakOffset] = {}
    refused = ""
    try:
        guess = baseline_model(whole)
        rig = models[0].rig if models else rig_of_set_ups(evaluated_set_ups(campaigns["measured"], guess), guess)
        # Where the highest gain measured in both configurations ends below, the ratio exists, but not the single number.
        with suppress(DataError):
            above = ABOVE * isolation_frequency(rig)
            isolated = {name: isolated_share(ratio, above) for name, ratio in ratios.items()}
        offsets = {name: peak_offset(each, rig) for name, each in campaigns.items()}
    except (AnalysisError, RecordingError) as error:
        refused = str(error)
    swept = tuple(run.id for run in whole.runs if changes(run))
    return ComparedRatios(
        ratios=ratios, stuck=stuck, isolated=isolated, offsets=offsets, offset_refused=refused, faults=wrong, swept=swept
    )


def isolation_sentences(compared: ComparedRatios) -> list[str]:
    """Sentences about the ratio."""
    ratio = compared.measured
    sentences = fault_sentences(compared.faults)
    if compared.swept:
        sentences.append(
            f"The gain changed within {', '.join(compared.swept)}: each of these runs is split by its streamed gain."
        )
    sentences += [
        f"{name.capitalize()}: from {share.band[0]:.3g} to {share.band[1]:.3g} Hz at gain {share.gain:.3g} the isolation "
        f"{'reduces' if share.share >= 0.0 else 'increases'} the heatblock's vibration by "
        f"{with_std(100.0 * abs(share.share), 100.0 * share.std)} %."
        for name, share in compared.isolated.items()
    ]
    for at, (step, std), above, below in zip(ratio.stitches, ratio.steps, ratio.pieces, ratio.pieces[1:], strict=False):
        if np.isfinite(step):
            sentences.append(
                f"At {at:g} Hz, between gain {above.gain:g} and gain {below.gain:g}, there is a step: the ratio at gain "
                f"{above.gain:g} is {with_std(step, std)} of that at gain {below.gain:g}."
            )
    for gain, share in compared.stuck.items():
        meaning = (
            "; while stuck, the rig behaves like a locked one, which brings the ratio close to 1" if share > MOSTLY_STUCK else ""
        )
        sentences.append(f"At gain {gain:g} the simulated motor is stuck {100 * share:.0f} % of the time{meaning}.")
    for name, peaks in ((name, r.peaks) for name, r in compared.ratios.items()):
        if np.isfinite(peaks.ratio):
            sentences.append(
                f"{name.capitalize()}, the heatblock's largest peak is at {peaks.unlocked:.2f} Hz unlocked and "
                f"{peaks.locked:.2f} Hz locked, and the ratio of the two peaks is "
                f"{with_std(peaks.ratio, peaks.std)}, the ratio at the frequency of the unlocked peak is {peaks.by_line:.3f}."
            )
    for name, offset in compared.offsets.items():
        apart = ", ".join(f"{with_std(p.offset, p.std)} Hz at gain {p.gain:g}" for p in offset.pairs)
        sentences.append(offset.verdict if name == "measured" else f"{name.capitalize()}, unlocked minus locked peak: {apart}.")
    if compared.offset_refused:
        sentences.append(f"The offset of the heatblock's peaks is not available: {compared.offset_refused}.")
    return sentences + [
        text for name, other in compared.ratios.items() if name != "measured" for text in _differences(ratio, other, name)
    ]


def _differences(measured: IsolationRatio, other: IsolationRatio, name: str) -> Iterator[str]:
    by = "as simulated" if name == "simulated" else f"by the {name}" if name == CALLED["joint"] else f"by {name}"
    for low, high in ((0.0, 5.0), (5.0, 9.0), (9.0, 15.0), (15.0, np.inf)):
        kept = (measured.frequency >= low) & (measured.frequency < high)
        if not kept.any():
            continue
        off = float(np.median(np.abs(np.log(other.ratio[kept] / measured.ratio[kept]))))
        top = f"{high:g}" if np.isfinite(high) else f"{measured.frequency[-1]:g}"
        if np.isfinite(off):
            yield (
                f"From {max(low, measured.frequency[0]):g} to {top} Hz the ratio {by} differs from the measured one by "
                f"{by_factor(off)} (median over frequency bins)."
            )


def write_isolation(folder: Path, found: ComparedRatios, notes: Sequence[str]) -> list[str]:
    """Write isolation.csv, isolation.json and isolation.png; the sentences, after the notes about the models."""
    from isorig.rig.frf.figures import save
    from isorig.rig.wire_bonder.figures import isolation_figure

    columns = {"frequency_hz": found.measured.frequency, "gain": found.measured.gain}
    for name, ratio in found.ratios.items():
        plain = name.replace(" ", "_").replace("-", "_")
        columns |= {f"ratio_{plain}": ratio.ratio, f"ratio_{plain}_std": ratio.std}
    if found.stuck:
        columns["friction_bound"] = friction_bound(found.measured, found.stuck).astype(np.float64)
    write_csv(folder / "isolation.csv", columns)
    save(isolation_figure(found.ratios, found.stuck), folder / "isolation.png")
    said = [*notes, *isolation_sentences(found)]
    content = {
        "format": "rig-isolation", "format_version": 1, "stitches_hz": found.measured.stitches,
        "steps": [{"ratio": s, "std": d} for s, d in found.measured.steps],
        "stuck_share": {f"{gain:g}": share for gain, share in found.stuck.items()},
        "isolated": {
            name: {"share": one.share, "std": one.std, "band_hz": list(one.band), "gain": one.gain}
            for name, one in found.isolated.items()
        },
        # Not available (null) if the drive does not excite them.
        "peaks": {
            name: {
                "unlocked_hz": r.peaks.unlocked, "locked_hz": r.peaks.locked, "ratio": r.peaks.ratio, "ratio_std": r.peaks.std,
                "ratio_by_line": r.peaks.by_line,
            }
            for name, r in found.ratios.items()
        },
        "peak_offset": {name: _offset(offset) for name, offset in found.offsets.items()}, "text": said,
    }  # fmt: skip
    write_json(folder / "isolation.json", content)
    return said


def _offset(offset: PeakOffset) -> dict[str, Any]:
    return {
        "gains": [
            {
                "gain": pair.gain, "unlocked_hz": pair.unlocked.frequency, "unlocked_std_hz": pair.unlocked.frequency_std,
                "locked_hz": pair.locked.frequency, "locked_std_hz": pair.locked.frequency_std, "offset_hz": pair.offset,
                "offset_std_hz": pair.std,
            }
            for pair in offset.pairs
        ],
        "mass_loading_hz": offset.mass_loading, "slope_hz_per_gain": offset.slope,
        "slope_std_hz_per_gain": offset.slope_std, "verdict": offset.verdict,
    }  # fmt: skip
