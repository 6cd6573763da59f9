"""The settings of proposals and investigations on the rig: every threshold with its meaning and source."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class NextRunPolicy:
    """The thresholds by which proposed runs are compared, planned, measured and described."""

    #: Processor time that a proposal may take to compare candidates, s; those that were not reached by then are left out, and
    #: this is said.
    comparison_seconds: float = 20.0
    #: Longest run where no limit is stated, s.
    longest_run: float = 60.0
    #: Share of a channel's noise level that the rig's own motion may make up before the level is no longer taken as noise.
    own_motion: float = 0.5
    #: Seconds between two runs.
    pause: float = 30.0
    #: Noise of a sensor before it is measured, as a share of its signal with the strongest allowed drive.
    noise_guess: float = 3e-4
    #: Relative uncertainty of a parameter known only as a starting value in the description.
    first_guess: float = 0.3
    #: Consecutive stages without a change of verdict and causes after which an unexplained remainder is left as it is.
    unchanged: int = 2
    #: Number of causes listed by name in a sentence.
    listed: int = 4
    #: Standard errors above which a distance is no longer stated.
    stated_distance: float = 100.0
    #: Largest distance in a table or a caption, in standard errors: a larger one, which may be infinite, is given as this one.
    largest_distance: float = 999.0
    #: Number of ruled-out causes listed by name after a diagnosis.
    listed_ruled_out: int = 6
    #: Seconds of a prediction shown around the largest difference.
    shown_seconds: float = 1.0
    #: Sensitivity of a channel of the virtual rig, V per SI unit, for a plan without its own instrument.
    sensitivity: float = 0.2


POLICY = NextRunPolicy()
