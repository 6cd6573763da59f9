"""Deflections and speeds of a rig's links as additional channels of a simulation."""

from collections.abc import Iterable, Mapping

import msgspec

from isorig.analysis.campaign import Quantity
from isorig.analysis.model.rig_model import Link, RigModel, Sensor

#: Prefixes of the channels of a link's sensors: of its deflection, and of its speed.
DEFLECTION, SPEED = "deflection ", "speed "
#: What they record.
RECORDED: Mapping[str, Quantity] = {DEFLECTION: "displacement", SPEED: "velocity"}


def link_sensors(links: Iterable[Link]) -> tuple[Sensor, ...]:
    """Sensors of the deflection and of the speed of links, as channels `deflection <link>` and `speed <link>`."""
    return tuple(_of_link(link, kind) for link in links for kind in RECORDED)


def gauged(model: RigModel, configuration: str) -> RigModel:
    """The rig with a displacement sensor on every free link, as channels `deflection <link>`."""
    setup = model.configurations[configuration]
    free = [link for link in model.links if link.name not in setup.rigid or setup.lock_stiffness is not None]
    return msgspec.structs.replace(model, sensors=(*model.sensors, *(_of_link(link, DEFLECTION) for link in free)))


def _of_link(link: Link, kind: str) -> Sensor:
    return Sensor(channel=kind + link.name, body=link.a, relative_to=link.b, arms=link.arms, quantity=RECORDED[kind])
