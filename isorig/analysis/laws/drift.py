"""A stiffness or a damping that drifts with time."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, curved

#: Time in s longer than any campaign.
NEVER = 1e18


class LinearDrift(SpringLaw, frozen=True, kw_only=True):
    """A constant of a link times drift_rate t, drift_rate in 1/s, t from the campaign's first sample, at most `until` s."""

    drift_rate: Annotated[float, Parameter("1/s", -0.1, 0.2)]
    until: Annotated[float | None, Parameter("s", 0.5, 2.0)] = None

    @property
    def end(self) -> float:
        """Time from which on it is constant, s."""
        return NEVER if self.until is None else self.until


class Drift(LinearDrift, frozen=True, kw_only=True, tag="drift"):
    """Stiffness k (1 + drift_rate t), drift_rate in 1/s, t from the campaign's first sample, constant after `until` s."""

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=pull, params=(link.stiffness * self.drift_rate, self.end))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(link.stiffness * self.drift_rate * np.minimum(t, self.end) * d)


class DampingDrift(LinearDrift, frozen=True, kw_only=True, tag="damping_drift"):
    """Damping c (1 + drift_rate t), drift_rate in 1/s, t from the campaign's first sample, constant after `until` s."""

    def element(self, link: LinkConstants) -> Element:
        rate = link.damping * self.drift_rate
        steepest = 0.0 if self.until is None else abs(rate) * self.until
        return Element(formula=drag, params=(rate, self.end), steepest=(0.0, steepest))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(link.damping * self.drift_rate * np.minimum(t, self.end) * v)


@curved
def pull(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * min(t, p[1]) * d


@curved
def drag(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * min(t, p[1]) * v
