"""Tables 1 to 3 (Fig. 14-21): the set-ups read one by one, and what friction and resolution do to half-power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.classic import Classic, SetUp, classic
from analysis.half_power import half_power
from analysis.isolation import broad
from analysis.measured import Campaign
from analysis.rigs import THESIS, wire_bonder
from analysis.spectra import estimate
from rig.baseline import baseline_model
from rig.figures import set_ups_figure
from rig.thesis.campaign import BANDS, LOW, SECONDS, Played, play, take
from rig.thesis.step import Row, Step

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
#: Hardly any damping of the motor's own, and the friction forces tried with it, N.
NONE, BARE = 0.001, (5.0, 8.0)


def read(campaign: Campaign) -> Classic:
    """The thesis's own readings of a campaign."""
    return classic(campaign, baseline_model(campaign))


def tables(rough: Classic, smooth: Classic) -> Step:
    """What the thesis read off, with friction and without."""
    rows = []
    for item, other in zip(rough.set_ups, smooth.set_ups, strict=True):
        place, path = PLACES[item.name]
        damping = HALF_POWER if item.name == "table" else THESIS[f"{item.name}_damping"]
        remark = {
            "heatblock": "agrees: its only neighbour is far off, and friction does not reach it",
            "motor": "without friction near what was put in (the peak of the coupled rig lies lower than √(k/m)); 20 N at "
            "this drive "
            "read as a tenfold damping, so the thesis's 20 N and .073 cannot both hold at this drive, see below",
            "table": "agrees in kind: four times what was put in, by friction and by lines too far apart, see below",
        }[item.name]
        rows.append(
            Row(
                what=f"{place}, {path}", thesis=f"{THESIS[f'{item.name}_frequency']:g} Hz, {damping:g}",
                here=f"{_pair(item)}; without friction {_pair(other)}", remark=remark,
            )
        )  # fmt: skip
    text = "Each reading is the fit of the mode, and half-power in brackets; `rig characterize` makes it of any recording."
    return Step(
        title="Tables 1 to 3", rows=rows, text=[text],
        pictures={"set-ups": set_ups_figure(rough.set_ups), "set-ups-without-friction": set_ups_figure(smooth.set_ups)},
    )  # fmt: skip


def _pair(item: SetUp) -> str:
    half = item.half_power.mode
    told = f"{half.damping:.3g}" if half else "none"
    return f"{item.mode.frequency:.2f} Hz, {item.mode.damping:.3g} ({told})" if item.mode else "none"


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
        Row(
            what=f"half-power of the table, lines {resolution:g} Hz apart",
            thesis=f"{HALF_POWER} (its lines are not given)", here=f"{a:.3f}; without friction {b:.3f}",
            remark=f"{abs(a / HALF_POWER - 1.0):.0%} off the thesis's",
        )
        for resolution, a, b in zip(RESOLUTIONS, rough, smooth, strict=True)
    ]  # fmt: skip
    for own, forces in ((THESIS["motor_damping"], FORCES), (NONE, BARE)):
        for force in forces:
            got = apparent(played.share, force, own=own)
            mass, zeta, error = got.surface
            rows.append(
                Row(
                    what=f"{force:g} N of friction, motor's own damping {own:g}: damping read off motor and table; error surface",
                    thesis="20 N, 0.073 and 0.067; 80 kg, 0.015",
                    here=f"{got.motor:.3f} and {got.table:.3f}; {mass:.1f} kg, {zeta:.3f}",
                    remark=f"the surface's least error is {error:.0%}",
                )
            )  # fmt: skip
    nearest = RESOLUTIONS[int(np.argmin(np.abs(np.array(rough) - HALF_POWER)))]
    text = [
        f"**Half-power .067 against .015.** A table of .015 read by half-power beside 20 N of friction gives {rough[0]:.3f} to "
        f"{rough[-1]:.3f}, nearest to the thesis's with lines {nearest:g} Hz apart; without friction {smooth[0]:.3f} with "
        "the finest "
        f"lines and {smooth[-1]:.3f} with the widest. So three things add up: the neighbour's damping in the coupled mode, "
        "friction, "
        "and the window's width where lines are far apart. None of them is the table's own damping. `rig characterize` refuses "
        "half-power where a neighbour is too near or lines are too few, and says so.",
        "**Friction and the motor's damping.** Doubling the drive and the friction doubles every motion, so only friction per "
        "drive matters, and reading a damping off a peak counts friction in. The gauge's 20 N and a reading of .073 do not go "
        "together at the drive assumed here (3.8 m/s² rms of the head at gain 70): about 8 N without any other damping read as "
        ".073, and then the error surface lies near the thesis's 80 kg. Either the thesis's drive was some 2.5 times harder, or "
        "sliding friction was that much below breakaway, which is what Stribeck's law says; see further below.",
    ]
    return Step(title="What friction and resolution do to the readings", rows=rows, text=text)
