"""Forms started from a fitted free shape: each is fitted to its curve first, without simulation."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress

import numpy as np

from isorig.analysis.diagnose.causes import proposed
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.diagnose.step import Curve, Entry
from isorig.analysis.equations.balances import elements
from isorig.analysis.equations.forms import ElementForce, fitted_form
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.ladder import Starts
from isorig.analysis.fitting.solve import Fit

#: Points of the curve that a form is fitted to. Chosen: ten between two of the densest curve's.
POINTS = 500


def starts_from_curve(
    shape: Entry, curve: Curve, current: Fit, evidence: Evidence, known: Collection[tuple[str, str]]
) -> Starts:  # fmt: skip
    """Starting points of the forms of a free shape's kind at its place, with the values that come closest to its curve.

    Parameters
    ----------
    shape, curve
        The fitted free shape and its curve, over deflection or speed; curves over other quantities give no starting points.
    current
        The model without the shape.
    evidence
        What the records show.
    known
        Cause and place of the forms that have been fitted.
    """
    place = shape.candidate.location
    element = next((element for element in elements(current.model) if place in element.names), None)
    if element is None or curve.over not in ("deflection", "speed"):
        return []
    x, y, _ = np.array(curve.points).T
    at, still = np.linspace(*curve.reached, POINTS), np.zeros(POINTS)
    d, v = (still, at) if curve.over == "speed" else (at, still)
    force = ElementForce(deflection=d, velocity=v, time=still, force=np.interp(at, x, y), left=still, motions=(), rate=1.0)
    starts: Starts = []
    for candidate in proposed(current.model, evidence):
        if (kind_of(candidate.cause), candidate.location) != shape.place or candidate.key in known:
            continue
        free, own = candidate.parameters(current.model, current.free), {f.path for f in candidate.free}
        with_shape = {f.path for f in shape.fit.free}
        for start in candidate.starts:
            with suppress(ModelError):  # values that exclude the form's own
                values = {f.path: shape.fit.model.get(f.path) for f in free if f.path in with_shape - own}
                model = start.replace(values)
                fitted = fitted_form(model, free, element, force)
                if fitted is not None:
                    starts.append((candidate, free, model.replace(fitted.values)))
    return starts
