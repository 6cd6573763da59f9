"""Forms started from a fitted free shape: each is fitted to its curve first, without simulation."""

from collections.abc import Collection, Sequence
from contextlib import suppress

import numpy as np

from isorig.analysis.diagnose.causes import containing, proposed
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.diagnose.step import Curve
from isorig.analysis.equations.balances import elements
from isorig.analysis.equations.forms import ElementForce, fitted_form
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import Starts
from isorig.analysis.fitting.solve import Fit, Free

#: Points of the curve that a form is fitted to. Chosen: ten between two of the densest curve's.
POINTS = 500


def starts_from_curve(
    shape: Candidate, fitted: Fit, curve: Curve, current: Fit, evidence: Evidence, known: Collection[tuple[str, str]]
) -> Starts:  # fmt: skip
    """Starting points of the forms of a free shape's kind at its place, with the values that come closest to its curve.

    Only curves over deflection or speed give any. Forms whose cause and place are `known` have been fitted.
    """
    place = shape.location
    element = next((element for element in elements(current.model) if place in element.names), None)
    if element is None or curve.over not in ("deflection", "speed") or curve.of_damping:
        return []
    x, y, _ = np.array(curve.points).T
    at, still = np.linspace(*curve.reached, POINTS), np.zeros(POINTS)
    d, v = (still, at) if curve.over == "speed" else (at, still)
    values = np.interp(at, x, y)
    if kind_of(shape.cause) == "friction_shape":  # the curve shows levels of dry friction, without the link's damping
        values = values * np.sign(at) + (0.0 if element.link is None else fitted.model.link(element.link.name).damping * at)
    force = ElementForce(deflection=d, velocity=v, time=still, force=values, left=still, motions=(), rate=1.0)
    with_shape = {f.path for f in fitted.free}

    def begun(candidate: Candidate, free: Sequence[Free]) -> Starts:
        starts: Starts = []
        for start in candidate.starts:
            with suppress(ModelError):  # values that exclude the form's own
                taken = with_shape.intersection(f.path for f in free) - {f.path for f in candidate.free}
                model = start.replace({path: fitted.model.get(path) for path in taken})
                form = fitted_form(model, free, element, force)
                if form is not None:
                    starts.append((candidate, tuple(free), model.replace(form.values)))
        return starts

    starts: Starts = []
    there = kind_of(shape.cause), place
    forms = [form for form in proposed(current.model, evidence) if (kind_of(form.cause), form.location) == there]
    for simple in forms:
        free = simple.parameters(current.model, current.free)
        own = begun(simple, free)
        starts += own
        # Forms that contain it and for which the model lacks a law have their sizes from it.
        for form, its in containing(simple, own[0][2], free, evidence) if own else ():
            if kind_of(form.cause) == there[0] and all(form.cause != other.cause for other in forms):
                starts += begun(form, its)
    return [start for start in starts if start[0].key not in known]
