"""The settings of a fleet: every threshold with its meaning and source."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class FleetPolicy:
    """The thresholds by which changes of rigs are reported."""

    #: Allowed false alarms per month: in the whole fleet, and of each rig (one in four years). Chosen: a month is what one
    #: operator can follow up, but at this rate three rigs would have a false change every five weeks.
    false_alarms: float = 1.0
    false_alarms_of_rig: float = 1.0 / 48.0
    #: Days between campaigns, if the interval of a rig is unknown.
    unknown_interval: float = 7.0
    #: Probability that a rig of a fleet without outliers is called an outlier.
    outlier_risk: float = 0.05
    #: A cause is new if this many of this many successive campaigns name it, and as many before named no similar cause.
    naming: int = 2
    successive: int = 3
    unnamed_before: int = 3
    #: Size of a parameter's change, in standard deviations, above which it dates a change better than the name of a cause.
    dating_change: float = 8.0
    #: Changes whose size, over all campaigns since, is below this many standard deviations are not confirmed.
    confirmed_change: float = 3.0
    #: Number of changed parameters that a sentence about a date states, the most significant first.
    stated_changes: int = 3
    #: A pause in the measurements of this many usual intervals is reported.
    reported_pause: float = 3.0
    #: Number of explanations stored for a change.
    kept_explanations: int = 8
    #: Share of the improvement by the best cause, above which another one is listed.
    listed_explanation: float = 0.01


POLICY = FleetPolicy()
