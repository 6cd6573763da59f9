"""The sketch of a rig: every joint from body to body and through no other, for the shipped rigs and for random ones."""

from __future__ import annotations

import re
from itertools import combinations
from xml.etree import ElementTree

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import GROUND, Body, Contact, Drive, Link, RigModel, Sensor
from isorig.rig.files.rigfile import SHIPPED, read_rig
from isorig.rig.report.sketch import sketch
from isorig.rig.wire_bonder.description import BUILT_IN, wire_bonder

Box = tuple[float, float, float, float]
#: Pixels by which an end may miss the edge that it belongs to: coordinates are rounded.
ROUNDED = 1.5


def boxes(drawn: ElementTree.Element) -> dict[str, Box]:
    """Left, top, right, bottom of every body by the first words in it."""
    found = {}
    texts = [(float(t.attrib["x"]), float(t.attrib["y"]), t.text or "") for t in drawn.iter("text")]
    for rect in drawn.iter("rect"):
        if "body" not in rect.attrib["class"]:
            continue
        x, y, wide, high = (float(rect.attrib[key]) for key in ("x", "y", "width", "height"))
        inside = [text for tx, ty, text in texts if x <= tx <= x + wide and y <= ty <= y + high]
        found[inside[0].removeprefix("↻ ").split(",")[0]] = (x, y, x + wide, y + high)
    return found


def joints(drawn: ElementTree.Element) -> list[tuple[str, float, float, float, float]]:
    """Name, and begin and end of every joint's symbols."""
    found = []
    for group in drawn.iter("g"):
        if "data-joint" not in group.attrib:
            continue
        x, y = (float(v) for v in re.findall(r"translate\((\S+) (\S+)\)", group.attrib["transform"])[0])
        length = float(group.attrib["data-length"])
        turned = "rotate" in group.attrib["transform"]
        found.append((group.attrib["data-joint"], x, y, x + (0.0 if turned else length), y + (length if turned else 0.0)))
    return found


def crosses(line: tuple[float, float, float, float], box: Box) -> bool:
    """Whether a vertical or horizontal line enters a box."""
    x0, y0, x1, y1 = line
    left, top, right, bottom = box
    return max(x0, x1) > left + 2 and min(x0, x1) < right - 2 and max(y0, y1) > top + 2 and min(y0, y1) < bottom - 2


def check(model: RigModel) -> None:
    """Bodies do not overlap, joints end at their bodies and cross none, and all is within the picture."""
    drawn = ElementTree.fromstring(sketch(model))
    _, _, width, height = (float(v) for v in drawn.attrib["viewBox"].split())
    placed = boxes(drawn)
    assert all(b[0] >= 0 and b[2] <= width and b[1] >= 0 and b[3] <= height for b in placed.values())
    assert not any(a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] for a, b in combinations(placed.values(), 2))
    lines = joints(drawn)
    assert sorted(name for name, *_ in lines) == sorted(
        [*(f"links.{x.name}" for x in model.links), *(f"contacts.{x.name}" for x in model.contacts)]
    )
    for name, *line in lines:
        assert not [body for body, box in placed.items() if crosses((line[0], line[1], line[2], line[3]), box)], name


@pytest.mark.parametrize("name", [*SHIPPED, *BUILT_IN])
def test_every_joint_of_a_shipped_rig_runs_from_body_to_body(name: str) -> None:
    model = read_rig(name).model
    check(model)
    drawn = ElementTree.fromstring(sketch(model))
    placed = boxes(drawn)
    ground = max((box[3] for box in placed.values()), default=0.0)
    for joint, x0, y0, x1, y1 in joints(drawn):
        part = model.link(joint[6:]) if joint.startswith("links.") else model.contact(joint[9:])
        for end in (part.a, part.b):
            if end == GROUND:
                assert max(y0, y1) > ground + 20
                continue
            left, top, right, bottom = placed[end]
            near = [
                left - ROUNDED <= x <= right + ROUNDED and top - ROUNDED <= y <= bottom + ROUNDED for x, y in ((x0, y0), (x1, y1))
            ]
            assert any(near), (joint, end)


@st.composite
def rigs(draw: st.DrawFn) -> RigModel:
    count = draw(st.integers(1, 7))
    names = [f"b{k}" for k in range(count)]
    links = [
        Link(
            name=f"tree{k}",
            a=names[k],
            b=draw(st.sampled_from([GROUND, *names[:k]])),
            stiffness=1.0,
            damping=draw(st.sampled_from([0.0, 1.0])),
        )
        for k in range(count)
    ]
    extra = draw(st.lists(st.tuples(st.sampled_from(names), st.sampled_from([GROUND, *names])), max_size=4))
    links += [Link(name=f"more{k}", a=a, b=b, damping=1.0) for k, (a, b) in enumerate(extra) if a != b]
    contact = Contact(name="slide", a=names[-1], law=Coulomb(friction_force=1.0))
    return RigModel(
        name="random", bodies=tuple(Body(name=n, mass=1.0) for n in names), links=tuple(links), contacts=(contact,),
        drive=Drive(channel="f", quantity="force", pushes={names[0]: 1.0}),
        sensors=tuple(Sensor(channel=f"a{n}", body=n) for n in names),
    )  # fmt: skip


@settings(max_examples=150, deadline=None)
@given(rigs())
def test_no_joint_of_any_rig_passes_through_a_body(model: RigModel) -> None:
    check(model)


def test_a_rotation_without_joints_is_a_motion_of_its_body() -> None:
    drawn = ElementTree.fromstring(sketch(read_rig("rocking-table").model))
    assert list(boxes(drawn)) == ["heave"]
    assert any((t.text or "").startswith("↻ tilt") for t in drawn.iter("text"))


def test_only_what_stands_on_the_ground_has_one() -> None:
    assert 'stroke-width="2.5"/>' not in sketch(read_rig("shaken-base").model)
    assert 'stroke-width="2.5"/>' in sketch(read_rig("two-carts").model)


@pytest.mark.parametrize("path", ["links.isolation", "contacts.isolation", "bodies.table", "sensors.motor", "drive.head", "lock"])
def test_a_marked_place_is_highlighted_with_its_cause(path: str) -> None:
    plain, marked = sketch(wire_bonder()), sketch(wire_bonder(), {path: "some cause"})
    assert "▸" not in plain
    assert "fault-name" in marked
    assert marked.count("▸ some cause") == 1
    if path in ("links.isolation", "contacts.isolation", "lock"):
        faulty = [
            g.attrib["data-joint"] for g in ElementTree.fromstring(marked).iter("g") if "faulty" in g.attrib.get("class", "")
        ]  # fmt: skip
        assert faulty == [path.replace("lock", "links.isolation")]


def test_names_are_escaped() -> None:
    named = msgspec.structs.replace(wire_bonder(), name="<script>")
    assert "<script>" not in sketch(named)
