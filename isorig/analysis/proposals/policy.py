"""The settings of a proposal: every threshold with its meaning and source."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ProposalPolicy:
    """The thresholds by which the next runs are chosen."""

    #: Distances between causes, in standard errors of a frequency bin, up to which a run cannot distinguish two causes and from
    #: which it will. Chosen: at 3 the rival's error is three times the allowed error, twice the adequacy threshold of a
    #: diagnosis; at 1 it is 1.4 times, within that threshold.
    indistinguishable: float = 1.0
    distinguishable: float = 3.0
    #: Increase in probability below which a further run is not worthwhile. Chosen: about the weight of one of the catalogue's
    #: eighteen causes at one of three places.
    worthwhile_gain: float = 0.02
    #: Models drawn from the uncertainty of each remaining cause: number compared, and number that must stay within the limits.
    #: Chosen: the time of a comparison is proportional to the first; for the second, of seven draws in addition to the fitted
    #: model, the largest value of any parameter is 1.35 standard deviations above it on average.
    compared_draws: int = 3
    simulated_draws: int = 8
    #: Maximum number of runs in a proposal. Chosen: a plan that a person can read; after three runs a diagnosis knows more than a
    #: prediction.
    most_runs: int = 3
    #: Number of pairs of causes whose predictions are shown. Chosen: one figure each.
    shown_pairs: int = 3
    #: Cost of every run in addition to its duration, s: preparation, and the diagnosis after it. Chosen: the time of a diagnosis.
    overhead: float = 20.0
    #: Price of a change of the configuration if not given, s of measuring. Chosen: a lock is installed within a minute.
    lock_price: float = 60.0
    #: Seconds of a run simulated to compare models. Chosen: six time constants of the slowest transient of the wire bonder, its
    #: table at 10.8 Hz with 1.5 % of critical damping. A sweep is simulated in full.
    simulated_seconds: float = 6.0
    #: Simulation steps per sample: the compared models share the discretization error.
    steps_per_sample: int = 2
    #: Standard deviation of the logarithm of a fitted value, or in hundreds of its finite differences, assumed as prior
    #: knowledge: a linear step is not trusted beyond it. Chosen: a factor of two, the logarithm of which is 0.69.
    trusted_deviation: float = 0.7
    #: Share of a limit that a simulated run may use: a real rig differs from every model. Chosen: the peak of a random drive's
    #: response differs by about a tenth between models that agree with the same data.
    usable_share: float = 0.9
    #: Seconds of a run that excites a band, of one with a short periodic signal (a sine, a move, a step), and of rest. Chosen: 20
    #: s contain 20 averages of 1 s; the second kind shows its effect in the first periods; 5 s of rest contain 250 periods of the
    #: mains.
    broad_run: float = 20.0
    short_run: float = 10.0
    rest_run: float = 5.0
    #: Length of a longer run, as a multiple of the usual one: its error bars are 0.7 times as wide.
    longer: float = 2.0
    #: Levels of a drive as shares of the highest allowed gain. Chosen: forces proportional to the square of the motion differ by
    #: 4 and by 25 between them, relative to those proportional to it.
    levels: tuple[float, ...] = (1.0, 0.5, 0.2)
    #: Band around a natural frequency, as shares of it; upper end of the low band relative to the lowest natural frequency; and
    #: maximum frequency of a drive below the lowest natural frequency, as a share of it. Chosen: the first contains a resonance
    #: with 10 % damping.
    band_around_mode: tuple[float, float] = (0.75, 1.3)
    low_band: float = 4.0
    band_below_modes: float = 0.6
    #: Minimum ratio of a band's ends.
    narrowest_band: float = 1.2
    #: Period of a multisine, s: its frequencies are 0.25 Hz apart.
    multisine_period: float = 4.0
    #: Lowest frequency of a drive, Hz: a run must contain several periods. Highest, as a share of the sample rate: above it the
    #: instrument's own filter has an effect.
    lowest_frequency: float = 0.2
    highest_frequency: float = 0.4
    #: Frequencies of a sine dwell, as shares of a natural frequency: below it the spring force dominates, at it the damping
    #: force.
    dwells: tuple[float, ...] = (0.6, 1.0)
    #: Frequency resolution of a transfer function, Hz, and number of correlated neighbouring bins of a Hann window: its
    #: equivalent noise bandwidth (Harris 1978, table 1).
    resolution: float = 0.5
    correlated_bins: float = 1.5
    #: Bins with a smaller coherence are not used, because error bars do not describe them: about 15 averages of noise alone have
    #: 1/5 of it.
    least_coherence: float = 0.3
    #: Shortest proposed run, s: two thirds of it are fitted, and transients decay in them.
    shortest_run: float = 5.0
    #: Uncertainty after a run divided by that before it, above which the run is not worthwhile.
    remaining_uncertainty: float = 0.99
    #: Factors for raising gains, tried in order; the first keeps the gains and lifts all other limits. Chosen: above three times
    #: the gain, another rig is needed.
    raised_gains: tuple[float, ...] = (1.0, 1.5, 2.0, 3.0)
    #: Resolution of a displacement sensor across a link, m (inductive or capacitive), and height of a second accelerometer above
    #: the first, m.
    sensor_resolution: float = 1e-6
    second_sensor_height: float = 0.05
    #: Number of allowed candidates tried with another sensor: those that distinguish the causes best without it.
    tried_with_sensor: int = 3
    #: Duration of a drift, seconds: the length of a session.
    session: float = 720.0
    #: Replacement value for what does not move at all, m or m/s or m/s^2.
    no_motion: float = 1e-12


POLICY = ProposalPolicy()
