"""Starting values for a fit, directly from the equations of motion.

A link whose removal cuts some bodies off the ground carries their inertia forces and nothing else. Where those bodies have
accelerometers, the link's force is therefore measured, and its stiffness, damping and dry friction (and masses taken as unknown)
follow by linear least squares over the lines of all runs: displacement and velocity are the
acceleration divided by (i omega)^2 and
i omega. Noise biases such values, but they are close enough for a fit on simulation error to converge from them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import GROUND, Link, RigModel, direction
from isorig.analysis.spectra.motion import integrals

ROUNDS = 3
#: A stiffness that differs from the initial value by more than this factor is rejected.
FACTOR = 5.0


def equation_start(model: RigModel, trials: Sequence[Trial]) -> RigModel:
    """The rig with its free masses, stiffnesses, dampings and dry friction forces set from the equations of motion.

    A link whose bodies are not all measured keeps its values.
    """
    sensed = {s.body: s.channel for s in model.sensors if s.quantity == "acceleration" and s.relative_to == GROUND}
    for _ in range(ROUNDS):
        for link in model.links:
            beyond = outboard(model, link)
            if beyond and all(name in sensed for name in (*beyond, *(e for e in (link.a, link.b) if e != GROUND))):
                model = _solve(model, link, beyond, trials, sensed)
    return model


def outboard(model: RigModel, link: Link) -> tuple[str, ...]:
    """The bodies connected by this link only; empty if another path leads from them to ground."""
    joins = [(other.a, other.b) for other in model.links if other.name != link.name]
    reached = {GROUND}
    while True:
        grown = reached | {b for a, b in joins if a in reached} | {a for a, b in joins if b in reached}
        if grown == reached:
            break
        reached = grown
    if link.arms or (link.a in reached) == (link.b in reached):
        return ()
    return tuple(body.name for body in model.bodies if body.name not in reached)


def _solve(model: RigModel, link: Link, beyond: tuple[str, ...], trials: Sequence[Trial], sensed: dict[str, str]) -> RigModel:
    contact = next((c for c in model.contacts if c.name == link.name), None)
    paths = [f"links.{link.name}.stiffness", f"links.{link.name}.damping"]
    if contact is not None:
        paths.append(f"contacts.{link.name}.law.friction_force")
    paths += [f"bodies.{name}.mass" for name in beyond]
    free = [path for path in paths if path in model.free]
    blocks, sides = [], []
    sign = 1.0 if link.a in beyond else -1.0
    slow = 0.0
    for trial in sorted(trials, key=lambda t: -abs(t.run.gain)):
        n, rate = trial.fitted, trial.run.sample_rate
        configuration = model.configurations[trial.run.configuration]
        if n < 256 or link.name in configuration.rigid:
            continue
        frequency = np.fft.rfftfreq(n, 1.0 / rate)
        band = trial.run.band or (0.5, rate / 2.56)
        keep = (frequency > max(1.0, 2.0 * band[0])) & (frequency < min(1.5 * band[1], 0.45 * rate))
        omega = 2j * np.pi * frequency[keep]

        rows = {name: trial.measured[trial.channels.index(channel), :n] for name, channel in sensed.items()}
        weights = direction(model, link.a, link.b, {})
        relative = sum(w * rows[b.name] for w, b in zip(weights, model.bodies, strict=True) if w)
        columns = {
            paths[0]: sign * _lines(relative, keep) / omega**2,
            paths[1]: sign * _lines(relative, keep) / omega,
        }
        if contact is not None:
            velocity, _ = integrals(relative, rate, trial.run.band)
            # Strongest run first: much slower motion is sticking, not sliding.
            slow = max(slow, 0.03 * float(velocity.std()), 1e-12)
            columns[paths[2]] = sign * _lines(np.tanh(velocity / slow), keep)
        for name in beyond:
            columns[f"bodies.{name}.mass"] = _lines(rows[name], keep)
        pushed = sum(model.drive.pushes.get(name, 0.0) for name in beyond)
        side = pushed * model.drive.factor * _lines(trial.excitation.recorded[:n], keep)
        for path in paths:
            if path not in free:
                side = side - model.get(path) * columns[path]
        noise = (
            trial.noise.max()
            * np.sqrt(0.375 * n)
            * (np.abs(link.stiffness / omega**2) + np.abs(link.damping / omega) + sum(model.body(b).mass for b in beyond))
        )
        scale = noise + 0.01 * np.abs(side) + 1e-3 * np.abs(side).max()
        block = np.stack([columns[path] / scale for path in free], axis=1) if free else np.zeros((len(side), 0))
        blocks.append(np.vstack([block.real, block.imag]))
        sides.append(np.concatenate([(side / scale).real, (side / scale).imag]))
    if not blocks or not free:
        return model
    matrix = np.vstack(blocks)
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    solution = np.linalg.lstsq(matrix / size, np.concatenate(sides), rcond=1e-12)[0] / size
    values = dict(zip(free, solution.tolist(), strict=True))
    stiffness = values.get(paths[0], link.stiffness)
    if not link.stiffness / FACTOR < stiffness < link.stiffness * FACTOR:
        return model  # far from the initial value: typical of a sensor fault, and the initial value is better
    return model.replace({path: v for path, v in values.items() if v > 0.0})


def _lines(values: FloatArray, keep: NDArray[np.bool_]) -> ComplexArray:
    return np.asarray(np.fft.rfft(values * np.hanning(len(values)))[keep])
