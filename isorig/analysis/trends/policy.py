"""The settings of trends: every threshold with its meaning and source."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TrendPolicy:
    """The thresholds by which parameters are followed over campaigns."""

    #: Slack of each of the parallel charts, in standard deviations: half of the change that it detects soonest. The slow one
    #: detects small changes and drifts, the fast one large changes within three campaigns.
    slacks: tuple[float, ...] = (0.5, 1.0)
    #: Standard deviations at which a campaign's contribution is clipped: one bad campaign alone must not raise an alarm.
    clip: float = 4.0
    #: Degrees of freedom from which a standard deviation counts as known, and below which there is no alarm.
    known_freedom: float = 2000.0
    fewest_freedom: float = 5.0
    #: Probability that the interval of a date contains it.
    date_confidence: float = 0.95
    #: Ratio of likelihoods above which drift and step, or two causes of a change, are distinguished, and above which a cause
    #: explains more than scatter. Chosen: as 95 % of certainty.
    likelihood_ratio: float = 20.0
    #: Difference of successive campaigns, in standard deviations, above which it counts as a change or a bad campaign and is
    #: excluded from the scatter.
    outlying_difference: float = 3.5
    #: Limit of such a difference, in standard deviations (winsorized mean: 95 % of the information of a normal sample).
    winsorized: float = 2.5
    #: Distance from the level, in standard deviations, above which a campaign is an outlier if its neighbours are not.
    outlying_campaign: float = 6.0
    #: Minimum number of rigs for a comparison, and maximum share of outlying rigs.
    fewest_rigs: int = 5
    most_outlying: float = 0.2
    #: Seconds of each run that are compared for the cause of a change.
    compared_seconds: float = 10.0
    #: Number of causes of the catalogue with a full fit, the most promising first.
    fitted_causes: int = 6
    #: Share of the misfit by which a cause must be better if no cause explains the change down to the noise.
    better: float = 0.1
    #: Relative standard deviation of a positive parameter with unknown scatter; for others a hundred finite differences.
    unknown_scatter: float = 0.3


POLICY = TrendPolicy()
