"""What the equations of motion tell of a run that is still being measured: place and kind of a cause, or that all hold."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.suspects import APART
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import HOLDS, Equations, equations_of
from isorig.analysis.model.rig_model import RigModel

#: Least score of a cause. Chosen: in a record of few periods an equation may seem broken, and some cause then removes a part of
#: that; right causes reach 1.1 and more in ten seconds of most rigs.
CLEAR = 1.0
#: A cause counts as known once a record this many times as long as the first that showed it shows it again. Chosen: a record of
#: few periods may favour a wrong cause, and the next one, with a quarter more data, then favours another.
CONFIRMED = 1.25
#: The same for equations that hold, and the least seconds of such a record. Chosen: rare events need time to occur.
STILL_HOLD, LEAST_SECONDS = 2.0, 20.0


@dataclass(frozen=True, kw_only=True)
class EarlyAnswer:
    """What the equations of motion tell of a record."""

    residuals: Mapping[str, float]  #: Residual of each equation over noise, by name: about one if it holds.
    #: Whether every equation of the records' configurations has a residual: one with friction needs enough sliding.
    complete: bool = True
    #: Of the cause that explains the residuals by far best; empty if none does.
    kind: str = ""
    place: str = ""

    @property
    def hold(self) -> bool:
        """Whether every equation holds."""
        return self.complete and all(value < HOLDS for value in self.residuals.values())


def early_answer(campaign: Campaign, model: RigModel) -> EarlyAnswer | None:
    """What the equations of motion of a campaign's records tell; None if its sensors support none."""
    equations = equations_of(campaign, model)
    residuals = equations.residuals()
    if not residuals:
        return None
    present = {run.configuration for run in campaign.runs}
    answer = EarlyAnswer(
        residuals=residuals,
        complete=all(balance.name in residuals for balance in equations.balances if present & set(balance.configurations)),
    )
    kind, place = pointed(equations) or ("", "")
    return replace(answer, kind=kind, place=place)


def pointed(equations: Equations) -> tuple[str, str] | None:
    """Kind and place of the cause that explains the residuals of the equations by far best; None if none does."""
    ranked = ranking(equations)
    best = ranked.explanations[0] if ranked.broken and ranked.explanations else None
    if best is None or best.score < CLEAR:
        return None
    rivals = (e.score for e in ranked.explanations if (e.kind, e.place) != (best.kind, best.place))
    return (best.kind, best.place) if best.score > max(rivals, default=0.0) + APART else None


@dataclass
class Decision:
    """Decides from the answers of a growing record when they are certain."""

    #: Duration in seconds from which on the record has given its present answer; by kind and place.
    since: dict[tuple[str, str], float] = field(default_factory=dict)

    def add(self, seconds: float, answer: EarlyAnswer) -> bool:
        """Whether the answer of a record of this many seconds is certain."""
        key = answer.kind, answer.place
        self.since = {key: self.since.get(key, seconds)} if answer.kind or answer.hold else {}
        if not self.since:
            return False
        if answer.kind:
            return seconds >= CONFIRMED * self.since[key]
        return seconds >= max(STILL_HOLD * self.since[key], LEAST_SECONDS)
