"""Forms started from a fitted free shape: each is fitted to its curve first, without simulation."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress

import numpy as np

from isorig.analysis.diagnose.causes import GENERALIZED, proposed
from isorig.analysis.diagnose.causes.base import Evidence, Kind
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.diagnose.step import Curve
from isorig.analysis.equations.balances import elements
from isorig.analysis.equations.forms import ElementForce, fitted_form
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import Starts
from isorig.analysis.fitting.solve import Fit
from isorig.analysis.model.rig_model import RigModel

#: Points of the curve that a form is fitted to. Chosen: ten between two of the densest curve's.
POINTS = 500


def starts_from_curve(
    shape: Candidate, fitted: Fit, curve: Curve, current: Fit, evidence: Evidence, known: Collection[tuple[str, str]]
) -> Starts:  # fmt: skip
    """Starting points of the forms of a free shape's kind at its place, with the values that come closest to its curve.

    Parameters
    ----------
    shape, fitted, curve
        The free shape, its fit and its curve, over deflection or speed; curves over other quantities give no starting points.
    current
        The model without the shape.
    evidence
        What the records show.
    known
        Cause and place of the forms that have been fitted.
    """
    place = shape.location
    element = next((element for element in elements(current.model) if place in element.names), None)
    if element is None or curve.over not in ("deflection", "speed"):
        return []
    x, y, _ = np.array(curve.points).T
    at, still = np.linspace(*curve.reached, POINTS), np.zeros(POINTS)
    d, v = (still, at) if curve.over == "speed" else (at, still)
    values = np.interp(at, x, y)
    if kind_of(shape.cause) == "friction_shape":  # the curve shows levels of dry friction, without the link's damping
        values = values * np.sign(at) + (0.0 if element.link is None else fitted.model.link(element.link.name).damping * at)
    force = ElementForce(deflection=d, velocity=v, time=still, force=values, left=still, motions=(), rate=1.0)
    starts: Starts = []
    for candidate in _forms(current.model, evidence, (kind_of(shape.cause), place)):
        if candidate.key in known:
            continue
        free, own = candidate.parameters(current.model, current.free), {f.path for f in candidate.free}
        with_shape = {f.path for f in fitted.free}
        for start in candidate.starts:
            with suppress(ModelError):  # values that exclude the form's own
                values = {f.path: fitted.model.get(f.path) for f in free if f.path in with_shape - own}
                model = start.replace(values)
                form = fitted_form(model, free, element, force)
                if form is not None:
                    starts.append((candidate, free, model.replace(form.values)))
    return starts


def _forms(model: RigModel, evidence: Evidence, there: tuple[Kind, str]) -> list[Candidate]:
    # The forms of a kind at a place, those included that take the place of a law that the rig may lack (friction by direction).
    own = [form for form in proposed(model, evidence) if (kind_of(form.cause), form.location) == there]
    causes = {form.cause for form in own}
    more = [
        form
        for simple in own
        if simple.starts and any(simple.cause in general for general in GENERALIZED.values())
        for form in proposed(simple.starts[0], evidence)
        if (kind_of(form.cause), form.location) == there and form.cause not in causes
    ]
    return [*own, *{form.cause: form for form in more}.values()]
