"""Tables 1 to 3 (Fig. 14-21): the set-ups one by one, and the influence of friction and resolution on half-power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import Campaign, broad
from isorig.analysis.spectra.half_power import half_power
from isorig.analysis.spectra.welch import estimate
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.figures import set_ups_figure
from isorig.rig.wire_bonder.four_set_ups import FourSetUps, SetUp, evaluated_set_ups
from thesis.campaign import BANDS, LOW, NONE, SECONDS, Played, play, take
from thesis.published_values import printed
from thesis.step import Step, judged

PLACES = {
    "heatblock": ("Table 1 (Fig. 14-15)", "table to heatblock"),
    "motor": ("Table 2 (Fig. 16-18)", "head to motor"),
    "table": ("Table 3 (Fig. 19-21)", "head to table"),
}
#: The thesis's half-power reading of the table.
HALF_POWER = 0.067
#: Distances of lines (Hz), where the table's peak is looked for (Hz), and friction forces (N).
RESOLUTIONS = (0.0625, 0.125, 0.25, 0.5, 1.0)
AROUND_TABLE = (8.0, 18.0)
FORCES = (0.0, 1.0, 5.0, 20.0)
#: Friction forces tried with hardly any damping of the motor's own, N.
BARE = (5.0, 8.0)


def read(campaign: Campaign) -> FourSetUps:
    """The thesis's own readings of a campaign."""
    return evaluated_set_ups(campaign, baseline_model(campaign))


def tables(rough: FourSetUps, smooth: FourSetUps) -> Step:
    """What the thesis read off, with friction and without."""
    rows = []
    for item, other in zip(rough.set_ups, smooth.set_ups, strict=True):
        place, path = PLACES[item.name]
        damping = HALF_POWER if item.name == "table" else THESIS[f"{item.name}_damping"]
        for which, seen in (("", item), (", without friction", other)):
            rows += [
                judged(
                    f"{place}, {path}{which}: frequency, Hz", printed(THESIS[f"{item.name}_frequency"], 0.05),
                    _of(seen, "frequency"),
                ),
                judged(
                    f"{place}, {path}{which}: damping", printed(damping, 0.15), _of(seen, "damping"), here=_dampings(seen),
                ),
            ]  # fmt: skip
    text = (
        "Each damping ratio is from the modal fit, with the half-power value in brackets; `rig characterize` computes both for "
        "any recording. The frequencies are peaks of the coupled rig, which differ slightly from √(k/m)/2π of each body alone."
    )
    return Step(
        title="Tables 1 to 3 (Fig. 14-21)", rows=rows, text=[text],
        pictures={"set-ups": set_ups_figure(rough.set_ups), "set-ups-without-friction": set_ups_figure(smooth.set_ups)},
    )  # fmt: skip


def _of(item: SetUp, key: str) -> float:
    return float("nan") if item.mode is None else float(getattr(item.mode, key))


def _dampings(item: SetUp) -> str:
    half = item.half_power.mode
    text = f"{half.damping:.3g}" if half else "refused"
    return f"{item.mode.damping:.3g} ({text})" if item.mode else "none"


def resolutions(campaign: Campaign) -> list[float]:
    """Half-power damping of the table's peak by `RESOLUTIONS`, refused or not."""
    runs = broad(campaign.select(configuration="unlocked", gain=LOW))
    found = []
    for resolution in RESOLUTIONS:
        spectra = estimate(runs, references=["head"], channels=["table"], resolution=resolution)
        half = half_power(spectra.frf("table", "head"), AROUND_TABLE)
        found.append((half.high - half.low) / (2.0 * half.peak))
    return found


@dataclass(frozen=True, kw_only=True)
class Apparent:
    """What the linear readings make of a rig: motor's and table's damping, and (mass, damping, error) of the error surface."""

    motor: float
    table: float
    surface: tuple[float, float, float]


def apparent(share: float, force: float, *, own: float = THESIS["motor_damping"]) -> Apparent:
    """Readings at gain 70 with that friction (N) and that damping ratio of the motor's own."""
    rig = wire_bonder({**THESIS, "friction_force": force, "motor_damping": own})
    takes = [take("unlocked", gain, BANDS[gain], share * SECONDS[gain]) for gain in SECONDS]
    got = read(play(rig, takes))
    by_name = {item.name: item.mode.damping if item.mode else float("nan") for item in got.set_ups}
    best = got.surface.best if got.surface else (float("nan"),) * 3
    return Apparent(motor=by_name["motor"], table=by_name["table"], surface=best)


def half_power_explained(played: Played) -> Step:
    """Where .067 comes from, and which friction goes with the motor's .073."""
    rough, smooth = resolutions(played.measured), resolutions(played.smooth)
    rows = [
        judged(
            f"half-power of the table, resolution {resolution:g} Hz", printed(HALF_POWER, 0.15), a,
            here=f"{a:.3f}; without friction {b:.3f}",
        )
        for resolution, a, b in zip(RESOLUTIONS, rough, smooth, strict=True)
    ]  # fmt: skip
    cells = []
    fits: list[float] = []
    for own, forces in ((THESIS["motor_damping"], FORCES), (NONE, BARE)):
        for force in forces:
            got = apparent(played.share, force, own=own)
            mass, zeta, error = got.surface
            motor = printed(THESIS["motor_damping"], 0.15)
            if own == NONE and motor.verdict(got.motor) == "agrees":
                fits.append(force)
            cells.append(
                (
                    f"{force:g}", f"{own:g}", f"{got.motor:.3f}: {motor.in_words(got.motor)}", f"{got.table:.3f}",
                    f"{mass:.1f} kg, {zeta:.3f}", f"{error:.0%}",
                )
            )  # fmt: skip
    heads = (
        "friction, N",
        "motor's own damping",
        "damping from the motor's peak",
        "from the table's",
        "error surface",
        "its error",
    )
    finite = [value for value in rough if np.isfinite(value)]
    nearest = RESOLUTIONS[int(np.nanargmin(np.abs(np.array(rough) - HALF_POWER)))]
    text = [
        f"**Half-power .067 compared with .015.** For a table with a damping ratio of .015, half-power gives {min(finite):.3f} "
        f"to {max(finite):.3f} with friction, closest to the thesis's value with a resolution of {nearest:g} Hz, and "
        f"{np.nanmin(smooth):.3f} to {np.nanmax(smooth):.3f} without. Three effects add up: the neighbour's damping in the "
        "coupled mode, friction, and the width of the window with a coarse resolution. `rig characterize` refuses half-power, "
        "with a message, if a neighbouring peak is too close or there are too few frequency bins.",
        "**Friction and the motor's damping.** Doubling both drive and friction doubles every motion, so only the ratio of "
        "friction to drive matters, and the damping ratio determined from a peak includes friction. "
        + (
            f"With the drive of this page, {' or '.join(f'{force:g}' for force in fits)} N of friction without any other damping "
            "appear as the thesis's .073: either the thesis's drive was stronger, by the ratio of 20 N to that force, or sliding "
            "friction is below breakaway by that ratio, which is Stribeck's law."
            if fits
            else "None of the tried forces appears as the thesis's .073."
        ),
    ]
    return Step(
        title="Influence of friction and frequency resolution on the damping values",
        rows=rows,
        text=text,
        tables=[(heads, cells)],
    )
