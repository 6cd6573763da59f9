"""Division of a campaign into fit data and held-out data: the ends of all runs, or the beginnings of some."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from isorig.analysis.fitting.held_out import FIT_SHARE
from isorig.analysis.fitting.trials import Trial

#: Simulation steps per sample of the finest grid, on which models are judged.
FINEST = 8
#: Duration of the beginning of a run, seconds.
BEGINNING = 5.0


@dataclass(frozen=True, kw_only=True)
class Division:
    """Divided runs."""

    fits: tuple[Trial, ...]  #: Data for fits.
    judged: tuple[Trial, ...]  #: Held-out data, on the finest grid: of each trial the part after `fitted` samples.
    how: str  #: Description of the held-out data.
    beginnings: bool = False  #: Whether beginnings are held out.


Divide = Callable[[Sequence[Trial]], Division]


def refined(trial: Trial) -> Trial:
    """The trial on the grid for judging models."""
    return trial.on_grid(FINEST)


def coarsened(trial: Trial) -> Trial:
    """The trial on half the grid of its own, for differences between simulations."""
    return trial.on_grid(max(trial.excitation.oversample // 2, 1))


def ends(trials: Sequence[Trial]) -> Division:
    """Fits use the beginnings of all runs, and are judged by the ends."""
    return Division(
        fits=tuple(trials), judged=tuple(refined(trial) for trial in trials if trial.fitted < trial.samples),
        how=f"the last {100.0 * (1.0 - FIT_SHARE):.0f} % of every run (the last moves of a run that comes to rest, all of the "
        "second strongest of several decays or sweeps and of a run marked as held out), held out from the fits; "
        f"{trials[0].prediction}",
    )  # fmt: skip


def beginnings(trials: Sequence[Trial]) -> Division:
    """Fits use all runs except the second strongest of each configuration, and are judged by the beginning of those.

    Effects on a rig at rest that vanish once it moves are visible only there.
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
        how=f"the first {BEGINNING:g} s of the runs {', '.join(trial.run.id for trial in kept)}, held out from the fits; "
        "the ends of all runs fit without a cause",
    )  # fmt: skip


def begun(trial: Trial) -> Trial:
    """The beginning of a run, completely held out."""
    n = min(trial.samples, trial.onset + round(BEGINNING * trial.sample_rate))
    return replace(trial, fitted=0, measured=trial.measured[:, :n], excitation=trial.excitation.beginning(n))
