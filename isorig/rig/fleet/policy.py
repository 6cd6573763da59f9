"""The settings of a fleet: every threshold with its meaning and source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class FleetPolicy:
    """The thresholds by which changes of rigs are reported.

    Parameters
    ----------
    false_alarms, false_alarms_of_rig
        Allowed false alarms per month: in the whole fleet, and of each rig (one in four years). Chosen: a month is what one
        operator can follow up, but at this rate three rigs would have a false change every five weeks.
    unknown_interval
        Days between campaigns, if the interval of a rig is unknown.
    outlier_risk
        Probability that a rig of a fleet without outliers is called an outlier.
    naming, successive, unnamed_before
        A cause is new if this many of this many successive campaigns name it, and as many before named no similar cause.
    dating_change
        Size of a parameter's change, in standard deviations, above which it dates a change better than the name of a cause.
    confirmed_change
        Changes whose size, over all campaigns since, is below this many standard deviations are not confirmed.
    reported_pause
        A pause in the measurements of this many usual intervals is reported.
    kept_explanations
        Number of explanations stored for a change.
    listed_explanation
        Share of the improvement by the best cause, above which another one is listed.
    """

    false_alarms: float = 1.0
    false_alarms_of_rig: float = 1.0 / 48.0
    unknown_interval: float = 7.0
    outlier_risk: float = 0.05
    naming: int = 2
    successive: int = 3
    unnamed_before: int = 3
    dating_change: float = 8.0
    confirmed_change: float = 3.0
    reported_pause: float = 3.0
    kept_explanations: int = 8
    listed_explanation: float = 0.01


POLICY = FleetPolicy()
