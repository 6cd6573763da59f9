"""A stiffness that drifts with time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Formula

#: Time in s longer than any campaign.
NEVER = 1e18


class Drift(SpringLaw, frozen=True, kw_only=True, tag="drift"):
    """Stiffness k (1 + drift_rate t), drift_rate in 1/s, t from the campaign's first sample, constant after `until` s."""

    drift_rate: float
    until: float | None = None
    parameters: ClassVar[dict[str, Parameter]] = {
        "drift_rate": Parameter("1/s", -0.1, 0.2),
        "until": Parameter("s", 0.5, 2.0),
    }

    def element(self, link: LinkConstants) -> Element:
        until = NEVER if self.until is None else self.until
        return Element(formula=FORMULA, params=(link.stiffness * self.drift_rate, until))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        until = NEVER if self.until is None else self.until
        return np.asarray(link.stiffness * self.drift_rate * np.minimum(t, until) * d)


@kernel
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * min(t, p[1]) * d


FORMULA = Formula(resist=resist)
