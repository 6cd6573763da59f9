"""A damping that drifts with time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.drift import NEVER
from isorig.analysis.laws.elements import Element, Formula


class DampingDrift(SpringLaw, frozen=True, kw_only=True, tag="damping_drift"):
    """Damping c (1 + drift_rate t), drift_rate in 1/s, t from the campaign's first sample, constant after `until` s."""

    drift_rate: float
    until: float | None = None
    parameters: ClassVar[dict[str, Parameter]] = {
        "drift_rate": Parameter("1/s", -0.1, 0.2),
        "until": Parameter("s", 0.5, 2.0),
    }

    def element(self, link: LinkConstants) -> Element:
        rate, until = link.damping * self.drift_rate, NEVER if self.until is None else self.until
        steepest = 0.0 if self.until is None else abs(rate) * self.until
        return Element(formula=FORMULA, params=(rate, until), steepest=(0.0, steepest))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        until = NEVER if self.until is None else self.until
        return np.asarray(link.damping * self.drift_rate * np.minimum(t, until) * v)


@kernel
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * min(t, p[1]) * v


FORMULA = Formula(resist=resist)
