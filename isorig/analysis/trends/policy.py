"""The settings of trends: every threshold with its meaning and source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TrendPolicy:
    """The thresholds by which parameters are followed over campaigns.

    Parameters
    ----------
    slacks
        Slack of each of the parallel charts, in standard deviations: half of the change that it detects soonest. The slow one
        detects small changes and drifts, the fast one large changes within three campaigns.
    clip
        Standard deviations at which a campaign's contribution is clipped: one bad campaign alone must not raise an alarm.
    known_freedom, fewest_freedom
        Degrees of freedom from which a standard deviation counts as known, and below which there is no alarm.
    date_confidence
        Probability that the interval of a date contains it.
    likelihood_ratio
        Ratio of likelihoods above which drift and step, or two causes of a change, are distinguished, and above which a cause
        explains more than scatter. Chosen: as 95 % of certainty.
    outlying_difference
        Difference of successive campaigns, in standard deviations, above which it counts as a change or a bad campaign and is
        excluded from the scatter.
    winsorized
        Limit of such a difference, in standard deviations (winsorized mean: 95 % of the information of a normal sample).
    outlying_campaign
        Distance from the level, in standard deviations, above which a campaign is an outlier if its neighbours are not.
    fewest_rigs, most_outlying
        Minimum number of rigs for a comparison, and maximum share of outlying rigs.
    compared_seconds
        Seconds of each run that are compared for the cause of a change.
    fitted_causes
        Number of causes of the catalogue with a full fit, the most promising first.
    better
        Share of the misfit by which a cause must be better if no cause explains the change down to the noise.
    unknown_scatter
        Relative standard deviation of a positive parameter with unknown scatter; for others a hundred finite differences.
    """

    slacks: tuple[float, ...] = (0.5, 1.0)
    clip: float = 4.0
    known_freedom: float = 2000.0
    fewest_freedom: float = 5.0
    date_confidence: float = 0.95
    likelihood_ratio: float = 20.0
    outlying_difference: float = 3.5
    winsorized: float = 2.5
    outlying_campaign: float = 6.0
    fewest_rigs: int = 5
    most_outlying: float = 0.2
    compared_seconds: float = 10.0
    fitted_causes: int = 6
    better: float = 0.1
    unknown_scatter: float = 0.3


POLICY = TrendPolicy()
