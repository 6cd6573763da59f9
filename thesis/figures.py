"""Every figure of the thesis that a campaign can be compared with, and the distance of a campaign over all of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray, broad
from isorig.analysis.isolation.ratio import IsolationRatio
from isorig.analysis.model.rig_model import Drive, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.spectra.half_power import peaks
from isorig.analysis.spectra.welch import Frf, estimate
from isorig.rig.model.prediction import predicted
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.four_set_ups import FourSetUps, SetUp
from isorig.rig.wire_bonder.stroke import frictionless, histories
from thesis.campaign import HIGH, LOW, Played
from thesis.figure_readings import HALF_POWER, read, resolutions
from thesis.published_values import Stated, above, below, printed

#: The slow pull of the force gauge: its length, s, its end, N, and the speed from which on the motor has broken away, m/s.
PULL_SECONDS, PULL_RATE, MOST_PULL, MOVING = 2.0, 2048.0, 40.0, 1e-5
#: Lines in which peaks are counted, Hz, and up to where.
COUNTED, COUNTED_TO = 0.25, 20.0
#: The table's actual mass, kg, simulated in Fig. 22 with the damping of Table 3.
ACTUAL = 250.0
#: Bands of Fig. 24 in Hz, and what the thesis says of the simulation there.
COMPARED = {(5.0, 7.0): "too low", (7.0, 10.0): "too low", (10.6, 11.4): "too high", (11.5, 20.0): "too low"}
#: Bands of Fig. 26 and 27 in Hz, and whether simulated and measured ratio agree there.
RATIO_BANDS = {(5.0, 9.0): True, (9.0, 13.0): False, (13.0, 15.0): True}
#: "Around 164.5 Hz": relative.
AROUND_PEAK = 0.015
#: A difference of 5 % is visible in a logarithmic plot.
SEEN = 0.05


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A campaign with its readings: what the figures are taken from."""

    played: Played
    read: FourSetUps
    half_power: tuple[float, ...]

    def mode(self, name: str) -> SetUp:
        """The set-up of that body."""
        return next(item for item in self.read.set_ups if item.name == name)


def seen(played: Played) -> Seen:
    """Read a campaign once for all figures."""
    return Seen(played=played, read=read(played.measured), half_power=tuple(resolutions(played.measured)))


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of the thesis: where it stands, what it is, what is stated, and how a campaign gives it."""

    where: str
    what: str
    stated: Stated
    of: Callable[[Seen], float]


def breakaway(rig: RigModel) -> float:
    """Force at which the motor moves under a slow pull, N: the force gauge."""
    gauge = msgspec.structs.replace(
        rig, drive=Drive(channel="pull", quantity="force", factor=1.0, pushes={"motor": 1.0}), free=(),
        sensors=(Sensor(channel="motor", body="motor", relative_to="table", quantity="velocity"),),
    )  # fmt: skip
    pull = np.linspace(0.0, MOST_PULL, round(PULL_SECONDS * PULL_RATE))
    speed = simulate(gauge, Excitation.prepare(pull, PULL_RATE)).channels["motor"]
    # Without friction the motor follows the pull from the first sample on.
    return float(pull[int(np.flatnonzero(np.abs(speed) > MOVING)[0])])


def response(campaign: Campaign, channel: str, resolution: float = COUNTED) -> Frf:
    """Head to a channel, unlocked at the high gain, up to the end of its drive."""
    runs = broad(campaign.select(configuration="unlocked", gain=LOW))
    return estimate(runs, references=["head"], channels=[channel], resolution=resolution).frf(channel, "head")


def found_peaks(campaign: Campaign, channel: str) -> tuple[float, ...]:
    """Frequencies of the peaks of head to channel that stand out, Hz."""
    return tuple(f for f in peaks(response(campaign, channel)) if f < COUNTED_TO)


def nearest(places: tuple[float, ...], wanted: float) -> float:
    """The place nearest to another; NaN where there is none."""
    return min(places, key=lambda f: abs(f - wanted), default=float("nan"))


def over_measured(seen_: Seen, simulated: Campaign) -> tuple[FloatArray, FloatArray]:
    """Lines in Hz and |table / head| simulated over measured, unlocked at the high gain, each shape (lines,)."""
    measured, other = (response(campaign, "table") for campaign in (seen_.played.measured, simulated))
    kept = (measured.frequency >= 3.0) & (measured.frequency <= COUNTED_TO)
    return measured.frequency[kept], np.abs(other.value[kept]) / np.abs(measured.value[kept])


def heavy_peak(seen_: Seen) -> float:
    """Fig. 22: the table's peak simulated with its actual mass and Table 3's damping, over the measured one."""
    heavy = frictionless(wire_bonder({**THESIS, "table_mass": ACTUAL, "table_damping": HALF_POWER}))
    tops = []
    for campaign in (predicted(heavy, seen_.played.measured), seen_.played.measured):
        found = response(campaign, "table")
        kept = (found.frequency > 8.0) & (found.frequency < 14.0)
        tops.append(float(np.abs(found.value[kept]).max()))
    return tops[0] / tops[1]


def middle(found: IsolationRatio, low: float, high: float) -> float:
    """Median of a ratio in a band, Hz."""
    kept = (found.frequency >= low) & (found.frequency <= high)
    return float(np.median(found.ratio[kept]))


def apart(a: IsolationRatio, b: IsolationRatio, low: float, high: float) -> float:
    """Factor by which two ratios differ in a band, Hz: the median over its lines."""
    kept = (a.frequency >= low) & (a.frequency <= high)
    return float(np.exp(np.median(np.abs(np.log(a.ratio[kept] / b.ratio[kept])))))


def motion(played: Played) -> tuple[FloatArray, FloatArray, float]:
    """Fig. 28: the motor's displacement as measured and as simulated without friction, m, and the sample rate, Hz."""
    run = played.measured.select(configuration="unlocked", gain=LOW)[0]
    head, rate = run.read("head"), run.sample_rate
    measured, simulated = (histories(rig, head, rate)["motor"] for rig in (played.rig, played.smooth_rig))
    return measured, simulated, rate


def figures() -> tuple[Figure, ...]:
    """All of them in the thesis's order."""
    return (
        Figure(
            where="force gauge", what="breakaway of the motor, N", stated=printed(20.0, 0.1),
            of=lambda s: breakaway(s.played.rig),
        ),
        *_set_ups(), *_overlay(), *_ratios(),
        Figure(
            where="Fig. 28", what="motor's displacement, simulated and measured: similarity of shape (correlation)",
            stated=above("right shape", 0.9), of=lambda s: float(np.corrcoef(*motion(s.played)[:2])[0, 1]),
        ),
        Figure(
            where="Fig. 28", what="motor's displacement, simulated over measured: size (rms)",
            stated=above("too large", 1.0 + SEEN), of=_size,
        ),
        *_peaks(),
    )  # fmt: skip


def _size(s: Seen) -> float:
    measured, simulated, _ = motion(s.played)
    return float(simulated.std() / measured.std())


def _set_ups() -> tuple[Figure, ...]:
    found = []
    for name, where, tolerance in (("heatblock", "Fig. 14-15", 0.005), ("motor", "Fig. 16-18", 0.05)):
        found += [
            Figure(
                where=where, what=f"frequency from the {name}'s peak, Hz",
                stated=printed(THESIS[f"{name}_frequency"], tolerance), of=_reading(name, "frequency"),
            ),
            Figure(
                where=where, what=f"damping from the {name}'s peak", stated=printed(THESIS[f"{name}_damping"], 0.15),
                of=_reading(name, "damping"),
            ),
        ]  # fmt: skip
    return (
        *found,
        Figure(
            where="Fig. 18", what="peaks of head to motor below 20 Hz", stated=printed(1.0, 0.01),
            of=lambda s: float(len(found_peaks(s.played.measured, "motor"))),
        ),
        Figure(
            where="Fig. 21", what="peaks of head to table below 20 Hz", stated=printed(2.0, 0.01),
            of=lambda s: float(len(found_peaks(s.played.measured, "table"))),
        ),
        *(
            Figure(
                where="Fig. 21", what=f"the peak of head to table near {place:g} Hz, Hz", stated=printed(place, 0.05),
                of=lambda s, place=place: nearest(found_peaks(s.played.measured, "table"), place),  # type: ignore[misc]
            )
            for place in (5.0, 11.0)
        ),
        Figure(
            where="Table 3", what="half-power damping of the table, closest resolution", stated=printed(HALF_POWER, 0.15),
            of=_nearest_half_power,
        ),
    )  # fmt: skip


def _reading(name: str, key: str) -> Callable[[Seen], float]:
    def of(s: Seen) -> float:
        mode = s.mode(name).mode
        return float("nan") if mode is None else float(getattr(mode, key))

    return of


def _nearest_half_power(s: Seen) -> float:
    finite = [value for value in s.half_power if np.isfinite(value)]
    return min(finite, key=lambda value: abs(np.log(value / HALF_POWER)), default=float("nan"))


def _overlay() -> tuple[Figure, ...]:
    def off(low: float, high: float) -> Callable[[Seen], float]:
        def of(s: Seen) -> float:
            f, ratio = over_measured(s, s.played.smooth)
            return float(np.median(ratio[(f >= low) & (f <= high)]))

        return of

    def least(index: int) -> Callable[[Seen], float]:
        return lambda s: float("nan") if s.read.surface is None else float(s.read.surface.best[index])

    return (
        Figure(
            where="Fig. 22", what=f"the table's peak simulated with {ACTUAL:g} kg and {HALF_POWER:g}, over the measured one",
            stated=below("far too small", 1.0 / 3.0), of=heavy_peak,
        ),
        Figure(where="Fig. 23", what="table mass at the minimum error, kg", stated=printed(80.0, 0.15), of=least(0)),
        Figure(where="Fig. 23", what="table damping at the minimum error", stated=printed(0.015, 0.35), of=least(1)),
        *(
            Figure(
                where="Fig. 24", what=f"|table / head| simulated without friction over measured, {low:g} to {high:g} Hz",
                stated=above(said, 1.0 + SEEN) if said == "too high" else below(said, 1.0 - SEEN), of=off(low, high),
            )
            for (low, high), said in COMPARED.items()
        ),
    )  # fmt: skip


def _ratios() -> tuple[Figure, ...]:
    def differ(low: float, high: float) -> Callable[[Seen], float]:
        return lambda s: apart(s.played.ratio, s.played.smooth_ratio, low, high)

    return (
        *(
            Figure(
                where="Fig. 26-27",
                what=f"ratio simulated without friction and measured, {low:g} to {high:g} Hz: factor between them",
                stated=Stated(words="agree", low=1.0, high=1.2, tolerance=0.1) if agree else above("differ", 1.2, 0.1),
                of=differ(low, high),
            )
            for (low, high), agree in RATIO_BANDS.items()
        ),
        Figure(
            where="Fig. 29", what=f"step between gain {LOW:g} and {HIGH:g} at 15 Hz: factor", stated=above("a step", 1.2),
            of=lambda s: float(np.exp(abs(np.log(s.played.ratio.steps[0][0])))),
        ),
        Figure(
            where="Fig. 30", what=f"ratio at gain {HIGH:g}, 15 to 80 Hz", stated=printed(1.0, 0.1),
            of=lambda s: middle(s.played.ratio, 15.0, 80.0),
        ),
    )  # fmt: skip


def _peaks() -> tuple[Figure, ...]:
    return (
        Figure(
            where="Fig. 31", what="the heatblock's locked peak under the head's drive, Hz",
            stated=printed(THESIS["heatblock_frequency"], AROUND_PEAK), of=lambda s: s.played.ratio.peaks.locked,
        ),
        Figure(
            where="Fig. 31-32", what="the same, unlocked minus locked, Hz", stated=above("unlocked higher", 0.3),
            of=lambda s: s.played.ratio.peaks.unlocked - s.played.ratio.peaks.locked,
        ),
        Figure(
            where="Fig. 31", what="ratio at the frequency of the unlocked peak", stated=printed(1.0, 0.1),
            of=lambda s: s.played.ratio.peaks.by_line,
        ),
        Figure(
            where="Fig. 32", what="ratio of the peaks at their own frequencies", stated=printed(0.5, 0.25),
            of=lambda s: s.played.ratio.peaks.ratio,
        ),
    )  # fmt: skip


def values(s: Seen) -> dict[str, float]:
    """Every figure of a campaign by its place and name."""
    return {f"{figure.where}: {figure.what}": figure.of(s) for figure in figures()}


def distance(found: dict[str, float]) -> float:
    """Root mean square over all figures of how many tolerances each lies outside what the thesis states."""
    off = [figure.stated.tolerances(found[f"{figure.where}: {figure.what}"]) for figure in figures()]
    return sqrt(sum(value**2 for value in off) / len(off))
