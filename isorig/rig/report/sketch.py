"""A sketch of the rig as SVG, drawn from its model: bodies on levels above the ground, joints, drives, sensors, marked faults.

A body's level is the number of joints between it and the ground, so every joint connects neighbouring levels or two bodies of one
level. A body is as wide as what stands on it, so a joint never passes through another body.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import accumulate, pairwise

from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import GROUND, Contact, Link, RigModel
from isorig.analysis.wording import displayed_unit, words

#: Dimensions in pixels: a row of text in a body, the space of a joint between levels and next to a body, distances, margins.
ROW, RISE, REACH, APART, SIDE, TOP, FLOOR = 19, 66, 118, 22, 14, 12, 22
#: Width of a character of the text, of a symbol, and between the symbols of one joint.
LETTER, SYMBOL, PARALLEL = 7.0, 34.0, 20.0
#: Smallest width of the picture, so that small rigs are not enlarged.
NARROWEST = 340.0
WINDINGS = 6

#: Draws a symbol of a given length along x.
Symbol = Callable[[float], str]
#: A mark: paths, for example "links.isolation", "bodies.table", "sensors.table" or "lock", with a word for what is wrong there.
Marks = Mapping[str, str]


def sketch(model: RigModel, marks: Marks | None = None) -> str:
    """The drawing, in the colours of the page; marked places are highlighted."""
    plan = _Plan(model, marks or {})
    body = "".join([*plan.ground(), *plan.joints(), *plan.bodies()])
    label = escape(f"Sketch of the rig {model.name}")
    return (
        f'<svg viewBox="0 0 {plan.width:.0f} {plan.height:.0f}" role="img" aria-label="{label}" fill="none" '
        f'stroke="currentColor" stroke-width="1.5" font-size="13" style="max-width:{1.25 * plan.width:.0f}px">{body}</svg>'
    )


#: Colours of a stand-alone picture, the same as in the style of a page.
STYLE = (
    "svg{background:#fff;color:#1c2733;font-family:system-ui,sans-serif}.body{fill:#e8f0f6}.sensor{fill:#1f6f9f;stroke:none}"
    ".sensor-name{fill:#5a6672}.rubs,.drive{stroke:#c4481c}.faulty{stroke:#c4481c;stroke-width:2.5}.halo{fill:#fbe3da;stroke:none}"
    ".fault-name{fill:#c4481c;font-weight:600}"
)


def picture(model: RigModel, marks: Marks | None = None) -> str:
    """The drawing as a stand-alone SVG file."""
    head, body = sketch(model, marks).split(">", 1)
    return f'{head} xmlns="http://www.w3.org/2000/svg"><style>{STYLE}</style>{body}\n'


@dataclass(frozen=True, kw_only=True)
class _Joint:
    # A joint in the drawing: its symbols lie across one another, its words next to them; a faulty one is highlighted.
    path: str
    words: Sequence[str]
    symbols: Sequence[Symbol]
    faulty: bool

    @property
    def across(self) -> float:
        return PARALLEL * (len(self.symbols) - 1)

    @property
    def text_width(self) -> float:
        return LETTER * max(len(line) for line in self.words)

    def drawn(self, x: float, y: float, length: float, *, turned: bool) -> str:
        # Along x from the origin, then moved and turned.
        size = f'width="{length - 8:.0f}" height="{self.across + 26:.0f}"'
        halo = f'<rect x="4" y="{-self.across - 13:.0f}" {size} rx="8" class="halo"/>'
        symbols = "".join(
            f'<g transform="translate(0 {-PARALLEL * k:.0f})">{symbol(length)}</g>' for k, symbol in enumerate(self.symbols)
        )
        way = f"translate({x:.1f} {y:.1f})" + (" rotate(90)" if turned else "")
        attributes = f'data-joint="{escape(self.path, quote=True)}" data-length="{length:.1f}"'
        kind = ' class="faulty"' if self.faulty else ""
        return f'<g transform="{way}" {attributes}{kind}>{halo if self.faulty else ""}{symbols}</g>'


@dataclass(kw_only=True)
class _Box:
    # A body in the drawing; `above` are the boxes that stand on it.
    name: str
    level: int
    lines: Sequence[str]
    sensors: Sequence[str]
    drives: Sequence[str]
    above: list[_Box] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0
    wide: float = 0.0

    @property
    def high(self) -> float:
        return ROW * (len(self.lines) + len(self.drives) + bool(self.sensors)) + 8.0

    @property
    def right(self) -> float:
        return self.x + self.wide

    @property
    def bottom(self) -> float:
        return self.y + self.high


class _Plan:
    """Places of all parts of a drawing."""

    def __init__(self, model: RigModel, marks: Marks) -> None:
        self._model, self._marks = model, marks
        self._neighbours: defaultdict[str, dict[str, None]] = defaultdict(dict)
        for joint in model.joints:
            self._neighbours[joint.a][joint.b] = self._neighbours[joint.b][joint.a] = None
        rotations = _rotations(model)
        names = [body.name for body in model.bodies if body.name not in rotations]
        levels = self._distances(names)
        self.boxes = {name: self._box(name, levels[name], [r for r, host in rotations.items() if host == name]) for name in names}
        self._groups: dict[tuple[str, str], list[_Joint]] = {}
        for joint in model.joints:
            upper, lower = sorted((joint.a, joint.b), key=lambda end: -levels[end])
            pair = (lower, upper) if (lower, upper) in self._groups else (upper, lower)
            self._groups.setdefault(pair, []).append(self._joint(joint))
        self._rows = self._stacked(names)
        self._grounded = any(GROUND in pair for pair in self._groups)
        self._place()

    def _distances(self, names: Sequence[str]) -> dict[str, int]:
        # Joints from the ground; what these do not reach stands on the lowest level, an imposed body first.
        found = {GROUND: 0}
        first = [name for name in names if name in self._model.imposed]
        for start in (GROUND, *first, *names):
            found.setdefault(start, 1)
            near = [start]
            for a in near:
                for b in self._neighbours[a]:
                    if b not in found or found[b] > found[a] + 1:
                        found[b] = found[a] + 1
                        near.append(b)
        return found

    def _stacked(self, names: Sequence[str]) -> list[list[_Box]]:
        # Bodies by level, each above one that it is joined to, and those that a joint connects next to each other.
        rows = [[self.boxes[name] for name in self._in_order([n for n in names if self.boxes[n].level == 1])]]
        while rows[-1]:
            row: list[_Box] = []
            for below in rows[-1]:
                own = [self.boxes[n] for n in self._neighbours[below.name] if n in self.boxes]
                own = [box for box in own if box.level == below.level + 1 and box not in row]
                below.above = [self.boxes[n] for n in self._in_order([box.name for box in own])]
                row += below.above
            rows.append(row)
        return rows[:-1]

    def _in_order(self, names: Sequence[str]) -> list[str]:
        ordered: list[str] = []

        def add(name: str) -> None:
            if name in names and name not in ordered:
                ordered.append(name)
                for other in self._neighbours[name]:
                    add(other)

        # From an end of a chain, so that its bodies follow one another.
        for name in sorted(names, key=lambda n: sum(other in names for other in self._neighbours[n])):
            add(name)
        return ordered

    def _box(self, name: str, level: int, rotations: Sequence[str]) -> _Box:
        # `rotations` are rotations of the body without joints of their own.
        model = self._model
        mine = [name, *rotations]
        lines = []
        for body in map(model.body, mine):
            mass = f"{body.mass:.3g} {displayed_unit(unit_of(f'bodies.{body.name}.mass', model))}"
            lines.append(f"{'↻ ' if body.motion == 'rotation' else ''}{body.name}, {mass}")
        imposing = [f"drive.{drive.channel}" for drive in model.drives if drive.imposes == name]
        sensors = []
        for sensor in model.sensors:
            if sensor.force_in in imposing if sensor.force_in is not None else sensor.body in mine:
                base = "" if sensor.relative_to == GROUND else f" − {sensor.relative_to}"
                sensors.append(f"{sensor.channel}{base}{self._noted(f'sensors.{sensor.channel}')}")
        drives = [
            f"{'imposed' if drive.imposes == name else 'drive'}: {drive.channel}{self._noted(f'drive.{drive.channel}')}"
            for drive in model.drives
            if drive.imposes == name or any(n in drive.pushes for n in mine)
        ]
        noted = self._noted(f"bodies.{name}").lstrip()
        return _Box(name=name, level=level, lines=[*lines, *([noted] if noted else [])], sensors=sensors, drives=drives)

    def _noted(self, path: str) -> str:
        return f" ▸ {self._marks[path]}" if path in self._marks else ""

    def _joint(self, joint: Link | Contact) -> _Joint:
        # With the sensors of its force, and what is wrong with it or with its lock.
        if isinstance(joint, Contact):
            own = joint.name not in {link.name for link in self._model.links}
            path, lines = f"contacts.{joint.name}", [f"{joint.name}: friction" if own else "friction", f"({_tag(joint.law)})"]
            symbols, locked = [_plates], False
        else:
            path, lines = f"links.{joint.name}", [joint.name, *(f"({_tag(law)})" for law in joint.laws)]
            parts = ((_spring, joint.stiffness or joint.laws), (_dashpot, joint.damping))
            symbols = [symbol for symbol, there in parts if there] or [_spring]
            locked = any(joint.name in setup.rigid for setup in self._model.configurations.values())
        lines += [f"● {sensor.channel}" for sensor in self._model.sensors if sensor.force_in == path]
        notes = [f"▸ {self._marks[each]}" for each in (path, *(["lock"] * locked)) if each in self._marks]
        return _Joint(path=path, words=[*lines, *notes], symbols=symbols, faulty=bool(notes))

    def _least(self, box: _Box) -> float:
        # Width of a body's own texts, and of the joints below it.
        texts = [*(len(line) for line in box.lines), *(4 + len(d) for d in box.drives), sum(4 + len(s) for s in box.sensors)]
        below = [_slots(group)[-1] for (upper, _), group in self._groups.items() if upper == box.name]
        return max(LETTER * max(texts) + 24.0, sum(below), 110.0)

    def _between(self, row: Sequence[_Box]) -> list[float]:
        # Distances of neighbours on a level: room for a joint between them.
        pairs = [(a.name, b.name) for a, b in pairwise(row)]
        found = [[*self._groups.get((a, b), []), *self._groups.get((b, a), [])] for a, b in pairs]
        return [max(REACH, max(joint.text_width for joint in joints) + 24.0) if joints else APART for joints in found]

    def _inner(self, row: Sequence[_Box]) -> float:
        return sum(box.wide for box in row) + sum(self._between(row))

    def _widen(self, row: Sequence[_Box]) -> float:
        for box in row:
            box.wide = max(self._least(box), self._widen(box.above) + (24.0 if box.above else 0.0))
        return self._inner(row)

    def _place(self) -> None:
        ground = self._rows[0] if self._rows else []
        whole = self._widen(ground)
        self.width = max(whole + 2.0 * SIDE, NARROWEST)
        self._put(ground, 0.5 * (self.width - whole))
        y = float(TOP)
        for row in reversed(self._rows):
            high = max(box.high for box in row)
            for box in row:
                box.y = y + high - box.high
            y += high + (RISE if row is not ground or self._grounded else 0.0)
        self._ground_y = y
        self.height = y + FLOOR if self._grounded else y + TOP

    def _put(self, row: Sequence[_Box], start: float) -> None:
        for box, gap in zip(row, [*self._between(row), 0.0], strict=False):
            box.x = start
            self._put(box.above, start + 0.5 * (box.wide - self._inner(box.above)))
            start += box.wide + gap

    def ground(self) -> Iterator[str]:
        """The ground, if something stands on it."""
        if self._grounded:
            y, end = self._ground_y, self.width - SIDE
            yield f'<path d="M{SIDE} {y:.0f}H{end:.0f}" stroke-width="2.5"/>'
            yield from (f'<path d="M{x} {y:.0f}l-8 10"/>' for x in range(SIDE + 10, int(end), 18))

    def bodies(self) -> Iterator[str]:
        """The bodies with their drives and sensors."""
        for box in (box for row in self._rows for box in row):
            faulty = " faulty" if f"bodies.{box.name}" in self._marks else ""
            size = f'width="{box.wide:.0f}" height="{box.high:.0f}"'
            yield f'<rect x="{box.x:.0f}" y="{box.y:.0f}" {size} rx="4" class="body{faulty}"/>'
            y = box.y
            for line in box.lines:
                y += ROW
                yield _text(box.x + 10.0, y - 2.0, line)
            for line in box.drives:
                y += ROW
                yield f'<path d="M{box.x + 10:.0f} {y - 6:.0f}h18m-6 -5l6 5l-6 5m-6 -10l-6 5l6 5" class="drive"/>'
                yield _text(box.x + 36.0, y - 2.0, line)
            x = box.x + 14.0
            for line in box.sensors:
                yield f'<circle cx="{x:.0f}" cy="{y + ROW - 6:.0f}" r="4" class="sensor"/>'
                yield _text(x + 9.0, y + ROW - 2.0, line, "sensor-name")
                x += LETTER * (len(line) + 4.0)

    def joints(self) -> Iterator[str]:
        """The joints between bodies, and to the ground."""
        for (upper, lower), group in self._groups.items():
            top, under = self.boxes[upper], self.boxes.get(lower)
            if under is None or under.level < top.level:
                yield from self._standing(top, under, group)
                continue
            row = self._rows[top.level - 1]
            left, right = sorted((top, under), key=lambda box: box.x)
            adjacent = row.index(right) == row.index(left) + 1
            yield from self._lying(left, right, group) if adjacent else self._around(left, right, group)

    def _standing(self, top: _Box, under: _Box | None, group: list[_Joint]) -> Iterator[str]:
        low, end = top.bottom, self._ground_y if under is None else under.y
        below = [others for (upper, _), others in self._groups.items() if upper == top.name]
        start = top.x + 8.0 + sum(_slots(others)[-1] for others in below[: below.index(group)])
        for joint, edge in zip(group, _slots(group), strict=False):
            x, high = start + edge + 0.5 * SYMBOL, end
            if under is not None and not under.x + 6.0 <= x <= under.right - joint.across - 6.0:
                # Not above it: to its nearest edge, through the space between the levels.
                high = min(box.y for box in self._rows[under.level - 1]) - 10.0
                near = under.x + 14.0 if x < under.x else under.right - 14.0
                yield f'<path d="M{x + joint.across:.0f} {high:.0f}H{x:.0f}H{near:.0f}V{end:.0f}"/>'
            yield joint.drawn(x, low, high - low, turned=True)
            first = 0.5 * (low + high) + 5.0 - 0.5 * 16.0 * (len(joint.words) - 1)
            for k, line in enumerate(joint.words):
                yield _text(x + joint.across + 14.0, first + 16.0 * k, line)

    def _lying(self, left: _Box, right: _Box, group: list[_Joint]) -> Iterator[str]:
        length = right.x - left.right
        y = min(left.bottom, right.bottom) - 16.0
        for joint in group:
            yield joint.drawn(left.right, y, length, turned=False)
            y -= joint.across + 12.0
            for line in reversed(joint.words):
                yield _text(left.right + 0.5 * (length - LETTER * len(line)), y, line)
                y -= 16.0
            y -= 6.0

    def _around(self, left: _Box, right: _Box, group: list[_Joint]) -> Iterator[str]:
        # Below the bodies between them: the symbols, and a line for the rest of the way.
        start, end = left.right - 20.0, right.x + 20.0
        length = min(REACH, end - start)
        y = max(box.bottom for box in self._rows[left.level - 1])
        for joint in group:
            y += joint.across + 12.0
            down = f"M{start:.0f} {left.bottom:.0f}V{y:.0f}"
            up = f"M{start + length:.0f} {y:.0f}H{end:.0f}V{right.bottom:.0f}"
            yield f'{joint.drawn(start, y, length, turned=False)}<path d="{down}{up}"/>'
            yield _text(start + length + 8.0, y - 4.0, ", ".join(joint.words))


def _slots(group: Sequence[_Joint]) -> list[float]:
    # Where the joints of a pair of bodies begin, and where the last one ends.
    return [*accumulate([0.0, *(joint.across + SYMBOL + joint.text_width + 12.0 for joint in group)])]


def _rotations(model: RigModel) -> dict[str, str]:
    # A coordinate that only arms use is a motion of the body that they belong to: {coordinate: body}.
    own = {end for joint in model.joints for end in (joint.a, joint.b)} | {*model.imposed}
    found: dict[str, str] = {}
    for arms, host in [*((joint.arms, joint.a) for joint in model.joints), *((s.arms, s.body) for s in model.sensors)]:
        for name in arms:
            if name not in own and host in own:
                found.setdefault(name, host)
    return found


def _tag(law: object) -> str:
    return words(str(law.__struct_config__.tag))  # type: ignore[attr-defined]


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    # What is wrong somewhere is highlighted.
    faulty = "▸" in text
    kind = "fault-name" if faulty else kind
    named = f' class="{kind}"' if kind else ""
    fill = "" if faulty else ' fill="currentColor"'
    return f'<text x="{x:.0f}" y="{y:.0f}"{fill} stroke="none"{named}>{escape(text)}</text>'


def _spring(length: float) -> str:
    lead = 0.2 * length
    step = (length - 2.0 * lead) / (2.0 * WINDINGS)
    zigzag = "".join(f"l{step:.2f} {7 if k == 0 else (14 if k % 2 == 0 else -14)}" for k in range(2 * WINDINGS - 1))
    return f'<path d="M0 0h{lead:.1f}{zigzag}L{length - lead:.1f} 0H{length:.1f}"/>'


def _dashpot(length: float) -> str:
    middle = 0.5 * length
    cup = f"M0 0h{middle - 8:.1f}m14 -7h-14v14h14"
    return f'<path d="{cup}M{middle:.1f} -4v8M{middle:.1f} 0H{length:.1f}"/>'


def _plates(length: float) -> str:
    middle = 0.5 * length
    teeth = "".join(f"M{middle - 12 + 6 * k:.1f} 3l4 -6" for k in range(4))
    return f'<path d="M0 -3H{middle + 14:.1f}M{middle - 14:.1f} 3H{length:.1f}{teeth}" class="rubs"/>'
