"""Deflections of a rig's links as additional channels of a simulation."""

from __future__ import annotations

import msgspec

from isorig.analysis.model.rig_model import GROUND, RigModel, Sensor

#: Prefix of the channel of a link's displacement sensor.
DEFLECTION = "deflection "


def gauged(model: RigModel, configuration: str) -> RigModel:
    """The rig with a displacement sensor on every free link, as channels `deflection <link>`."""
    setup = model.configurations[configuration]
    free = [link for link in model.links if link.name not in setup.rigid or setup.lock_stiffness is not None]
    gauges = []
    for link in free:
        body, other = (link.a, link.b) if link.a != GROUND else (link.b, link.a)
        sign = 1.0 if link.a != GROUND else -1.0
        arms = {name: sign * factor for name, factor in link.arms.items()}
        gauges.append(
            Sensor(channel=f"{DEFLECTION}{link.name}", body=body, relative_to=other, quantity="displacement", arms=arms)
        )
    return msgspec.structs.replace(model, sensors=(*model.sensors, *gauges))
