"""A model without the cause of an earlier step."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from small_rigs import guessed, played, stage, with_law

from isorig.analysis.diagnose.cause_in_model import with_cause, without_cause
from isorig.analysis.diagnose.causes import proposed
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.fitting.ladder import not_fitted
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.laws import Coulomb, Cubic, FrictionCurve
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor

BASE = (Free(path="links.foot.stiffness", low=1.0, high=1e6), Free(path="drive.factor", low=0.1, high=10.0))
MASS = Free(path="bodies.table.mass", low=0.1, high=10.0)
GAIN = Free(path="sensors.a.chain.gain", low=0.2, high=5.0)


def rig(**changes: object) -> RigModel:
    found = RigModel(
        name="table", bodies=(Body(name="table", mass=2.0),), drive=Drive(channel="u", pushes={"table": 1.0}),
        links=(Link(name="foot", a="table", stiffness=100.0, damping=1.0),), sensors=(Sensor(channel="a", body="table"),),
    )  # fmt: skip
    return msgspec.structs.replace(found, **changes)


def fitted(model: RigModel, *free: Free, **values: float) -> Fit:
    paths = {path.replace("__", "."): value for path, value in values.items()}
    return replace(not_fitted(rig()), model=model.replace(paths), free=free, covariance=np.zeros((len(free),) * 2))


def test_a_value_returns_and_the_other_values_stay() -> None:
    before = fitted(rig(), *BASE, links__foot__stiffness=80.0)
    after = fitted(rig(), *BASE, MASS, links__foot__stiffness=90.0, bodies__table__mass=2.4)
    last = fitted(rig(), *BASE, MASS, GAIN, links__foot__stiffness=110.0, bodies__table__mass=2.5, sensors__a__chain__gain=1.2)
    found = without_cause(before, after, last)
    assert found is not None
    model, free = found
    assert [item.path for item in free] == [*(item.path for item in BASE), GAIN.path] == list(model.free)
    assert model.get(MASS.path) == 2.0
    assert model.get(GAIN.path) == 1.2
    assert model.get("links.foot.stiffness") == 110.0


def test_a_body_a_link_and_a_law_are_taken_out() -> None:
    loose = Body(name="table_added", mass=0.1), Link(name="table_added", a="table_added", b="table", stiffness=9.0)
    own = Free(path="bodies.table_added.mass", low=0.01, high=1.0)
    with_body = rig(bodies=(*rig().bodies, loose[0]), links=(*rig().links, loose[1]))
    law = Cubic(cubic_stiffness=5.0)
    own_law = Free(path="links.foot.laws.0.cubic_stiffness", low=0.0, high=1e6)
    hardened = msgspec.structs.replace(with_body, links=(msgspec.structs.replace(rig().links[0], laws=(law,)), loose[1]))
    first, second, both = fitted(rig(), *BASE), fitted(with_body, *BASE, own), fitted(hardened, *BASE, own, own_law)
    found = without_cause(first, second, both)
    assert found is not None
    assert [body.name for body in found[0].bodies] == ["table"]
    assert [link.name for link in found[0].links] == ["foot"]
    assert found[0].links[0].laws == (law,)
    assert [item.path for item in found[1]] == [*(item.path for item in BASE), own_law.path]
    alone = fitted(rig(links=(msgspec.structs.replace(rig().links[0], laws=(law,)),)), *BASE, own_law)
    without_law = without_cause(first, alone, both)
    assert without_law is not None
    assert without_law[0].links[0].laws == ()


def test_a_law_of_a_contact_returns() -> None:
    rubbing = Contact(name="foot", a="table", law=Coulomb(friction_force=3.0))
    curve = FrictionCurve(over="position", at=(-1.0, 0.0, 1.0), levels=(2.0, 3.0, 4.0))
    own = Free(path="contacts.foot.law.levels.0", low=0.0, high=9.0)
    plain = rig(contacts=(rubbing,))
    curved = rig(contacts=(msgspec.structs.replace(rubbing, law=curve),))
    found = without_cause(
        fitted(plain, *BASE), fitted(curved, *BASE, own), fitted(curved, *BASE, own, MASS, bodies__table__mass=2.4)
    )
    assert found is not None
    assert found[0].contacts == (rubbing,)
    assert found[0].get(MASS.path) == 2.4


@pytest.mark.parametrize("laws", [2, 1])
def test_later_causes_that_build_on_the_one_before_them_keep_it(laws: int) -> None:
    """A second law at the same link, or one on the body that the first cause attached."""
    law = Cubic(cubic_stiffness=5.0)
    foot = rig().links[0]
    if laws == 2:
        after = rig(links=(msgspec.structs.replace(foot, laws=(law,)),))
        last = rig(links=(msgspec.structs.replace(foot, laws=(law, law)),))
        own = Free(path="links.foot.laws.1.cubic_stiffness", low=0.0, high=1e6)
    else:
        bodies = (*rig().bodies, Body(name="table_added", mass=0.1))
        loose = Link(name="table_added", a="table_added", b="table", stiffness=9.0)
        after = rig(bodies=bodies, links=(foot, loose))
        last = rig(bodies=bodies, links=(foot, msgspec.structs.replace(loose, laws=(law,))))
        own = Free(path="links.table_added.laws.0.cubic_stiffness", low=0.0, high=1e6)
    assert without_cause(fitted(rig(), *BASE), fitted(after, *BASE), fitted(last, *BASE, own)) is None


def test_a_cause_keeps_its_values_where_its_law_has_another_place_in_the_list() -> None:
    """Fitted behind another law of the link, and put into the model without that: as a stop at both ends, and at either one."""
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    evidence = observe(campaign, guess, prepare(campaign, guess), guess, guess)
    (name,) = (link.name for link in guess.links)
    own = next(c for c in proposed(guess, evidence) if c.cause == "end_stop" and c.location == name)
    behind = with_law(guess, name, Cubic(cubic_stiffness=5.0))
    second = next(c for c in proposed(behind, evidence) if c.cause == "end_stop" and c.location == name)
    assert [free.path.split(".")[3] for free in (*own.free, *second.free)] == ["0"] * 3 + ["1"] * 3
    values = dict(zip((free.path for free in second.free), (1.5e-3, 2e5, 3.0), strict=True))
    last = replace(not_fitted(guess), model=second.starts[0].replace(values), free=second.free)
    starts = with_cause(guess, (), second, last, evidence)
    assert sorted(model.link(name).laws[0].end for _, _, model in starts) == [-1, 0, 1]
    for candidate, free, model in starts:
        assert [item.path for item in free[-3:]] == [item.path for item in own.free] == [item.path for item in candidate.free]
        assert [model.get(item.path) for item in own.free] == [1.5e-3, 2e5, 3.0]
