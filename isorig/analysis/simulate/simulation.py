"""Free-run simulation: the sensors' response of a rig to a drive, and on request what happens inside the rig.

These are the forces of contacts and links, and the times at which contacts stick and slide.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.given import all_of_type, finite, flag, given_mapping, number, of_type, whole
from isorig.analysis.laws.base import NO_LINK
from isorig.analysis.model.linear import imposed_coordinates, linear_part
from isorig.analysis.model.rig_model import GROUND, Contact, Link, RigModel, direction, given_configuration, given_rig, weights_of
from isorig.analysis.simulate.compiled import Compiled, compile_rig
from isorig.analysis.simulate.free_run import NOWHERE, Response, imposed_start, response_of, run_rig, sense_of, true_fine
from isorig.analysis.simulate.sampling import TAPS, Excitation, sampled

#: Direction of sliding in the states of a contact: sticking, then forward and backward; Karnopp's law has two states for each.
WAYS = (0, 1, -1, 1, -1)
#: Memory added for changes of state whenever the log is full.
ROOM = 10_000


@dataclass(frozen=True, kw_only=True)
class Change:
    """A change of state of a contact."""

    time: float  #: Seconds from the drive's first sample, located to rounding error.
    contact: str  #: Name of the contact.
    slides: int  #: 0 if it sticks from now on, 1 if it slides forward (a relative to b), -1 backward.


@dataclass(frozen=True, kw_only=True)
class Trace:
    """A simulated run with its internal quantities.

    Parameters
    ----------
    response
        The sensors' signals.
    friction
        Force by which each contact resists the motion of its body a, N, low-pass filtered and decimated like a sensor's record,
        by contact; shape (n,).
    held
        Share of each sample's interval in which the contact sticks, by contact, shape (n,).
    transmitted
        Force that passes through each link with its laws and the contacts between the same two ends, from body a to body
        b, N, by link; shape (n,).
    changes
        All changes between sticking and sliding in order. Laws that never stick have none.
    """

    response: Response
    friction: dict[str, FloatArray]
    held: dict[str, FloatArray]
    transmitted: dict[str, FloatArray]
    changes: tuple[Change, ...]

    def __repr__(self) -> str:
        forces = ", ".join((*self.transmitted, *(f"friction of {name}" for name in self.friction)))
        return f"Trace({self.response!r}, forces of {forces}; {len(self.changes)} changes of sticking)"


def simulate(
    model: RigModel, excitation: Excitation, *, configuration: str | None = None, start_time: float = 0.0,
    as_recorded: bool = False, samples: int | None = None, start: Mapping[str, tuple[float, float]] = NOWHERE,
) -> Response:  # fmt: skip
    """Simulate the rig from rest, or from an initial state.

    Parameters
    ----------
    model
        The rig.
    excitation
        The drive channel as recorded; offset, gain and delay of its chain are corrected.
    configuration
        Configuration of the rig; its first one if None.
    start_time
        Seconds since the start of the campaign, for a stiffness that drifts.
    as_recorded
        Whether the faults of the sensors' chains are included.
    samples
        Number of samples; all if None.
    start
        Initial position (m) and velocity (m/s) of bodies, instead of the initial state of the configuration.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    SimulationError
        If the motion grows without bound.

    Examples
    --------
    >>> import numpy as np
    >>> import isorig as iso
    >>> drive = iso.Excitation.prepare(3.0 * np.random.default_rng(0).normal(size=2048), 1024.0)
    >>> response = iso.simulate(iso.wire_bonder(), drive, configuration="locked")
    >>> sorted(response.channels), response.channels["table"].shape
    (['heatblock', 'motor', 'table'], (2048,))
    """
    model = given_rig(model)
    of_type(excitation, Excitation, "the drive", "an iso.Excitation; give iso.Excitation.prepare(VALUES, SAMPLE_RATE)")
    configuration = given_configuration(model, configuration)
    start_time, as_recorded = finite(start_time, "the start time"), flag(as_recorded, "the argument as_recorded")
    samples = None if samples is None else whole(samples, "the number of samples", 0, len(excitation.recorded))
    _check_start(model, start)
    n, h = len(excitation.recorded) if samples is None else samples, excitation.step
    total = min((n + 2 * TAPS) * excitation.oversample, len(excitation.fine))
    sense = sense_of(model, compile_rig(model, configuration, h).basis)
    if any(sensor.force_in is not None for sensor in model.sensors):
        inside = _run(model, excitation, configuration, start_time, total, start)
        return _response(model, excitation, inside, configuration, n, as_recorded=as_recorded)
    motion = np.empty((len(model.sensors), total))
    fine, begun = true_fine(model, excitation)[:, :total], {**start, **imposed_start(model, excitation)}
    run_rig(model, configuration, fine, h, start_time, sense, motion, begun=begun)
    return response_of(model, excitation, motion, n, as_recorded=as_recorded)


def _check_start(model: RigModel, start: Mapping[str, tuple[float, float]]) -> None:
    allowed = "a mapping of bodies to (position, velocity); give for example {BODY: (1e-3, 0.0)}"
    for name, state in given_mapping(start, "the argument start", allowed).items():
        model.body(name)
        values = [
            number(each, f"the initial state of {name!r}") for each in all_of_type(state, object, "the argument start", allowed)
        ]
        if len(values) != 2:
            raise ModelError(
                f"the initial state of {name!r} has {len(values)} numbers, but a position and a velocity; correct it"
            )


def trace(
    model: RigModel, excitation: Excitation, *, configuration: str | None = None, start_time: float = 0.0,
    as_recorded: bool = False,
) -> Trace:  # fmt: skip
    """Simulate the rig from rest with its internal forces; parameters and errors as for `simulate`.

    Examples
    --------
    >>> import numpy as np
    >>> import isorig as iso
    >>> drive = iso.Excitation.prepare(0.1 * np.random.default_rng(0).normal(size=2048), 1024.0)
    >>> inside = iso.trace(iso.wire_bonder(), drive)
    >>> bool(inside.held["isolation"].min() == 1.0)  # friction holds the motor all the time
    True
    """
    model = given_rig(model)
    of_type(excitation, Excitation, "the drive", "an iso.Excitation; give iso.Excitation.prepare(VALUES, SAMPLE_RATE)")
    configuration = given_configuration(model, configuration)
    start_time, as_recorded = finite(start_time, "the start time"), flag(as_recorded, "the argument as_recorded")
    over, n = excitation.oversample, len(excitation.recorded)
    inside = _run(model, excitation, configuration, start_time, len(excitation.fine))
    compiled = inside.compiled

    def smooth(values: FloatArray) -> FloatArray:
        return sampled(values, over, n, excitation.step, differentiate=False)

    contacts = {name: k for k, (name, rubs) in enumerate(zip(compiled.elements, compiled.rubs, strict=True)) if rubs}
    held = {
        name: compiled.holds[inside.modes, k].astype(np.float64).reshape(n, over).mean(axis=1) for name, k in contacts.items()
    }
    return Trace(
        response=_response(model, excitation, inside, configuration, n, as_recorded=as_recorded),
        friction={name: smooth(inside.forces[k]) for name, k in contacts.items()},
        held=held,
        transmitted={
            link.name: smooth(_through(model, inside, link, configuration))
            for link in model.links
            if link.name not in model.configurations[configuration].rigid
        },
        changes=tuple(
            Change(time=float(time) - start_time, contact=compiled.elements[int(k)], slides=WAYS[int(state)])
            for time, k, state in inside.log
            if compiled.rubs[int(k)]
        ),
    )


@dataclass(frozen=True, kw_only=True)
class _Inside:
    # Internal quantities of a run on the fine grid: coordinates and speeds, drives, forces of the elements, modes.
    compiled: Compiled
    drives: FloatArray
    states: FloatArray
    forces: FloatArray
    modes: IntArray
    log: FloatArray
    step: float


def _run(
    model: RigModel, excitation: Excitation, configuration: str, start_time: float, total: int,
    start: Mapping[str, tuple[float, float]] = NOWHERE,
) -> _Inside:  # fmt: skip
    h = excitation.step
    compiled = compile_rig(model, configuration, h)
    order, curves = compiled.basis.shape[1], len(compiled.rig.codes)
    u = true_fine(model, excitation)[:, :total]
    steps = u.shape[1]
    states, curved = np.zeros((2 * order, steps)), np.zeros((curves, steps))
    modes = np.zeros(steps, dtype=np.int64)
    log = np.zeros((0, 3))
    begun = {**start, **imposed_start(model, excitation)}
    while True:
        changes, compiled = run_rig(
            model, configuration, u, h, start_time, np.eye(2 * order), states, begun=begun, curved=curved, modes=modes, log=log,
        )  # fmt: skip
        if changes <= len(log):
            break
        log = np.zeros((changes + ROOM, 3))
    y = np.zeros((compiled.resistance.shape[2], steps))
    y[: 2 * order] = states
    y[order : 2 * order] *= h / compiled.cuts
    y[2 * order], y[2 * order + 1] = 1.0, u[0]
    for place in range(curves):
        y[2 * order + 3 + 3 * place] = curved[place]
    y[len(y) - 2 * (len(u) - 1) :: 2] = u[1:]
    forces = np.zeros((len(compiled.elements), steps))
    for mode in np.unique(modes):
        inside = modes == mode
        forces[:, inside] = compiled.resistance[mode] @ y[:, inside]
    for k in (k for k, rubs in enumerate(compiled.rubs) if rubs):
        _in_time(forces[k], (log[:changes][log[:changes, 1] == k, 0] - start_time) / h)
    return _Inside(compiled=compiled, drives=u, states=states, forces=forces, modes=modes, log=log[:changes], step=h)


def _motion(inside: _Inside, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    # Elongation and its speed along a direction on the bodies.
    order = inside.compiled.basis.shape[1]
    row = w @ inside.compiled.basis
    return row @ inside.states[:order], row @ inside.states[order:]


def _element_force(model: RigModel, inside: _Inside, part: Link | Contact) -> FloatArray:
    """The force of a link's laws or of a contact; if both ends are imposed, it is computed from the imposed motions."""
    compiled, rubs = inside.compiled, isinstance(part, Contact)
    own = [k for k, name in enumerate(compiled.elements) if name == part.name and compiled.rubs[k] == rubs]
    force = np.zeros(inside.states.shape[1])
    for k in own:
        force = force + inside.forces[k]
    if not own and len(model.imposed):
        d, v = _motion(inside, weights_of(model, part))
        if np.ptp(d) > 0.0:
            for law in (part.law,) if isinstance(part, Contact) else part.laws:
                constants = NO_LINK if isinstance(part, Contact) else model.constants_of(part)
                force = force + law.along(d, v, 1.0 / inside.step, constants)
    return force


def _through(model: RigModel, inside: _Inside, link: Link, configuration: str) -> FloatArray:
    # Force from a to b through the link, its laws and the contacts between the same two ends.
    d, v = _motion(inside, weights_of(model, link))
    force = link.stiffness * d + link.damping * v + _element_force(model, inside, link)
    blocked = model.configurations[configuration].rigid
    for contact in model.contacts:
        if (contact.a, contact.b) == (link.a, link.b) and contact.name not in blocked:
            force = force + _element_force(model, inside, contact)
    return force


def _imposing(model: RigModel, inside: _Inside, which: int, configuration: str) -> FloatArray:
    # Force that imposes a motion: the inertial force of the body plus resistance of all joints minus forces of other drives.
    drive = model.drives[which]
    basis, mass, damping, stiffness = linear_part(model, configuration)
    order = basis.shape[1]
    name = str(drive.imposes)
    place = imposed_coordinates(model, basis)[name]
    row = basis[:, place]
    x, v = basis @ inside.states[:order], basis @ inside.states[order:]
    acceleration = np.gradient(v, inside.step, axis=1)
    force = row @ (mass @ acceleration + damping @ v + stiffness @ x)
    blocked = model.configurations[configuration].rigid
    for part in model.joints:
        weight = float(weights_of(model, part) @ row)
        if weight and part.name not in blocked and (isinstance(part, Contact) or part.laws):
            force = force + weight * _element_force(model, inside, part)
    for other, values in zip(model.drives, inside.drives, strict=True):
        for body, factor in other.pushes.items():
            force = force - float(direction(model, body, GROUND, {}) @ row) * factor * other.factor * values
    return np.asarray(force)


def _force(model: RigModel, inside: _Inside, configuration: str, what: str) -> FloatArray:
    kind, name = what.split(".", 1)
    if kind == "contacts":
        if name in model.configurations[configuration].rigid:
            return np.zeros(inside.states.shape[1])
        return _element_force(model, inside, model.contact(name))
    if kind == "links":
        if name in model.configurations[configuration].rigid:
            raise SimulationError(
                f"the force in link {name!r} is recorded, but configuration {configuration!r} blocks it, and the force in "
                "a perfect lock is not simulated; give the lock a stiffness or remove the sensor"
            )
        return _through(model, inside, model.link(name), configuration)
    which = next(k for k, drive in enumerate(model.drives) if drive.channel == name)
    return _imposing(model, inside, which, configuration)


def _response(
    model: RigModel, excitation: Excitation, inside: _Inside, configuration: str, n: int, *, as_recorded: bool
) -> Response:
    motion = np.asarray(sense_of(model, inside.compiled.basis) @ inside.states)
    for k, sensor in enumerate(model.sensors):
        if sensor.force_in is not None:
            motion[k] = _force(model, inside, configuration, sensor.force_in)
    return response_of(model, excitation, motion, n, as_recorded=as_recorded)


def _in_time(values: FloatArray, changes: FloatArray) -> None:
    # Correct the samples for the time of a jump between two grid points, which would otherwise count as half-way.
    first = np.minimum(changes.astype(np.int64), len(values) - 2)
    late = changes - first - 0.5
    np.add.at(values, first + (late > 0.0), (values[first] - values[first + 1]) * late)
