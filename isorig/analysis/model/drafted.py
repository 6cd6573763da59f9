"""The placeholders of a drafted description: values that say nothing about a rig until they are corrected."""

from isorig.analysis.model.rig_model import RigModel

#: Mass (kg, kg m^2), stiffness (N/m, N m/rad) and damping (N s/m, N m s/rad) that a draft gives every body and link.
MASS, STIFFNESS, DAMPING = 1.0, 1000.0, 1.0


def drafted(model: RigModel) -> tuple[str, ...]:
    """The bodies and links of a description that still have a draft's values.

    One mass, or one stiffness, may be a round number; a draft has all masses, and the stiffness and the damping of a link.
    """
    masses = [body for body in model.bodies if body.name not in model.imposed]
    links = [link.name for link in model.links if (link.stiffness, link.damping) == (STIFFNESS, DAMPING)]
    whole = all(body.mass == MASS for body in masses) and (links or len(masses) > 1)
    return (*(body.name for body in masses if whole), *links)
