"""Resonators at a body that has one already."""

import msgspec
import numpy as np
from small_rigs import stage

from isorig.analysis.diagnose.causes.base import Amplitudes, WeakestSizes
from isorig.analysis.diagnose.causes.extra_mode import ExtraMode

RUNS = Amplitudes(deflection={}, speed={}, peak={}, sample_rate=500.0, end_time=60.0)


def test_a_body_can_have_two_so_that_the_place_of_the_first_is_a_rival_for_the_second() -> None:
    cause, model = ExtraMode(), stage()
    body = model.bodies[0].name
    places = cause.places(model)
    once = cause.sized(model, RUNS, body, 1.0, WeakestSizes()).model
    twice = cause.sized(once, RUNS, body, 1.0, WeakestSizes()).model
    assert body in places
    assert cause.places(once) == places
    assert cause.places(twice) == tuple(place for place in places if place != body)
    added = [one for one in twice.bodies if one.name not in {part.name for part in model.bodies}]
    assert len(added) == 2
    assert len({one.name for one in added}) == 2
    assert all(one.name.endswith("_added") for one in added)
    ends = [(link.a, link.b) for link in twice.links if link.name in {one.name for one in added}]
    assert ends == [(one.name, body) for one in added]


def test_both_have_values_of_their_own() -> None:
    cause = ExtraMode()
    body = stage().bodies[0].name
    once = cause.sized(stage(), RUNS, body, 1.0, WeakestSizes())
    twice = cause.sized(once.model, RUNS, body, 0.5, WeakestSizes())
    names = [one.name for one in twice.model.bodies if one.name.endswith("_added")]
    masses = [twice.model.body(name).mass for name in names]
    assert np.allclose(masses, [once.parameters["mode_mass"], twice.parameters["mode_mass"]])
    assert masses[0] == 2.0 * masses[1]
    assert msgspec.structs.replace(twice.model, bodies=once.model.bodies, links=once.model.links) == once.model
