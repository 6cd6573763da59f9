"""What fits see of a campaign, and what no fit sees and judges them: the ends of all runs, or the beginnings of some."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from isorig.analysis.fitting.trials import Trial

#: Fine steps per sample of the finest grid, on which models are judged.
FINEST = 8
#: Seconds that the beginning of a run takes.
BEGINNING = 5.0


@dataclass(frozen=True, kw_only=True)
class Division:
    """Runs divided.

    Parameters
    ----------
    fits
        What fits may see.
    judged
        What judges them, on the finest grid: of each trial what comes after `fitted` samples.
    beginnings
        Whether it is beginnings that judge.
    how
        What judges, in words.
    """

    fits: tuple[Trial, ...]
    judged: tuple[Trial, ...]
    how: str
    beginnings: bool = False


Divide = Callable[[Sequence[Trial]], Division]


def refined(trial: Trial) -> Trial:
    """The trial on the grid that models are judged on."""
    return replace(trial, excitation=trial.excitation.resampled(FINEST))


def ends(trials: Sequence[Trial]) -> Division:
    """Fits see the beginnings of all runs, and are judged by the ends."""
    return Division(
        fits=tuple(trials), judged=tuple(refined(trial) for trial in trials),
        how="the last 40 % of every run (all of a run marked as held out), which no fit saw; the model runs free from the run's "
        "first sample",
    )  # fmt: skip


def beginnings(trials: Sequence[Trial]) -> Division:
    """Fits see all runs but the second strongest of each configuration, and are judged by the beginning of those.

    What acts on a rig at rest and is forgotten once it moves shows nowhere else.
    """
    strongest: dict[str, list[Trial]] = defaultdict(list)
    for trial in sorted(trials, key=lambda trial: -trial.run.gain):
        if trial.fitted and trial.motion is None:
            strongest[trial.run.configuration].append(trial)
    kept = [same[1] for same in strongest.values() if len(same) > 1]
    return Division(
        fits=tuple(trial for trial in trials if all(trial is not other for other in kept)),
        judged=tuple(begun(refined(trial)) for trial in kept),
        beginnings=True,
        how=f"the first {BEGINNING:g} s of the runs {', '.join(trial.run.id for trial in kept)}, of which no fit saw anything; "
        "the ends of all runs fit without a cause",
    )  # fmt: skip


def begun(trial: Trial) -> Trial:
    """The beginning of a run, none of it for fits."""
    n = min(trial.samples, trial.onset + round(BEGINNING * trial.sample_rate))
    return replace(trial, fitted=0, measured=trial.measured[:, :n], excitation=trial.excitation.beginning(n))
