"""What goes on inside a free run: the forces of contacts and links, and when each contact holds and slides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.rig_model import RigModel, direction
from isorig.analysis.simulate.compiled import compile_rig
from isorig.analysis.simulate.free_run import Response, response_of, run_rig, sense_of, true_fine
from isorig.analysis.simulate.sampling import Excitation, sampled

#: Changes of state that are kept per second at least; the room for them grows as needed.
ROOM = 10_000


@dataclass(frozen=True, kw_only=True)
class Change:
    """A contact changes its state.

    Parameters
    ----------
    time
        Seconds from the drive's first sample, located to rounding.
    contact
        Its name.
    slides
        0 where it holds from now on, 1 where it slides forward (a against b), -1 backward.
    """

    time: float
    contact: str
    slides: int


@dataclass(frozen=True, kw_only=True)
class Trace:
    """A free run with what goes on inside.

    Parameters
    ----------
    response
        What the sensors would say.
    friction
        Force with which each contact resists the motion of its body a, N, low-passed and decimated as a sensor's record,
        by contact; shape (n,).
    held
        Share of each sample's interval in which the contact holds, by contact, shape (n,).
    transmitted
        Force that passes through each link with its laws and the contacts between the same two ends, from body a to body
        b, N, by link; shape (n,).
    changes
        Every stick and slip in order. Laws that never hold have none.
    """

    response: Response
    friction: dict[str, FloatArray]
    held: dict[str, FloatArray]
    transmitted: dict[str, FloatArray]
    changes: tuple[Change, ...]


def trace(
    model: RigModel,
    excitation: Excitation,
    *,
    configuration: str = "unlocked",
    start_time: float = 0.0,
    as_recorded: bool = False,
) -> Trace:
    """The rig's free run from rest with the forces inside; parameters and errors as of `simulate`.

    Examples
    --------
    >>> import numpy as np
    >>> import isorig as iso
    >>> drive = iso.Excitation.prepare(0.1 * np.random.default_rng(0).normal(size=2048), 1024.0)
    >>> inside = iso.trace(iso.wire_bonder(), drive)
    >>> bool(inside.held["isolation"].min() == 1.0)  # friction holds the motor all the time
    True
    """
    rate, over, n = excitation.sample_rate, excitation.oversample, len(excitation.recorded)
    h = 1.0 / (rate * over)
    compiled = compile_rig(model, configuration, h)
    order, curves = compiled.basis.shape[1], len(compiled.codes)
    u = true_fine(model, excitation)
    states, curved = np.zeros((2 * order, len(u))), np.zeros((curves, len(u)))
    modes = np.zeros(len(u), dtype=np.int64)
    log = np.zeros((0, 3))
    while True:
        changes, compiled = run_rig(
            model, configuration, u, h, start_time, np.eye(2 * order), states, curved=curved, modes=modes, log=log
        )  # fmt: skip
        if changes <= len(log):
            break
        log = np.zeros((changes + ROOM, 3))
    y = np.zeros((compiled.resistance.shape[2], len(u)))
    y[: 2 * order] = states
    y[order : 2 * order] *= h / compiled.cuts
    y[2 * order], y[2 * order + 1] = 1.0, u
    for place in range(curves):
        y[2 * order + 3 + 3 * place] = curved[place]
    forces = np.zeros((len(compiled.elements), len(u)))
    for mode in np.unique(modes):
        inside = modes == mode
        forces[:, inside] = compiled.resistance[mode] @ y[:, inside]
    holds = compiled.holds[modes].T.astype(np.float64)
    for k in (k for k, rubs in enumerate(compiled.rubs) if rubs):
        placed = (log[:changes][log[:changes, 1] == k, 0] - start_time) / h
        _in_time(forces[k], placed)
        _in_time(holds[k], placed)

    def smooth(values: FloatArray) -> FloatArray:
        return sampled(values, over, n, h, differentiate=False)

    contacts = {name: k for k, (name, rubs) in enumerate(zip(compiled.elements, compiled.rubs, strict=True)) if rubs}
    blocked = model.configurations[configuration].rigid
    transmitted = {}
    for link in model.links:
        if link.name in blocked:
            continue
        w = direction(model, link.a, link.b, link.arms) @ compiled.basis
        force = link.stiffness * (w @ states[:order]) + link.damping * (w @ states[order:])
        beside = {contact.name for contact in model.contacts if (contact.a, contact.b) == (link.a, link.b)}
        for k, name in enumerate(compiled.elements):
            if name in beside if compiled.rubs[k] else name == link.name:
                force = force + forces[k]
        transmitted[link.name] = smooth(force)
    return Trace(
        response=response_of(model, excitation, sense_of(model, compiled) @ states, n, as_recorded=as_recorded),
        friction={name: smooth(forces[k]) for name, k in contacts.items()},
        held={name: compiled.holds[modes, k].astype(np.float64).reshape(n, over).mean(axis=1) for name, k in contacts.items()},
        transmitted=transmitted,
        changes=tuple(
            Change(time=float(time) - start_time, contact=compiled.elements[int(k)], slides=_way(int(state)))
            for time, k, state in log[:changes]
            if compiled.rubs[int(k)]
        ),
    )


def _in_time(values: FloatArray, changes: FloatArray) -> None:
    # A jump between two points of the grid counts from its moment on, not from the middle between the points.
    first = np.minimum(changes.astype(np.int64), len(values) - 2)
    late = changes - first - 0.5
    np.add.at(values, first + (late > 0.0), (values[first] - values[first + 1]) * late)


def _way(state: int) -> int:
    # Of a contact: held, then forward and backward in turns.
    return 0 if state == 0 else 1 if state % 2 == 1 else -1
