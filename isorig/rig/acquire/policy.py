"""Thresholds of the checks before, during and after a run, and how long a session waits: chosen unless a source is given."""

from dataclasses import dataclass

from isorig.drivers.waits import WAITS, Waits

#: Pre-run check: seconds at rest and with drive, and factor by which a channel must increase under drive.
REST_SECONDS, DRIVEN_SECONDS, RESPONSE_RATIO = 0.25, 0.75, 1.2
#: Share of its range that a channel uses: below the first, noise and quantization affect the result; above the second, bursts
#: clip.
SMALL_SHARE, LARGE_SHARE = 0.03, 0.80
#: Relative deviation of the sample rate by the host's clock that is reported, and that ends a run: crystals are within 1e-4, and
#: a host's clock that is being set within 5e-4 (NTP, `man adjtimex`). At the second, a natural frequency would be wrong by 2 %.
RATE_REPORTED, RATE_REFUSED = 0.002, 0.02
#: Time after which a rate is judged, s: a host that is late by a tenth of a second then shows 1 %.
RATE_SECONDS = 10.0
#: Time between two estimates of the rate during a pre-run check, s. Chosen: one from ten seconds takes some milliseconds of a
#: processor, so that the estimates take a few per cent of it, and a right rate prolongs the check by no more than this.
RATE_ESTIMATES = 0.1
#: Allowed relative rate errors by the instrument's clock, and by the host's if too few blocks arrive to estimate its uncertainty.
OWN_CLOCK, FEW_BLOCKS = 0.01, 0.25
#: Share of a limit that a simulated response must exceed to refuse a run: the values of a description may be a quarter off.
CERTAIN = 1.25
#: Allowed relative difference between a sensitivity in the plan and on a sheet: calibrations of accelerometers are uncertain by
#: 1 % at their reference frequency (ISO 16063-21, comparison with a reference transducer).
SENSITIVITY_DIFFERENCE = 0.01
#: Below this median coherence within the band, a response contains more than the effect of the drive.
COHERENT = 0.5
#: Below this share of relative motion between the two bodies of a contact, it sticks.
STICKING = 0.2
#: Distortion above this share of the response and above the noise is reported; a gain that differs more from the plan, too.
DISTORTED, GAIN_DIFFERENCE = 0.1, 1e-3
#: Ratio of incoherent to coherent power at half of the resolution, relative to that at the resolution, up to which resonances are
#: too narrow for it, and the least number of averages for such a ratio. Derived: theirs halves or more, that of noise stays.
NARROW, LEAST_AVERAGES = 0.6, 3.0
#: Ratio of what two runs with one drive do not share to the incoherent power: below the first the incoherent power is repeatable,
#: above the second it is not.
REPEATABLE, NOT_REPEATABLE = 0.3, 0.7
#: Ratio of incoherent power to that of the sensor's noise outside the band, up to which it is this noise.
NOISE_RATIO = 3.0
#: Two levels of the drive differ by this factor; their transfer functions differ by more than chance if the mean square of their
#: difference exceeds this multiple of its variance.
LEVEL_RATIO, DIFFERENT = 1.2, 2.0
#: Frequency bins in the driven band below which it is not resolved: in segments that are shorter than the response rings, leakage
#: lowers the coherence. Chosen: 16 s of a rig driven up to 10 Hz resolve as many.
RESOLVED = 20


@dataclass(frozen=True, kw_only=True)
class SessionWaits:
    """Timeouts of a session in seconds."""

    silence: float = 2.0  #: Without a sample, after which an instrument that counts is asked for its count.
    #: For which a connection may be lost or silent and then be continued; between two attempts.
    reconnection: float = 15.0
    retry: float = 0.2
    transit: float = 5.0  #: Within which a stopped instrument must have sent all data in transit.
    missing: float = 1.0  #: Of samples that may be missing at the end of a run without being waited for.
    #: Of samples that may wait for a slow disk; without progress, after which the disk counts as stuck.
    queue: float = 5.0
    disk: float = 10.0
    drivers: Waits = WAITS  #: Those of the drivers.


SESSION_WAITS = SessionWaits()
