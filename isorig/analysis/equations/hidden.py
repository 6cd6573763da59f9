"""The motion of bodies without sensors, from that of those around them: their own equations, solved in the frequency domain.

Such a body's equation is used up by this; what its links do to the measured bodies remains testable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.equations.motion import Combinations
from isorig.analysis.model.rig_model import RigModel, matrices


def estimable(model: RigModel) -> tuple[str, ...]:
    """Bodies without sensors whose motion follows from the others': no contact acts on them, no lock holds them.

    Their elements join them to measured bodies, to the ground or to each other, and sensors record no combination of them.
    """
    measured = Combinations(model).measured
    hidden = [body.name for body in model.bodies if body.name not in measured and body.name not in model.imposed]
    touched = {end for contact in model.contacts for end in (contact.a, contact.b, *contact.arms)}
    locked = {name for setup in model.configurations.values() for name in setup.rigid}
    held = {end for link in model.links if link.name in locked for end in (link.a, link.b, *link.arms)}
    mixed = {end for sensor in model.sensors for end in (sensor.body, sensor.relative_to, *sensor.arms)}
    if any(body in touched | held | mixed for body in hidden):
        return ()
    return tuple(hidden)


def estimated(
    model: RigModel, hidden: Sequence[str], accelerations: Mapping[str, FloatArray], drives: Mapping[str, FloatArray], rate: float
) -> dict[str, FloatArray]:
    """Accelerations of bodies without sensors.

    Parameters
    ----------
    model
        The rig with the values of their links and masses.
    hidden
        The bodies.
    accelerations
        Of all other bodies by name, m/s^2, shape (n,).
    drives
        Records of the drives that push bodies, by channel, shape (n,).
    rate
        Hz.
    """
    names = [body.name for body in model.bodies]
    mass, damping, stiffness = matrices(model)
    own, others = [names.index(body) for body in hidden], [names.index(body) for body in accelerations]
    n = len(next(iter(accelerations.values())))
    omega = 2.0 * np.pi * np.fft.rfftfreq(n, 1.0 / rate)
    dynamic = -(omega**2)[:, None, None] * mass + 1j * omega[:, None, None] * damping + stiffness
    side = -np.einsum("fij,jf->fi", dynamic[:, own][:, :, others], np.stack([np.fft.rfft(a) for a in accelerations.values()]))
    for drive in model.drives:
        if drive.imposes is None and drive.channel in drives:
            pushes = np.array([drive.pushes.get(body, 0.0) for body in hidden])
            if np.any(pushes):
                force = drive.factor * np.fft.rfft(drives[drive.channel])
                side -= (omega**2 * force)[:, None] * pushes
    inner = dynamic[:, own][:, :, own]
    found = np.linalg.solve(inner, side[:, :, None])[:, :, 0]
    return {body: np.fft.irfft(found[:, k], n) for k, body in enumerate(hidden)}
