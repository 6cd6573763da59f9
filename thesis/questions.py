"""Questions of the author and the supervisor: question, answer, certainty, and the measurement that decides it."""

from __future__ import annotations

from math import isfinite

from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.design_study import BOND
from isorig.rig.wire_bonder.move_isolation import isolation_by_level
from isorig.rig.wire_bonder.stroke import frictionless
from thesis.campaign import HARDER, HIGH, SLIDING
from thesis.early import LEVELS as EARLY_LEVELS
from thesis.early import too_small
from thesis.figure_readings import HALF_POWER
from thesis.figures import distance, middle
from thesis.isolation import MASSES, PLACE, place
from thesis.moves import DISTANCE, HARDEST, LEVELS, MEASURED, level_for
from thesis.rivals import NEAR, Compared, base
from thesis.step import Step
from thesis.strokes import REPEATS, SOFT, lowest

PLAN = "[plans/two-gains.toml](plans/two-gains.toml)"


def questions(found: Compared, *, points: int = 100) -> Step:
    """The section; its answers use the same numbers as the other sections."""
    rows = [
        _sixty(found), _friction(found), _half_power(found), _effective(), _near_one(found), _peaks(found), _early(found),
        _soft(points),
    ]  # fmt: skip
    text = (
        f"{PLAN} is a plan for `rig acquire`: two gains at the motor's peak, moves, a locked run. `rig characterize` fits it "
        "down to the noise for Coulomb friction, and reports a misfit for Stribeck friction; `rig diagnose` then identifies the "
        "law."
    )
    heads = ("question", "answer", "certainty", "the measurement that would decide it")
    return Step(title="What the author and the supervisor wanted to know", tables=[(heads, rows)], text=[text])


def _sixty(found: Compared) -> tuple[str, ...]:
    rig = base(found).played.rig
    levels = [isolation_by_level(r, DISTANCE, LEVELS, tolerance=BOND.tolerance) for r in (rig, wire_bonder())]
    low, high = sorted(level_for(item, MEASURED) for item in levels)
    hard = isolation_by_level(frictionless(rig), DISTANCE, [HARDEST], tolerance=BOND.tolerance).isolation[0]
    return (
        "Why 60 % where 98 % were predicted?",
        f"Friction, at the acceleration of a bench: moves isolate {MEASURED:.0%} at {low:.0f} to {high:.0f} m/s², and {hard:.0%} "
        "at 17 g without friction. For the machine's moves friction has little effect.",
        "certain that friction is a sufficient reason; the acceleration of the measured move is not given",
        "one move of 4 mm at 17 g and one at 25 m/s², unlocked and locked, heatblock relative to table",
    )


def _friction(found: Compared) -> tuple[str, ...]:
    far = sorted((distance(values), name) for name, (_, values) in found.items())
    (least, first), (second, other) = far[:2]
    sure = (
        "the printed figures do not distinguish them" if second - least < NEAR else "the printed figures clearly prefer the first"
    )
    return (
        "Which friction is it?",
        f"{first} ({least:.2f} tolerances from the thesis) or {other[0].lower() + other[1:] if other[0].isalpha() else other} "
        f"({second:.2f}); not 20 N of Coulomb friction with the drive assumed here.",
        f"uncertain: {sure}",
        f"two gains, as in {PLAN}: a drive {HARDER:g} times as strong is visible in the head's channel, and {SLIDING:g} N of "
        "sliding friction with 20 N of breakaway force in a misfit at one of the gains",
    )


def _half_power(found: Compared) -> tuple[str, ...]:
    read = [value for value in base(found).half_power if isfinite(value)]
    return (
        f"Why does half-power give {HALF_POWER:g} for the table, if {THESIS['table_damping']:g} fits?",
        f"The neighbour's damping, friction, and a coarse frequency resolution: {min(read):.3f} to {max(read):.3f} from fine to "
        "coarse resolution.",
        "certain about the causes; their shares depend on the resolution, which is not given",
        "the same run evaluated with resolutions of 0.06 and 0.5 Hz",
    )


def _effective() -> tuple[str, ...]:
    text = ", ".join(f"{place(mass)[0]:.1f} Hz with {mass:g} kg" for mass in MASSES)
    near = [mass for mass in MASSES if PLACE.tolerances(place(mass)[0]) <= 1.0]
    return (
        "Why is the effective mass of the table 80 kg, if it weighs 250 kg?",
        "Only part of it moves in the mode at 10.8 Hz. This does not apply at 165 Hz: the heatblock's locked peak is at "
        f"{text}, and the thesis's {PLACE.low:g} Hz require "
        f"{' or '.join(f'{m:g} kg' for m in near) or 'more than any of these'}.",
        "certain that one mass does not fit both frequencies",
        "a hammer test at bonding height with accelerometers along the table: mode shapes at 11 Hz and around 165 Hz",
    )


def _near_one(found: Compared) -> tuple[str, ...]:
    value = middle(base(found).played.ratio, 15.0, 80.0)
    return (
        "Why is the ratio near 1 from 15 to 80 Hz?",
        f"At gain {HIGH:g} the motor is stuck and behaves like a locked one ({value:.3f} here). The ratio does not show the "
        "isolation there.",
        "certain",
        "narrow bands at a gain that overcomes breakaway, locked and unlocked",
    )


def _peaks(found: Compared) -> tuple[str, ...]:
    peaks = base(found).played.ratio.peaks
    return (
        "Why do the locked and unlocked peaks near 164.5 Hz differ in frequency, with ratios of 1 and 0.5?",
        f"Unexplained: here they are {peaks.unlocked - peaks.locked:.2f} Hz apart with ratios of {peaks.by_line:.2f} and "
        f"{peaks.ratio:.2f}, and no table mass gives both the thesis's frequency and the offset that its ratios require.",
        "certain that three masses and friction are not sufficient",
        "the two peaks in Hz at two gains, 140 to 190 Hz, with a resolution of 0.1 Hz",
    )


def _early(found: Compared) -> tuple[str, ...]:
    low, high = sorted(1.0 / too_small(base(found).played.rig, level) for level in (EARLY_LEVELS[0], EARLY_LEVELS[-1]))
    return (
        "Why was the first simulation too small by about 4?",
        f"Its table of 300 kg: locked, the heatblock of the identified rig moves {low:.1f} to {high:.1f} times as far.",
        "certain, because friction is not involved",
        "none: the identified mass answers it",
    )


def _soft(points: int) -> tuple[str, ...]:
    going, ended = lowest(points), max(lowest(points, repeat=n, after=True) for n in REPEATS)
    return (
        "How soft may the isolation be?",
        f"{going:.2f} Hz while moves continue, without friction (the thesis: {SOFT:g}), {ended:.2f} Hz if they may end at any "
        "time.",
        "limited by the head's mass, which is not given",
        "weigh the head, or fit it with `rig characterize`: a recording without head_mass gives it with its uncertainty",
    )
