"""The thresholds of a proposal: every one with its meaning, unit and source."""

from __future__ import annotations

from dataclasses import dataclass

# How far causes lie apart.

#: Distances, in standard errors of a spectral line, up to which a run cannot part two causes and from which it will. Chosen: at 3
#: the rival errs by three times what is allowed, twice the adequacy threshold of a diagnosis; at 1 it errs by 1.4 times, within
#: that threshold.
CANNOT, WILL = 1.0, 3.0
#: Gain in probability below which a further run is not worth its time. Chosen: about what one of the catalogue's eighteen causes
#: weighs at one of three places.
WORTH = 0.02
#: Models drawn from what is known of each surviving cause: of those compared, and of those that must stay within the limits.
#: Chosen: the time of a comparison grows with the first; of the second, seven drawn beside the fitted one, the largest value of
#: any parameter lies 1.35 deviations above it on average.
COMPARED, KEPT = 3, 8
#: Runs of a proposal at most. Chosen: a plan that a person reads; after three runs a diagnosis knows more than a forecast.
MOST_RUNS = 3
#: Pairs of causes whose predictions are shown. Chosen: one picture each.
SHOWN = 3

# What a run costs.

#: What every run costs beside its own length, s: setting it up, and the diagnosis after it. Chosen: a diagnosis takes as long.
OVERHEAD = 20.0
#: Price of a change of the configuration where none is stated, s of measuring. Chosen: a lock is screwed down within a minute.
LOCK_PRICE = 60.0

# Predictions.

#: Seconds of a run that are simulated to compare models. Chosen: six time constants of the slowest transient of the wire bonder,
#: its table at 10.8 Hz with 1.5 % of critical damping. A sweep is simulated whole.
HORIZON = 6.0
#: Fine steps per sample of these simulations: models that share the error of the grid are compared.
GRID = 2
#: Deviation of a fitted value on its logarithm, or in hundreds of its finite differences, that is taken as known beforehand: a
#: linear step is not trusted any further. Chosen: a factor of two, the logarithm of which is 0.69.
TRUSTED = 0.7

# Limits.

#: Share of a limit that a simulated run may use: a real rig differs from every model of it. Chosen: the peak of a random drive's
#: response differs by about a tenth between models that agree with the same data.
USABLE = 0.9

# Candidate runs.

#: Seconds of a run that drives a band, of one that repeats something short (a sine, a move, a step), and of rest. Chosen: 20 s
#: hold 20 averages of 1 s; the others show in their first periods what they show; 5 s of rest hold 250 periods of the mains.
BROAD, SHORT, REST = 20.0, 10.0, 5.0
#: A longer run, as a multiple of `BROAD`: its error bars are 0.7 times as wide.
LONGER = 2.0
#: Levels of a drive as shares of the highest gain allowed. Chosen: forces that grow with
#: the square of the motion differ by 4 and by 25 between them, against those that grow with it.
LEVELS = (1.0, 0.5, 0.2)
#: The band about a natural frequency, as shares of it; how far above the slowest motion the low band reaches; and up to which
#: share of the slowest natural frequency a drive lies below it. Chosen: a resonance damped by 10 % is inside the first.
ABOUT, LOW, BELOW = (0.75, 1.3), 4.0, 0.6
#: Ratio of a band's ends from which it is a band.
WIDE = 1.2
#: Period of a multisine, s: its lines lie 0.25 Hz apart.
PERIOD = 4.0
#: Lowest frequency of a drive, Hz: some periods of it must fit into a run. Highest, as a share of the sample rate: the
#: instrument's own filter begins to act above it.
LOWEST, HIGHEST = 0.2, 0.4
#: Frequencies of a sine dwell, as shares of a natural frequency: below it the spring carries the force, at it the damper.
DWELLS = (0.6, 1.0)
#: Square of a natural frequency over the largest one's, from which a spring holds the body: rounding errors are below it.
HELD = 1e-9

# Runs for a parameter.

#: Distance of a transfer function's lines, Hz, and how many neighbours of a Hann window say the same: its equivalent noise
#: bandwidth (Harris 1978, table 1).
RESOLUTION, ALIKE = 0.5, 1.5
#: Lines whose coherence is less say nothing that an error bar describes: some 15 averages of noise alone have a fifth of it.
COHERENT = 0.3
#: Shortest run that is proposed, s: two thirds of it are fitted, and transients die in them.
SHORTEST = 5.0
#: Deviation after a run over the one before it, from which the run is not worth taking.
NO_BETTER = 0.99

# What would part causes that no allowed run parts.

#: Factors by which gains are raised, one after another; the first leaves them and lifts all other limits. Chosen: beyond three
#: times the gain it is another rig that is needed.
RAISED = (1.0, 1.5, 2.0, 3.0)
#: What a displacement sensor across a link resolves, m (an inductive or capacitive one), and how far above the first a second
#: accelerometer sits, m.
RESOLVES, HIGHER = 1e-6, 0.05
#: Allowed candidates that are tried with another sensor: those that part the causes best without it.
TRIED = 3

# Causes that nobody has seen yet.

#: Frequencies at which a hidden oscillator is supposed, Hz. Chosen: two of the range in which the study of the diagnosis hides
#: them, 20 to 300 Hz.
HIDDEN_MODES = (30.0, 110.0)
#: Mains frequency that a hum is supposed to have, Hz, and its amplitude in the channel's unit: a third of the smallest
#: that the study hides.
MAINS, HUM = 50.0, 0.01
#: Seconds over which a drift is counted: the length of a session.
SESSION = 720.0
#: In place of what does not move at all.
TINY = 1e-12


@dataclass(frozen=True, kw_only=True)
class Smallest:
    """The smallest size of each cause that is worth finding: a third of the smallest that the study of the diagnosis hides.

    Parameters
    ----------
    spring
        Share of a spring's force at the largest deflection by which it departs from a straight line.
    softening_scale
        Deflection over which a softening spring softens, as a share of the largest.
    breakaway, stribeck_speed
        Breakaway above sliding friction, as a share; speed of its fall as a share of the largest speed.
    presliding, play
        Share of the largest deflection before friction slides; half the play.
    asymmetry
        Share by which friction differs from its mean either way.
    stop, stop_stiffness
        Deflection of a stop as a share of the largest, and its stiffness as a multiple of the spring's.
    drag
        Force of quadratic damping at the largest speed over dry friction and viscous force there.
    drift
        Share of a stiffness over `SESSION`.
    rider, arm
        Mass of a hidden oscillator as a share of its body's; arm of the drive about the centre of gravity, m.
    mass, gain
        Shares.
    lock
        Stiffness of a lock over the spring's.
    delay
        Samples.
    clipping, crosstalk
        Limit as a share of the largest record; share of the largest record that comes from elsewhere.
    """

    spring: float = 0.1
    softening_scale: float = 0.25
    breakaway: float = 0.17
    stribeck_speed: float = 0.07
    presliding: float = 0.01
    play: float = 0.02
    asymmetry: float = 0.08
    stop: float = 0.75
    stop_stiffness: float = 0.5
    drag: float = 0.17
    drift: float = 0.033
    rider: float = 0.007
    arm: float = 0.0033
    mass: float = 0.02
    lock: float = 1200.0
    gain: float = 0.017
    delay: float = 0.27
    clipping: float = 0.88
    crosstalk: float = 0.01


SMALLEST = Smallest()
