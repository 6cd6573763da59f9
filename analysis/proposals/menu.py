"""The candidate runs: which excitations, configurations, levels and bands are compared for a rig within its limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import pi, sqrt
from typing import Literal

import numpy as np

from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel, matrices
from isorig.analysis.proposals.policy import (
    ABOUT,
    BELOW,
    BROAD,
    DWELLS,
    HELD,
    HIGHEST,
    LEVELS,
    LONGER,
    LOW,
    LOWEST,
    PERIOD,
    REST,
    SHORT,
    WIDE,
)  # fmt: skip
from isorig.analysis.simulate.compiled import constraint_basis

Excited = Literal["random", "multisine", "sine", "sweep", "moves", "steps", "free", "other"]


@dataclass(frozen=True, kw_only=True)
class CandidateRun:
    """A run that could be taken, named as in a plan.

    Parameters
    ----------
    configuration, excitation
        As in a plan: "random", "multisine", "sine", "sweep", "moves", "steps" or "free" (rest).
    gain
        Drive gain.
    seconds
        Length, s.
    band
        Hz, of a random drive, a multisine or a sweep.
    frequency
        Hz, of a sine.
    period
        Seconds, of a multisine.
    seed
        Of the drive's realisation.
    repeat_of
        Name of an earlier run whose drive is played again.
    """

    configuration: str
    excitation: Excited
    gain: float
    seconds: float
    band: tuple[float, float] | None = None
    frequency: float | None = None
    period: float = PERIOD
    seed: int = 0
    repeat_of: str | None = None

    @property
    def rests(self) -> bool:
        """Whether nothing is played."""
        return self.excitation == "free"


def natural_frequencies(model: RigModel, configuration: str) -> tuple[float, ...]:
    """Natural frequencies of the linear part in a configuration, without damping, Hz, ascending; none of what no spring holds."""
    setup = model.configurations[configuration]
    rigid = [model.link(name) for name in setup.rigid] if setup.lock_stiffness is None else []
    basis = constraint_basis(model, rigid)
    mass, _, stiffness = (basis.T @ matrix @ basis for matrix in matrices(model))
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    return tuple(sorted(sqrt(s) / (2.0 * pi) for s in squares.tolist() if s > HELD * max(squares.max(), 1e-300)))


def menu(
    model: RigModel, limits: Limits, sample_rate: float, *, seed: int = 1, repeatable: Sequence[tuple[str, CandidateRun]] = ()
) -> tuple[CandidateRun, ...]:
    """All candidate runs of a rig within the limits that need no simulation: gains, band and seconds.

    Parameters
    ----------
    model
        The rig; its natural frequencies place the bands.
    limits
        Gains and band must be stated.
    sample_rate
        Hz; no drive reaches beyond `HIGHEST` of it.
    seed
        Of the drives' realisations; each candidate has another one.
    repeatable
        Earlier runs whose drive can be played again, by name.
    """
    assert limits.gains is not None
    assert limits.band is not None
    lowest, highest = limits.gains
    low, high = max(limits.band[0], LOWEST), min(limits.band[1], HIGHEST * sample_rate)
    if not low < high:
        return ()
    gains = [share * highest for share in LEVELS if share * highest >= lowest]
    found: list[CandidateRun] = []
    for name in model.configurations:
        modes = [f for f in natural_frequencies(model, name) if low < f < high]
        for k, band in enumerate(_bands(modes, low, high)):
            for gain in gains if k < 2 else gains[:1]:
                found.append(CandidateRun(configuration=name, excitation="random", gain=gain, seconds=BROAD, band=band))
        for band in _bands(modes, low, high)[:2]:
            multisine = CandidateRun(configuration=name, excitation="multisine", gain=highest, seconds=BROAD, band=band)
            found += [multisine, replace(multisine, excitation="sweep")]
        for f, share in product(modes, DWELLS):
            if low <= share * f <= high:
                found.append(
                    CandidateRun(configuration=name, excitation="sine", gain=highest, seconds=SHORT, frequency=_three(share * f))
                )
        moved: tuple[Excited, ...] = ("moves", "steps")
        for kind, gain in product(moved, gains[:2]):
            found.append(CandidateRun(configuration=name, excitation=kind, gain=gain, seconds=SHORT))
    found += [replace(run, repeat_of=earlier) for earlier, run in repeatable]
    longest = [replace(run, seconds=LONGER * BROAD) for run in found if run.excitation == "random" and run.gain == highest]
    allowed = (
        replace(run, gain=min(_three(run.gain), highest), seconds=min(run.seconds, limits.seconds or run.seconds))
        for run in (*found, *longest)
    )
    unique = dict.fromkeys(allowed)
    return tuple(run if run.repeat_of else replace(run, seed=seed + k) for k, run in enumerate(unique))


def covers(model: RigModel, run: CandidateRun) -> bool:
    """Whether a run drives all that a linear rig shows: random, over every natural frequency of its configuration."""
    if run.excitation != "random" or run.band is None:
        return False
    return all(run.band[0] <= f <= run.band[1] for f in natural_frequencies(model, run.configuration))


def rest(model: RigModel, limits: Limits) -> CandidateRun:
    """A run at rest, in the rig's first configuration: it shows the sensors' noise and their hum alone."""
    gain = 1.0 if limits.gains is None else limits.gains[1]
    return CandidateRun(configuration=next(iter(model.configurations)), excitation="free", gain=gain, seconds=REST)


def _bands(modes: Sequence[float], low: float, high: float) -> list[tuple[float, float]]:
    # All that is allowed, the low band, what lies below the slowest mode, and the neighbourhood of each mode.
    found = [(low, high)]
    if modes:
        found += [(low, LOW * modes[0]), (low, BELOW * modes[0])]
        found += [(ABOUT[0] * f, ABOUT[1] * f) for f in modes]
    clipped = [(max(_three(a), low), min(_three(b), high)) for a, b in found]
    return list(dict.fromkeys((a, b) for a, b in clipped if b > WIDE * a))


def _three(value: float) -> float:
    # As it is written in a plan.
    return float(f"{value:.3g}")
