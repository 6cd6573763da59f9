"""Friction between a body and the ground where the description joins them by nothing: a guide, a rail, a bearing."""

import msgspec

from isorig.analysis.campaign import MOTION
from isorig.analysis.model.rig_model import GROUND, Link, RigModel

#: Damping of a guide that the description does not have, divided by the body's mass, 1/s: a motion lasts hours.
WEAK = 1e-4


def with_guides(model: RigModel) -> RigModel:
    """The rig with a guide without effect at each body whose position is measured and that nothing joins to the ground."""
    ends = [(link.a, link.b) for link in model.links] + [(contact.a, contact.b) for contact in model.contacts]
    joined = {end for pair in ends if GROUND in pair for end in pair}
    driven = {drive.imposes for drive in model.drives}
    measured = {s.body for s in model.sensors if s.relative_to == GROUND and MOTION.get(s.quantity) == 0}
    added = tuple(
        Link(name=guide_of(body.name), a=body.name, damping=WEAK * body.mass)
        for body in model.bodies
        if body.name in measured - joined - driven
    )
    return model if model.free_free or not added else msgspec.structs.replace(model, links=(*model.links, *added))


def guide_of(body: str) -> str:
    """Name of the guide of a body."""
    return f"{body} guide"
