"""Units of a model's parameters by the last word of their path."""

from __future__ import annotations

from isorig.analysis.laws import LAWS

#: Of the parts of a rig that are no laws, and of every law's parameters.
UNITS = {
    "mass": "kg", "factor": "kg", "stiffness": "N/m", "damping": "N s/m", "lock_stiffness": "N/m", "lock_damping": "N s/m",
    "delay": "s", "limit": "m/s^2", **{name: p.unit for law in LAWS for name, p in law.parameters.items()},
}  # fmt: skip


def unit_of(path: str) -> str:
    """SI unit of the parameter at a dotted path; "1" where it has none."""
    return UNITS.get(path.rsplit(".", maxsplit=1)[-1], "1")
