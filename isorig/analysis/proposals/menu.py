"""The candidate runs: excitations, configurations, levels and bands to be compared for a rig within its limits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

from isorig.analysis.excitations import PlannedExcitation
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.simulate.natural import natural_modes


@dataclass(frozen=True, kw_only=True)
class CandidateRun:
    """A possible run, with the terms of a plan."""

    #: As in a plan: "random", "multisine", "sine", "sweep", "moves", "steps" or "free" (rest).
    configuration: str
    excitation: PlannedExcitation
    gain: float
    seconds: float  #: Duration, s.
    band: tuple[float, float] | None = None  #: Hz, for a random drive, a multisine or a sweep.
    frequency: float | None = None  #: Hz, for a sine.
    period: float = POLICY.multisine_period  #: Seconds, for a multisine.
    seed: int = 0  #: Random seed of the drive.
    repeat_of: str | None = None  #: Name of an earlier run whose drive is repeated.

    @property
    def rests(self) -> bool:
        """Whether there is no drive."""
        return self.excitation == "free"


def candidate_runs(
    model: RigModel, limits: Limits, sample_rate: float, *, seed: int = 1, repeatable: Sequence[tuple[str, CandidateRun]] = ()
) -> tuple[CandidateRun, ...]:
    """All candidate runs of a rig within the limits that need no simulation: gains, band and seconds.

    Gains and band must be given. The rig's natural frequencies determine the bands; no drive exceeds `POLICY.highest_frequency`
    of the sample rate (Hz), and each has another realization of the random seed. `repeatable` are earlier runs whose drive can be
    repeated, by name.
    """
    assert limits.gains is not None
    assert limits.band is not None
    lowest, highest = limits.gains
    low, high = max(limits.band[0], POLICY.lowest_frequency), min(limits.band[1], POLICY.highest_frequency * sample_rate)
    if not low < high:
        return ()
    gains = [share * highest for share in POLICY.levels if share * highest >= lowest]
    found: list[CandidateRun] = []
    for name in model.configurations:
        modes = [mode.frequency for mode in natural_modes(model, name) if low < mode.frequency < high]
        bands = _bands(modes, low, high)
        broad = partial(CandidateRun, configuration=name, seconds=POLICY.broad_run)
        short = partial(CandidateRun, configuration=name, seconds=POLICY.short_run)
        for k, band in enumerate(bands):
            found += [broad(excitation="random", gain=gain, band=band) for gain in (gains if k < 2 else gains[:1])]
        for band in bands[:2]:
            found += [broad(excitation=kind, gain=highest, band=band) for kind in ("multisine", "sweep")]
        dwells = [share * f for f, share in product(modes, POLICY.dwells)]
        found += [short(excitation="sine", gain=highest, frequency=_three(f)) for f in dwells if low <= f <= high]
        found += [short(excitation="moves", gain=gain) for gain in gains[:2]]
        found += [short(excitation="steps", gain=gain) for gain in gains[:2]]
    longest = [
        replace(run, seconds=POLICY.longer * POLICY.broad_run)
        for run in found
        if run.excitation == "random" and run.gain == highest
    ]
    allowed = (
        replace(run, gain=min(_three(run.gain), highest), seconds=min(run.seconds, limits.seconds or run.seconds))
        for run in (*found, *longest)
    )
    unique = dict.fromkeys(allowed)
    # A repeated drive is the same sample for sample, or it is no repetition.
    again = tuple(
        replace(run, repeat_of=earlier)
        for earlier, run in repeatable
        if run.gain <= highest and run.seconds <= (limits.seconds or run.seconds)
    )
    return (*(replace(run, seed=seed + k) for k, run in enumerate(unique)), *again)


def covers_all_modes(model: RigModel, run: CandidateRun) -> bool:
    """Whether a run excites everything that a linear rig has: random, over all natural frequencies of its configuration."""
    if run.excitation != "random" or run.band is None:
        return False
    return all(run.band[0] <= mode.frequency <= run.band[1] for mode in natural_modes(model, run.configuration))


def cost(run: CandidateRun, configuration: str, limits: Limits) -> float:
    """Cost of a run in the present configuration of the rig, in seconds of measuring."""
    price = POLICY.lock_price if limits.lock_price is None else limits.lock_price
    return run.seconds + POLICY.overhead + (price if run.configuration != configuration else 0.0)


def run_at_rest(model: RigModel, limits: Limits) -> CandidateRun:
    """A run at rest, in the rig's first configuration: it shows only the sensors' noise and hum."""
    gain = 1.0 if limits.gains is None else limits.gains[1]
    return CandidateRun(configuration=next(iter(model.configurations)), excitation="free", gain=gain, seconds=POLICY.rest_run)


def _bands(modes: Sequence[float], low: float, high: float) -> list[tuple[float, float]]:
    # The whole allowed band, the low band, the band below the lowest mode, and the neighbourhood of each mode.
    found = [(low, high)]
    if modes:
        found += [(low, POLICY.low_band * modes[0]), (low, POLICY.band_below_modes * modes[0])]
        found += [(POLICY.band_around_mode[0] * f, POLICY.band_around_mode[1] * f) for f in modes]
    clipped = [(max(_three(a), low), min(_three(b), high)) for a, b in found]
    return list(dict.fromkeys((a, b) for a, b in clipped if b > POLICY.narrowest_band * a))


def _three(value: float) -> float:
    # As written in a plan.
    return float(f"{value:.3g}")
