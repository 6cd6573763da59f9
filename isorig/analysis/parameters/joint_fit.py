"""Parameter table of a rig: a joint fit of all runs with friction in the model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt

import msgspec
import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.equations.forms import fit_start
from isorig.analysis.equations.system import equations_of
from isorig.analysis.fitting.division import refined
from isorig.analysis.fitting.influence import from_smaller_friction, not_identifiable
from isorig.analysis.fitting.ladder import baseline_fit, finished, fit_again
from isorig.analysis.fitting.plausible import Doubt, doubts
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import Score
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.fitting.uncertainty import (
    ANY_SIGN,
    CALIBRATION,
    HEAD,
    assessed,
    stated_floor,
    uncertain_values,
    unseen,
    value_kind,
)
from isorig.analysis.model.parameter_units import physical_parameters, unit_of
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate.natural import natural_modes
from isorig.analysis.spectra.quality import Fault, faults, without
from isorig.analysis.views import Viewed
from isorig.analysis.wording import noise_alone, of_signal

BODIES = (("table", "table"), ("heatblock", "heatblock"), ("motor", "isolation"))
#: Relative step of the derivatives of a mode's frequency and damping, and the relative change below which they are rounding.
SLOPE, ROUNDING = 1e-4, 1e-9
#: Methods of values that are not fitted: given with the recording or its description, or a law's own number that no fit changes.
FIXED = ("given", "held")
WEIGHED, ASSUMED = "weighed", "not in the recording: the thesis's value is assumed"
NO_SLIDING = "not identifiable from these runs; record one in which the contact slides"
NO_TRACE = "not identifiable from these runs; record one that excites it"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A row of the table; `value` is None if it is not identifiable, and `note` gives the reason."""

    value: float | None
    std: float | None
    unit: str
    method: str
    note: str

    @property
    def fixed(self) -> bool:
        """Whether the value was given or held, and not fitted."""
        return self.method in FIXED

    @property
    def uncertainty(self) -> float | None:
        """The standard uncertainty to be shown; None for a value that was given or held without one."""
        return None if self.fixed and not self.std else self.std


@dataclass(frozen=True, kw_only=True)
class Characterization(Viewed):
    """The table by name, its fit, the runs, and the held-out error with the noise floor.

    For the wire bonder the table has its bodies' masses, frequencies and damping ratios; for another rig, and for an extended
    model, the parameters by their paths, and the frequency and damping ratio of the modes of every measured configuration.
    `faults` are faults in the records: runs with faulty channels are not used if their configuration has others. `head_mass` is
    fitted if it is not given. `calibrated` states whether the recording gives the calibration uncertainty of its sensors. `noise`
    is a sentence on noise that is not white or differs between runs, or empty.
    """

    table: dict[str, Entry]
    head_mass: Entry | None
    calibrated: bool
    fit: Fit
    trials: tuple[Trial, ...]
    score: Score
    floor: float
    adequate: bool
    noise: str = ""
    faults: tuple[Fault, ...] = ()
    doubts: tuple[Doubt, ...] = ()

    def __repr__(self) -> str:
        known = sum(entry.value is not None for entry in self.table.values())
        return f"Characterization({known} of {len(self.table)} values, held-out error {of_signal(self.error)})"

    @property
    def error(self) -> float:
        """Held-out error: the median over runs and channels."""
        return self.score.figure

    @property
    def noise_alone(self) -> str:
        """The floor in words."""
        return noise_alone(self.floor)


def fit_baseline(campaign: Campaign, model: RigModel) -> tuple[Fit, tuple[Trial, ...]]:
    """The rig's free parameters fitted to all runs on the finest grid, from their values by the equations, and these runs."""
    trials = prepare(campaign, model)
    fine = tuple(refined(trial) for trial in trials)
    return finished(baseline_fit((fit_start(equations_of(campaign, model)), model), trials), fine), fine


def characterize(
    campaign: Campaign, model: RigModel, *, fitted: Sequence[Free] = (), later: float = 0.0,
    progress: Callable[[str], None] = lambda text: None,
) -> Characterization:  # fmt: skip
    """Fit all free parameters to all runs at once, with standard uncertainties.

    Frequencies are the uncoupled sqrt(k / m) / 2 pi, damping ratios c / (2 sqrt(k m)). Values are corrected for the bias by
    noise in the recorded drive (`DriveNoise`). Standard uncertainties are those of `uncertainty`, of every command. A
    misfit is an error above the white noise of the sensors that is related to the drive or the motion (`depends_on_drive`), or
    above `MOST_NOISE`; other errors are noise. The head's mass is fitted too if the recording does not give it.

    Parameters
    ----------
    campaign
        The measurement; needs locked and unlocked runs for all values.
    model
        The rig with starting values.
    fitted
        For a model that a diagnosis has extended: its fitted parameters. They are fitted again from their values in `model`, and
        all of them are in the table. By default the parameters that the model marks as free are fitted.
    later
        Seconds from the zero of a drifting model to the campaign's first sample.
    progress
        Called with one line for each stage.

    Examples
    --------
    >>> import isorig as iso
    >>> found = iso.characterize(iso.read("campaign.h5"), iso.wire_bonder())
    >>> entry = found.table["motor_frequency"]
    >>> print(f"{entry.value:.2f} {entry.unit}")
    5.06 Hz
    """
    progress("checking for bad data")
    wrong = faults(campaign, reference=model.drive.channel)
    campaign = without(campaign, wrong, model.channels, from_rest=True)
    bonder = is_wire_bonder(model)
    given = dict(campaign.known)
    if bonder and campaign.description is not None:
        # Values that a description does not mark as free are given.
        given |= {f"{body}_mass": model.body(body).mass for body, _ in BODIES}
        given |= {"head_mass": model.drive.factor}
    if bonder and "head_mass" not in given and not fitted:
        model = msgspec.structs.replace(model, free=(*model.free, HEAD))
    progress(f"fitting {len(fitted or model.free)} parameters to all runs")
    rough, fine = fit_again(campaign, model, fitted, later) if fitted else fit_baseline(campaign, model)
    progress("computing the uncertainties")
    final = assessed(from_smaller_friction(rough, fine), fine, campaign.known)
    done = final.fit
    note = f"the model leaves {of_signal(final.misfit)} unexplained; see rig diagnose" if final.misfit else ""
    known = _Known(done, fine, note, uncertain_values(campaign.known, done))
    table = (_bonder_table(known, given) if bonder else {}) | (_table(known) if fitted or not bonder else {})
    return Characterization(
        table=table, head_mass=_mass(known, HEAD, "head_mass", given) if bonder else None,
        calibrated=CALIBRATION in campaign.known, fit=done, trials=fine, score=final.score,
        floor=float(np.median(final.floors)) if final.noise else stated_floor(done.model, fine),
        adequate=final.explained, noise=final.noise, faults=wrong, doubts=doubts(model, (done,), campaign),
    )  # fmt: skip


def is_wire_bonder(model: RigModel) -> bool:
    """Whether a rig has the bodies and links of the wire bonder's table."""
    bodies, links = {body.name for body in model.bodies}, {link.name for link in model.links}
    return all(body in bodies and link in links for body, link in BODIES) and model.drive.quantity == "acceleration"


def _bonder_table(known: _Known, given: Mapping[str, float]) -> dict[str, Entry]:
    table: dict[str, Entry] = {}
    for body, link in BODIES:
        table |= _rows(known, body, link, given)
    path = "contacts.isolation.law.friction_force"
    if path in known.fitted.values:
        table["friction_force"] = known.entry({path: 1.0}, known.fitted.values[path], "N", "friction")
    else:
        table["friction_force"] = Entry(value=None, std=None, unit="N", method="none", note="the model has no friction")
    return table


def _table(known: _Known) -> dict[str, Entry]:
    """The parameters of any rig by their paths, and its modes."""
    fitted = known.fitted
    table = {
        free.path: known.entry({free.path: 1.0}, fitted.model.get(free.path), unit_of(free.path, fitted.model), value_kind(free))
        for free in fitted.free
    }
    for path in physical_parameters(fitted.model):
        if path not in table:
            value, method, std = fitted.model.get(path), "held" if ".law" in path else "given", known.given.get(path, 0.0)
            table[path] = Entry(value=value, std=std, unit=unit_of(path, fitted.model), method=method, note="")
    for configuration in dict.fromkeys(trial.run.configuration for trial in known.trials):
        slopes = _mode_slopes(fitted.model, (*fitted.values, *known.given), configuration)
        for k, mode in enumerate(natural_modes(fitted.model, configuration)):
            # A single configuration needs no name.
            name = f"mode{k + 1}" if len(fitted.model.configurations) == 1 else f"{configuration}.mode{k + 1}"
            table[f"{name}.frequency"] = known.entry(slopes[k][0], mode.frequency, "Hz", "frequency")
            table[f"{name}.damping"] = known.entry(slopes[k][1], mode.damping, "1", "damping")
    return table


def _mode_slopes(model: RigModel, paths: Iterable[str], configuration: str) -> list[tuple[dict[str, float], dict[str, float]]]:
    # Non-zero derivatives of each mode's frequency and damping with respect to the values at paths, by central differences.
    modes = natural_modes(model, configuration)
    slopes: list[tuple[dict[str, float], dict[str, float]]] = [({}, {}) for _ in modes]
    for path in paths:
        value = model.get(path)
        step = SLOPE * abs(value)
        if not step or not path.startswith(("bodies.", "links.", "configurations.")):
            continue
        above, below = (natural_modes(model.replace({path: value + way * step}), configuration) for way in (1.0, -1.0))
        if not len(above) == len(below) == len(modes):
            continue
        for found, mode, high, low in zip(slopes, modes, above, below, strict=True):
            for slope, name in zip(found, ("frequency", "damping"), strict=True):
                change = getattr(high, name) - getattr(low, name)
                if abs(change) > ROUNDING * getattr(mode, name):
                    slope[path] = change / (2.0 * step)
    return slopes


class _Known:
    """Uncertainties of quantities that depend on the fitted values."""

    def __init__(self, fitted: Fit, trials: tuple[Trial, ...], note: str, given: Mapping[str, float]) -> None:
        self.fitted, self.trials, self._note = fitted, trials, note
        self.given = given
        self._order, self._not_identifiable = [free.path for free in fitted.free], not_identifiable(fitted)

    def entry(self, slopes: Mapping[str, float], value: float, unit: str, kind: str) -> Entry:
        """The row of a quantity with derivatives `slopes` with respect to the values at those paths."""
        if self._not_identifiable & slopes.keys():
            note = NO_SLIDING if kind == "friction" else NO_TRACE
            return Entry(value=None, std=None, unit=unit, method="joint fit", note=note)
        slope = np.array([slopes.get(path, 0.0) for path in self._order])
        # A mass treated as known affects the fitted values, and directly a quantity whose formula contains it.
        own = np.array([slopes.get(path, 0.0) * std for path, std in self.given.items()])
        moves = np.zeros_like(own) if self.fitted.known is None else self.fitted.known.given @ slope
        variance = self.fitted.deviation(slope) ** 2 + float(((moves + own) ** 2 - moves**2).sum())
        whole = float(np.hypot(np.sqrt(variance), unseen(value, kind)))
        if value and whole > 0.5 * abs(value) and kind != ANY_SIGN:
            note = self._note or "the data do not determine it"
            return Entry(value=None, std=None, unit=unit, method="joint fit", note=note)
        return Entry(value=value, std=whole, unit=unit, method="joint fit", note=self._note)


def _mass(known: _Known, path: str, name: str, given: Mapping[str, float]) -> Entry:
    mass = known.fitted.model.get(path)
    if path in known.fitted.values:
        return known.entry({path: 1.0}, mass, "kg", "mass")
    note = WEIGHED if name in given else ASSUMED
    return Entry(value=mass, std=known.given.get(path, 0.0), unit="kg", method="given", note=note)


def _rows(known: _Known, body: str, link: str, given: Mapping[str, float]) -> dict[str, Entry]:
    mass, stiffness, damper = paths = (f"bodies.{body}.mass", f"links.{link}.stiffness", f"links.{link}.damping")
    m, k, c = (known.fitted.model.get(path) for path in paths)
    frequency, damping = sqrt(k / m) / (2 * pi), c / (2 * sqrt(k * m))
    return {
        f"{body}_mass": _mass(known, mass, f"{body}_mass", given),
        f"{body}_frequency": known.entry(
            {mass: -0.5 / m * frequency, stiffness: 0.5 / k * frequency}, frequency, "Hz", "frequency"
        ),
        f"{body}_damping": known.entry(
            {mass: -0.5 / m * damping, stiffness: -0.5 / k * damping, damper: damping / c}, damping, "1", "damping"
        ),
    }
