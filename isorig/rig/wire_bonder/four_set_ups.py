"""The thesis's method for the parameters: four set-ups evaluated one by one, and the table by an error surface.

Heatblock from table to heatblock, motor from head to motor, table from head to table, each by half-power and by a modal fit; then
the table's effective mass and damping at the minimum of |measured - simulated| / measured, averaged over frequency (thesis, Eq.
5, Fig. 23). These methods are linear and interpret friction as damping; the joint fit of `joint_fit` is the better estimate.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import Campaign, ComplexArray, FloatArray, Run, broad
from isorig.analysis.errors import AnalysisError, DataError
from isorig.analysis.model.linear import linear_response
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.model.spring import uncoupled_frequency
from isorig.analysis.spectra.half_power import HalfPower, half_power, peaks
from isorig.analysis.spectra.modal_fit import ModalFit, Mode, fit_modes
from isorig.analysis.spectra.welch import Frf, estimate
from isorig.rig.wire_bonder.description import LINKS, wire_bonder

#: Required frequency bins per bandwidth, and minimum segments in a record.
BINS, SEGMENTS = 12.0, 12.0
#: Band for head to motor and head to table, relative to the expected frequencies of motor and table.
LOW_BAND = (0.4, 1.7)
#: Search range of a peak, and band of the heatblock's, relative to the expected frequency.
AROUND = (0.75, 1.35)
#: Points of the error surface in each direction, and redraws of the measured magnitudes for the uncertainty of its minimum.
GRID, DRAWS = 41, 20

Band = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class SetUp:
    """One transfer function and the values determined from it."""

    name: str  #: The body of the natural frequency and damping ratio.
    frf: Frf  #: Measured.
    band: tuple[float, float]  #: The evaluated band, Hz.
    #: Results of the two methods; `fit` is None if not applicable.
    half_power: HalfPower
    fit: ModalFit | None
    refused: str  #: Why there is no fit; empty if there is one.
    mode: Mode | None  #: The better result for this body's mode: from the fit, otherwise from half-power, otherwise None.
    method: str  #: Method of `mode`.


@dataclass(frozen=True, kw_only=True)
class ErrorSurface:
    """Mean relative error of the simulated head-to-table magnitude over table mass and damping (thesis, Eq. 5)."""

    #: Axes: kg and damping ratio.
    mass: FloatArray
    damping: FloatArray
    error: FloatArray  #: Shape (damping, mass).
    best: tuple[float, float, float]  #: (mass, damping ratio, error) at the minimum.
    #: Standard uncertainties of mass and damping ratio due to the error bars of the measured magnitudes.
    std: tuple[float, float]
    #: Hz and magnitudes: the best simulation compared with the measurement.
    frequency: FloatArray
    measured: FloatArray
    simulated: FloatArray


@dataclass(frozen=True, kw_only=True)
class FourSetUps:
    """The four set-ups; `refused` gives by name the values that could not be determined."""

    set_ups: tuple[SetUp, ...]
    surface: ErrorSurface | None
    refused: dict[str, str]


def evaluated_set_ups(campaign: Campaign, model: RigModel) -> FourSetUps:
    """Evaluate the thesis's four set-ups for a campaign of the wire bonder.

    Each set-up needs a run whose drive covers its band; the model has expected frequencies and the known masses.
    """
    guess = {body: uncoupled_frequency(model, link) for body, link in LINKS.items()}
    low = LOW_BAND[0] * guess["motor"], LOW_BAND[1] * guess["table"]
    bands = {"heatblock": (AROUND[0] * guess["heatblock"], AROUND[1] * guess["heatblock"]), "motor": low, "table": low}
    # The band of one peak: halfway to its neighbour.
    middle = float(np.sqrt(guess["motor"] * guess["table"]))
    alone = {"heatblock": bands["heatblock"], "motor": (low[0], middle), "table": (middle, low[1])}
    set_ups: list[SetUp] = []
    refused: dict[str, str] = {}
    for name, band in bands.items():
        runs = broad(campaign.runs if name == "heatblock" else campaign.select(configuration="unlocked"))
        try:
            set_ups.append(_read(name, _reaching(runs, band, name), band, alone[name], guess))
        except AnalysisError as error:
            refused[name] = str(error)
    surface = None
    try:
        surface = error_surface({s.name: s for s in set_ups}, model)
    except AnalysisError as error:
        refused["effective table mass"] = str(error)
    return FourSetUps(set_ups=tuple(set_ups), surface=surface, refused=refused)


def rig_of_set_ups(read: FourSetUps, model: RigModel) -> RigModel:
    """The wire bonder with the determined values; starting values for the others."""
    changes: dict[str, float] = {}
    if read.surface is not None:
        mass = read.surface.best[0]
        changes["bodies.table.mass"] = mass
        changes["links.table.stiffness"] = (2.0 * np.pi * uncoupled_frequency(model, "table")) ** 2 * mass
    for item in read.set_ups:
        mass = changes.get(f"bodies.{item.name}.mass", model.body(item.name).mass)
        if item.mode is not None:
            omega = 2.0 * np.pi * item.mode.frequency
            changes[f"links.{LINKS[item.name]}.stiffness"] = omega**2 * mass
            changes[f"links.{LINKS[item.name]}.damping"] = 2.0 * item.mode.damping * omega * mass
    return model.replace(changes)


def _reaching(runs: list[Run], band: Band, name: str) -> list[Run]:
    # The run with the strongest drive among those that cover the band.
    there = [run for run in runs if run.band is None or (run.band[0] <= band[0] and run.band[1] >= 0.95 * band[1])]
    if not there:
        raise DataError(f"no run excites {band[0]:.3g} to {band[1]:.3g} Hz, which the {name} needs; measure one")
    hardest = max(run.gain for run in there)
    return [run for run in there if run.gain == hardest]


def _read(name: str, runs: list[Run], band: Band, alone: Band, guess: dict[str, float]) -> SetUp:
    reference = "table" if name == "heatblock" else "head"
    seconds = max(run.duration for run in runs)

    def estimated(resolution: float) -> Frf:
        return estimate(runs, references=[reference], channels=[name], resolution=resolution).frf(name, reference)

    # A first estimate gives the bandwidth, the bandwidth determines the resolution.
    coarse = estimated(max(guess[name] / 100.0, SEGMENTS / seconds))
    width = _width(coarse, guess[name], band)
    frf = estimated(max(width / BINS, SEGMENTS / seconds))
    found = half_power(frf, alone)
    fit, reason, mode, method = None, "", found.mode, "half-power"
    try:
        if name == "heatblock":
            inside = [f for f in peaks(frf) if band[0] <= f <= band[1]]
            at = max(inside, key=lambda f: abs(frf.value[np.argmin(np.abs(frf.frequency - f))]), default=guess[name])
            width = 2.0 * found.mode.damping * at if found.mode else width
            reach = (max(band[0], at - 5.0 * width), min(band[1], at + 5.0 * width))
            fit = fit_modes(frf, reach, kind="transmissibility", guesses=[(at, width / (2.0 * at))], residuals=1)
            mode = fit.modes[0]
        else:
            fit = fit_modes(frf, band, kind="general", guesses=[(guess["motor"], 0.1), (guess["table"], 0.03)])
            mode = fit.modes[0 if name == "motor" else 1]
        method = "modal fit" if len(fit.modes) == 1 else "modal fit, two modes"
    except AnalysisError as error:
        reason = str(error)
    return SetUp(name=name, frf=frf, band=band, half_power=found, fit=fit, refused=reason, mode=mode, method=method)


def _width(frf: Frf, guess: float, band: Band) -> float:
    size = np.abs(frf.within((max(band[0], AROUND[0] * guess), min(band[1], AROUND[1] * guess))).value)
    if len(size) < 3:
        raise DataError(f"the records are too short to resolve {guess:.3g} Hz; measure longer")
    return float(max((size >= size.max() / np.sqrt(2.0)).sum() * frf.resolution, 0.5 * frf.resolution))


def error_surface(set_ups: Mapping[str, SetUp], model: RigModel) -> ErrorSurface:
    """The error surface over table mass and damping, with the other values from the set-ups. Raises DataError if a set-up has no
    mode."""
    from scipy.optimize import minimize

    values = {"head_mass": model.drive.factor, "friction_force": 0.0}
    for name in LINKS:
        values[f"{name}_mass"] = model.body(name).mass
        mode = set_ups[name].mode if name in set_ups else None
        if mode is None:
            raise DataError(f"the {name}'s set-up has no mode, which the error surface needs; see the reason there")
        values |= {f"{name}_frequency": mode.frequency, f"{name}_damping": mode.damping}
    table = [sensor.channel for sensor in wire_bonder().sensors].index("table")
    frf = set_ups["table"].frf.within(set_ups["table"].band)
    f, measured, std = frf.frequency, np.abs(frf.value), frf.magnitude_std

    # The table's own mass, spring and damper add to one element of the dynamic stiffness only (Sherman and Morrison 1950).
    s, omega = 2j * np.pi * f, 2.0 * np.pi * values["table_frequency"]
    given = wire_bonder(values, friction=False)
    response, body = linear_response(given, "unlocked", 2.0 * np.pi * f), given.bodies.index(given.body("table"))
    by_head, compliance = response.records[:, table, 0], response.compliance[:, body, body]

    def stiffness(mass: float, zeta: float) -> ComplexArray:
        return np.asarray(mass * (s**2 + 2.0 * zeta * omega * s + omega**2))

    own = stiffness(values["table_mass"], values["table_damping"])

    def simulated(mass: float, zeta: float) -> FloatArray:
        return np.asarray(np.abs(by_head / (1.0 + (stiffness(mass, zeta) - own) * compliance)))

    def off(mass: float, zeta: float, target: FloatArray) -> float:
        return float(np.mean(np.abs(target - simulated(mass, zeta)) / target))

    masses = np.geomspace(20.0, 1.2 * max(values["table_mass"], 100.0), GRID)
    zetas = np.geomspace(0.002, 0.2, GRID)
    error = np.array([[off(m, z, measured) for m in masses] for z in zetas])
    row, column = np.unravel_index(int(np.argmin(error)), error.shape)

    def least(target: FloatArray, start: FloatArray) -> FloatArray:
        def at(place: FloatArray) -> float:
            return off(float(np.exp(place[0])), float(np.exp(place[1])), target)

        solved = minimize(at, start, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7})
        return np.asarray(solved.x, dtype=np.float64)

    best = least(measured, np.log([masses[column], zetas[row]]))
    generator = np.random.default_rng(0)
    drawn = [
        np.exp(least(np.maximum(measured + std * generator.normal(size=len(std)), 0.1 * measured), best)) for _ in range(DRAWS)
    ]
    mass, zeta = (float(v) for v in np.exp(best))
    spread = np.std(drawn, axis=0)
    return ErrorSurface(
        mass=masses, damping=zetas, error=error, best=(mass, zeta, off(mass, zeta, measured)),
        std=(float(spread[0]), float(spread[1])), frequency=f, measured=measured, simulated=simulated(mass, zeta),
    )  # fmt: skip
