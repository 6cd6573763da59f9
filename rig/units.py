"""Units of a model's parameters by the last word of their path."""

from __future__ import annotations

UNITS = {
    "mass": "kg", "factor": "kg", "stiffness": "N/m", "damping": "N s/m", "friction_force": "N", "static_force": "N",
    "stribeck_velocity": "m/s", "bristle_stiffness": "N/m", "forward_force": "N", "backward_force": "N",
    "forward_viscosity": "N s/m", "backward_viscosity": "N s/m", "cubic_stiffness": "N/m^3", "scale": "m",
    "clearance": "m", "stroke": "m", "contact_stiffness": "N/m", "contact_damping": "N s/m",
    "quadratic_damping": "N s^2/m^2", "drift_rate": "1/s", "lock_stiffness": "N/m", "lock_damping": "N s/m",
    "delay": "s", "limit": "m/s^2",
}  # fmt: skip


def unit_of(path: str) -> str:
    """SI unit of the parameter at a dotted path; "1" where it has none."""
    return UNITS.get(path.rsplit(".", maxsplit=1)[-1], "1")
