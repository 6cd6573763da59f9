"""Compiles and caches all kernels, so that no command waits for it: `python -m isorig.rig.virtual.compile_kernels`."""

import numpy as np

from isorig.analysis.equations.slip import slip_operator
from isorig.analysis.laws import BoucWen, Dahl, ElastoSlip, LuGre, Maxwell, StiffeningHysteresis
from isorig.analysis.simulate.batch import scan
from isorig.analysis.simulate.curves import load_laws
from isorig.analysis.simulate.sampling import Excitation
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

#: Laws with a kernel for their force along a recorded motion.
ALONG_MOTIONS = (
    BoucWen(friction_force=1.0, initial_stiffness=1.0), Dahl(friction_force=1.0, bristle_stiffness=1.0),
    ElastoSlip(slip_force=1.0, spring_stiffness=1.0),
    LuGre(friction_force=1.0, static_force=1.0, bristle_stiffness=1.0, stribeck_velocity=1.0),
    Maxwell(relaxation_stiffness=1.0, relaxation_time=1.0),
    StiffeningHysteresis(initial_stiffness=1.0, stiffening=1.0, dissipation=1.0),
)  # fmt: skip


def main() -> None:
    """Simulate one second of the built-in rig, alone and in a batch, and what follows from recorded motions."""
    from isorig.rig.wire_bonder.description import wire_bonder

    model = wire_bonder()
    virtual_campaign(model, [VirtualRun(id="warm", configuration="unlocked", gain=70.0, seconds=1.0, start=0.0)])
    load_laws()
    drive = Excitation.prepare(np.zeros(1024), 1024.0, oversample=1)
    scan([model, model], drive, lambda seen: next(iter(seen.values()))[:, 0])
    still = np.zeros(8)
    slip_operator(still, 1.0)
    for law in ALONG_MOTIONS:
        law.along(still, still, 1.0)


if __name__ == "__main__":
    main()
