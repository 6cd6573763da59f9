"""What the sensors of a rig can show of its places, by its description alone."""

from __future__ import annotations

from msgspec.structs import replace
from small_rigs import chain

from isorig.analysis.equations.coverage import best_further_sensor, coverage
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.wire_bonder.description import wire_bonder


def measured(model: RigModel, *channels: str) -> RigModel:
    return replace(model, sensors=tuple(sensor for sensor in model.sensors if sensor.channel in channels))


def test_each_link_of_the_wire_bonder_has_an_equation_of_its_own_with_the_channels_it_needs() -> None:
    found = coverage(wire_bonder())
    assert found.equations["motor"] == (("isolation",), ("head", "motor", "table"))
    assert found.equations["lock of isolation"] == (("isolation",), ("motor", "table"))
    assert (found.unseen, found.alike) == ((), ())
    assert best_further_sensor(wire_bonder()) is None


def test_links_around_a_body_without_a_sensor_share_their_equations_and_a_sensor_there_parts_them() -> None:
    # The motion of m1 follows from that of m0: both of its links are in the same equations.
    partly = measured(chain(), "a0", "a2")
    found = coverage(partly)
    assert found.alike
    further = best_further_sensor(partly)
    assert further is not None
    body, better = further
    assert body == "m1"
    assert (better.unseen, better.alike) == ((), ())


def test_a_rig_whose_sensors_support_no_equation_has_unseen_places_only() -> None:
    contactless = measured(chain())
    found = coverage(contactless)
    assert found.equations == {}
    assert found.unseen == ("l0", "l1", "l2")
