"""The motion of bodies without sensors, from that of those around them: their own equations, solved in the frequency domain.

Such a body's equation is used up by this, and the values in it are those with which most other equations hold; what its links do
to the measured bodies remains testable.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.equations.motion import Combinations
from isorig.analysis.model.rig_model import RigModel, matrices

#: Largest factor between a value that determines the motion of a body without a sensor and the given one, and iterations of its
#: search.
WITHIN, ITERATIONS = 3.0, 15


def estimable(model: RigModel) -> tuple[str, ...]:
    """Bodies without sensors whose motion follows from the others': no contact acts on them, no lock holds them.

    Their elements join them to measured bodies, to the ground or to each other, and sensors record no combination of them.
    """
    measured = Combinations(model).measured
    hidden = [body.name for body in model.bodies if body.name not in measured and body.name not in model.imposed]
    touched = {end for contact in model.contacts for end in contact.joined}
    locked = {name for setup in model.configurations.values() for name in setup.rigid}
    held = {end for link in model.links if link.name in locked for end in link.joined}
    mixed = {end for sensor in model.sensors for end in (sensor.body, sensor.relative_to, *sensor.arms)}
    if any(body in touched | held | mixed for body in hidden):
        return ()
    return tuple(hidden)


def estimated(
    model: RigModel, hidden: Sequence[str], accelerations: Mapping[str, FloatArray], drives: Mapping[str, FloatArray], rate: float
) -> dict[str, FloatArray]:
    """Accelerations of bodies without sensors, by those of all others (m/s^2) and the records of drives, each of shape (n,)."""
    n = len(next(iter(accelerations.values())))
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(n, 1.0 / rate), dtype=np.float64)
    of_bodies, of_drives = transfer(model, hidden, tuple(accelerations), omega)
    found = np.einsum("fij,jf->fi", of_bodies, np.stack([np.fft.rfft(a) for a in accelerations.values()]))
    for channel, gain in of_drives.items():
        found += gain * np.fft.rfft(drives[channel])[:, None]
    return {body: np.fft.irfft(found[:, k], n) for k, body in enumerate(hidden)}


def transfer(
    model: RigModel, hidden: Sequence[str], others: Sequence[str], omega: FloatArray
) -> tuple[ComplexArray, dict[str, ComplexArray]]:
    """Accelerations of bodies without sensors per acceleration of the others, and per unit of each drive that pushes them.

    Parameters
    ----------
    model, hidden
        As in `estimated`.
    others
        All other bodies.
    omega
        rad/s, shape (n,).

    Returns
    -------
    tuple
        Shape (n, hidden, others), and (n, hidden) by channel.
    """
    names = [body.name for body in model.bodies]
    mass, damping, stiffness = matrices(model)
    own, rest = [names.index(body) for body in hidden], [names.index(body) for body in others]
    dynamic = -(omega**2)[:, None, None] * mass + 1j * omega[:, None, None] * damping + stiffness
    inner = dynamic[:, own][:, :, own]
    of_drives: dict[str, ComplexArray] = {}
    for drive in model.drives:
        pushes = np.array([drive.pushes.get(body, 0.0) for body in hidden])
        if drive.imposes is None and np.any(pushes):
            side = -drive.factor * (omega**2)[:, None, None] * pushes[:, None]
            of_drives[drive.channel] = np.asarray(np.linalg.solve(inner, side)[:, :, 0], dtype=np.complex128)
    return np.asarray(-np.linalg.solve(inner, dynamic[:, own][:, :, rest]), dtype=np.complex128), of_drives


def adjacent(model: RigModel, hidden: Sequence[str]) -> tuple[str, ...]:
    """Paths of the free parameters on which the motion of the bodies without sensors depends."""
    links = {link.name for link in model.links if link.joined & set(hidden)}
    paths = [f"links.{name}.{what}" for name in sorted(links) for what in ("stiffness", "damping")]
    return tuple(path for path in [*paths, *(f"bodies.{body}.mass" for body in hidden)] if path in model.free)


def fitted(model: RigModel, paths: Sequence[str], left: Callable[[RigModel], float]) -> RigModel:
    """The rig with those values of these parameters that leave least, within a factor `WITHIN` of the given ones."""
    from scipy.optimize import minimize

    if not paths:
        return model
    given = np.log([model.get(path) for path in paths])
    most = float(np.log(WITHIN))

    def with_values(logs: FloatArray) -> RigModel:
        return model.replace(dict(zip(paths, np.exp(given + logs).tolist(), strict=True)))

    def cost(logs: FloatArray) -> float:
        return left(with_values(logs))

    done = minimize(
        cost, np.zeros(len(paths)), method="L-BFGS-B", bounds=[(-most, most)] * len(paths),
        options={"maxiter": ITERATIONS, "eps": 1e-3},
    )  # fmt: skip
    return with_values(done.x)
