"""A sketch of the rig as SVG, drawn from its model: bodies on levels above the ground, joints, drives, sensors, marked faults.

A body's level is the number of joints between it and the ground, so every joint connects neighbouring levels or two bodies of one
level. A body is as wide as what stands on it, so a joint never passes through another body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise

from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import GROUND, Contact, Link, RigModel

#: Dimensions in pixels: a row of text in a body, the space of a joint between levels and beside a body, distances, margins.
ROW, RISE, REACH, APART, SIDE, TOP, FLOOR = 19, 66, 118, 22, 14, 12, 22
#: Width of a character of the text, of a symbol, and between the symbols of one joint.
LETTER, SYMBOL, PARALLEL = 7.0, 34.0, 20.0
#: Smallest width of the picture, so that small rigs are not enlarged.
NARROWEST = 340.0
WINDINGS = 6

Joint = Link | Contact
#: A mark: paths such as "links.isolation", "bodies.table", "sensors.table" or "lock", with a word for what is wrong there.
Marks = Mapping[str, str]


def sketch(model: RigModel, marks: Marks | None = None) -> str:
    """The drawing, in the colours of the page; marked places are highlighted."""
    plan = _Plan(model, marks or {})
    body = "".join([*plan.ground(), *plan.joints(), *plan.boxes()])
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


@dataclass(kw_only=True)
class _Box:
    # A body in the drawing; `riders` are rotations of it without joints of their own, `above` the boxes that stand on it.
    name: str
    level: int
    lines: Sequence[str]
    sensors: Sequence[tuple[str, str]]
    drives: Sequence[str]
    above: list[_Box] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0
    wide: float = 0.0

    @property
    def high(self) -> float:
        return ROW * (len(self.lines) + len(self.drives) + bool(self.sensors)) + 8.0


class _Plan:
    """Places of all parts of a drawing."""

    def __init__(self, model: RigModel, marks: Marks) -> None:
        self._model, self._marks = model, marks
        self._all: list[Joint] = [*model.links, *model.contacts]
        riders = _rotations(model)
        names = [body.name for body in model.bodies if body.name not in riders]
        levels = self._distances(names)
        self._boxes = {name: self._box(name, levels[name], [r for r, host in riders.items() if host == name]) for name in names}
        self._groups: dict[tuple[str, str], list[Joint]] = {}
        for joint in self._all:
            upper, lower = sorted((joint.a, joint.b), key=lambda end: -levels[end])
            pair = (lower, upper) if (lower, upper) in self._groups else (upper, lower)
            self._groups.setdefault(pair, []).append(joint)
        self._rows = self._stacked(names)
        self._grounded = any(GROUND in pair for pair in self._groups)
        self._place()

    def _neighbours(self, name: str) -> list[str]:
        pairs = [(joint.a, joint.b) for joint in self._all]
        return list(dict.fromkeys(b if a == name else a for a, b in pairs if name in (a, b)))

    def _distances(self, names: Sequence[str]) -> dict[str, int]:
        # Joints from the ground; what these do not reach stands on the lowest level, an imposed body first.
        found = {GROUND: 0}
        first = [name for name in names if name in self._model.imposed]
        for start in (GROUND, *first, *names):
            found.setdefault(start, 1)
            near = [start]
            while near:
                reached = [b for a in near for b in self._neighbours(a) if b not in found or found[b] > found[a] + 1]
                found |= {b: min(found[a] + 1 for a in near if b in self._neighbours(a)) for b in reached}
                near = reached
        return found

    def _stacked(self, names: Sequence[str]) -> list[list[_Box]]:
        # Bodies by level, each above one that it is joined to, and those that a joint connects next to each other.
        rows: list[list[_Box]] = [[]]
        rows[0] = [self._boxes[name] for name in self._in_order([n for n in names if self._boxes[n].level == 1])]
        while rows[-1]:
            row: list[_Box] = []
            for below in rows[-1]:
                own = [n for n in self._neighbours(below.name) if n in self._boxes and self._boxes[n].level == below.level + 1]
                below.above = [self._boxes[n] for n in self._in_order([n for n in own if self._boxes[n] not in row])]
                row += below.above
            rows.append(row)
        return rows[:-1]

    def _in_order(self, names: Sequence[str]) -> list[str]:
        ordered: list[str] = []

        def add(name: str) -> None:
            if name in names and name not in ordered:
                ordered.append(name)
                for other in self._neighbours(name):
                    add(other)

        # From an end of a chain, so that its bodies follow one another.
        for name in sorted(names, key=lambda n: sum(other in names for other in self._neighbours(n))):
            add(name)
        return ordered

    def _box(self, name: str, level: int, riders: Sequence[str]) -> _Box:
        model = self._model
        mine = [name, *riders]
        lines = [f"{'↻ ' if model.body(n).motion == 'rotation' else ''}{n}, {_mass(model, n)}" for n in mine]
        note = self._marks.get(f"bodies.{name}")
        sensors = []
        for sensor in model.sensors:
            forced = sensor.force_in is not None and any(
                sensor.force_in == f"drive.{d.channel}" and d.imposes == name for d in model.drives
            )
            if (sensor.body in mine and sensor.force_in is None) or forced:
                base = "" if sensor.relative_to == GROUND else f" − {sensor.relative_to}"
                sensors.append((sensor.channel, f"{sensor.channel}{base}{self._noted(f'sensors.{sensor.channel}')}"))
        drives = [
            f"{'imposed' if drive.imposes == name else 'drive'}: {drive.channel}{self._noted(f'drive.{drive.channel}')}"
            for drive in model.drives
            if drive.imposes == name or any(n in drive.pushes for n in mine)
        ]
        return _Box(name=name, level=level, lines=[*lines, *([f"▸ {note}"] if note else [])], sensors=sensors, drives=drives)

    def _noted(self, path: str) -> str:
        return f" ▸ {self._marks[path]}" if path in self._marks else ""

    def _least(self, box: _Box) -> float:
        # Width of a body's own texts, and of the joints below it.
        texts = [*(len(line) for line in box.lines), *(4 + len(d) for d in box.drives), sum(4 + len(s) for _, s in box.sensors)]
        below = [self._slots(group)[-1] for (upper, _), group in self._groups.items() if upper == box.name]
        return max(LETTER * max(texts) + 24.0, sum(below), 110.0)

    def _slots(self, group: Sequence[Joint]) -> list[float]:
        # Where the joints of a pair of bodies begin, and where the last one ends.
        edges = [0.0]
        for joint in group:
            symbols = PARALLEL * (len(_symbols(joint)) - 1) + SYMBOL
            edges.append(edges[-1] + symbols + LETTER * max(len(line) for line in self._words(joint)) + 12.0)
        return edges

    def _words(self, joint: Joint) -> list[str]:
        kind = "links" if isinstance(joint, Link) else "contacts"
        if isinstance(joint, Link):
            lines = [joint.name, *(f"({_tag(law)})" for law in joint.laws)]
        else:
            own = joint.name not in {link.name for link in self._model.links}
            lines = [f"{joint.name}: friction" if own else "friction", f"({_tag(joint.law)})"]
        measured = [s.channel for s in self._model.sensors if s.force_in == f"{kind}.{joint.name}"]
        lines += [f"● {channel}" for channel in measured]
        return lines + [f"▸ {note}" for note in self._notes(joint)]

    def _notes(self, joint: Joint) -> list[str]:
        kind = "links" if isinstance(joint, Link) else "contacts"
        found = [self._marks[f"{kind}.{joint.name}"]] if f"{kind}.{joint.name}" in self._marks else []
        blocked = {name for setup in self._model.configurations.values() for name in setup.rigid}
        if "lock" in self._marks and isinstance(joint, Link) and joint.name in blocked:
            found.append(self._marks["lock"])
        return found

    def _beside(self, left: _Box, right: _Box) -> list[Joint]:
        pairs = ((left.name, right.name), (right.name, left.name))
        return [joint for pair in pairs for joint in self._groups.get(pair, [])]

    def _between(self, row: Sequence[_Box]) -> list[float]:
        # Distances of neighbours on a level: room for a joint between them.
        return [
            max(REACH, LETTER * max(len(line) for joint in found for line in self._words(joint)) + 24.0) if found else APART
            for found in (self._beside(a, b) for a, b in pairwise(row))
        ]

    def _widen(self, box: _Box) -> float:
        inner = sum(self._widen(one) for one in box.above) + sum(self._between(box.above))
        box.wide = max(self._least(box), inner + (24.0 if box.above else 0.0))
        return box.wide

    def _place(self) -> None:
        ground = self._rows[0] if self._rows else []
        whole = sum(self._widen(box) for box in ground) + sum(self._between(ground))
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
            inner = sum(one.wide for one in box.above) + sum(self._between(box.above))
            self._put(box.above, start + 0.5 * (box.wide - inner))
            start += box.wide + gap

    def ground(self) -> list[str]:
        """The ground, if something stands on it."""
        if not self._grounded:
            return []
        y, end = self._ground_y, self.width - SIDE
        ticks = "".join(f'<path d="M{x} {y:.0f}l-8 10"/>' for x in range(SIDE + 10, int(end), 18))
        return [f'<path d="M{SIDE} {y:.0f}H{end:.0f}" stroke-width="2.5"/>{ticks}']

    def boxes(self) -> list[str]:
        """The bodies with their drives and sensors."""
        return [self._drawn(box) for row in self._rows for box in row]

    def _drawn(self, box: _Box) -> str:
        faulty = f"bodies.{box.name}" in self._marks
        parts = [
            f'<rect x="{box.x:.0f}" y="{box.y:.0f}" width="{box.wide:.0f}" height="{box.high:.0f}" rx="4" '
            f'class="body{" faulty" if faulty else ""}"/>'
        ]
        y = box.y
        for line in box.lines:
            y += ROW
            parts.append(_text(box.x + 10.0, y - 2.0, line, "fault-name" if line.startswith("▸") else ""))
        for line in box.drives:
            y += ROW
            arrow = f'<path d="M{box.x + 10:.0f} {y - 6:.0f}h18m-6 -5l6 5l-6 5m-6 -10l-6 5l6 5" class="drive"/>'
            parts.append(arrow + _text(box.x + 36.0, y - 2.0, line, "fault-name" if "▸" in line else ""))
        x = box.x + 14.0
        for channel, line in box.sensors:
            kind = "fault-name" if f"sensors.{channel}" in self._marks else "sensor-name"
            parts.append(f'<circle cx="{x:.0f}" cy="{y + ROW - 6:.0f}" r="4" class="sensor"/>')
            parts.append(_text(x + 9.0, y + ROW - 2.0, line, kind))
            x += LETTER * (len(line) + 4.0)
        return "".join(parts)

    def joints(self) -> list[str]:
        """The joints between bodies, and to the ground."""
        return [self._joined(upper, lower, group) for (upper, lower), group in self._groups.items()]

    def _joined(self, upper: str, lower: str, group: Sequence[Joint]) -> str:
        top, under = self._boxes[upper], self._boxes.get(lower)
        if under is None or under.level < top.level:
            return self._standing(top, under, group)
        row = self._rows[top.level - 1]
        left, right = sorted((top, under), key=lambda box: box.x)
        if row.index(right) == row.index(left) + 1:
            return self._lying(left, right, group)
        return self._around(left, right, group)

    def _standing(self, top: _Box, under: _Box | None, group: Sequence[Joint]) -> str:
        end = self._ground_y if under is None else under.y
        below = [pair for pair in self._groups if pair[0] == top.name]
        before = below[: below.index((top.name, GROUND if under is None else under.name))]
        start = top.x + 8.0 + sum(self._slots(self._groups[pair])[-1] for pair in before)
        parts = []
        for joint, edge in zip(group, self._slots(group), strict=False):
            x = start + edge + 0.5 * SYMBOL
            low, high = top.y + top.high, end
            wide = PARALLEL * (len(_symbols(joint)) - 1)
            if under is not None and not under.x + 6.0 <= x <= under.x + under.wide - wide - 6.0:
                # Not above it: to its nearest edge, through the space between the levels.
                high = min(box.y for box in self._rows[under.level - 1]) - 10.0
                near = under.x + 14.0 if x < under.x else under.x + under.wide - 14.0
                parts.append(f'<path d="M{x + wide:.0f} {high:.0f}H{x:.0f}H{near:.0f}V{end:.0f}"/>')
            parts.append(self._symbols(joint, x, low, high - low, turned=True))
            lines = self._words(joint)
            first = 0.5 * (low + high) + 5.0 - 0.5 * 16.0 * (len(lines) - 1)
            parts += [
                _text(x + wide + 14.0, first + 16.0 * k, line, "fault-name" if line.startswith("▸") else "")
                for k, line in enumerate(lines)
            ]
        return "".join(parts)

    def _lying(self, left: _Box, right: _Box, group: Sequence[Joint]) -> str:
        start, length = left.x + left.wide, right.x - left.x - left.wide
        bottom = min(left.y + left.high, right.y + right.high)
        parts = []
        y = bottom - 16.0
        for joint in group:
            parts.append(self._symbols(joint, start, y, length, turned=False))
            lines = self._words(joint)
            y -= PARALLEL * (len(_symbols(joint)) - 1) + 12.0
            for line in reversed(lines):
                x = start + 0.5 * (length - LETTER * len(line))
                parts.append(_text(x, y, line, "fault-name" if line.startswith("▸") else ""))
                y -= 16.0
            y -= 6.0
        return "".join(parts)

    def _around(self, left: _Box, right: _Box, group: Sequence[Joint]) -> str:
        # Below the bodies between them: the symbols, and a line for the rest of the way.
        start, end = left.x + left.wide - 20.0, right.x + 20.0
        bottom = max(box.y + box.high for box in self._rows[left.level - 1])
        length = min(REACH, end - start)
        parts, y = [], bottom
        for joint in group:
            y += PARALLEL * (len(_symbols(joint)) - 1) + 12.0
            down = f"M{start:.0f} {left.y + left.high:.0f}V{y:.0f}"
            up = f"M{start + length:.0f} {y:.0f}H{end:.0f}V{right.y + right.high:.0f}"
            parts.append(f'{self._symbols(joint, start, y, length, turned=False)}<path d="{down}{up}"/>')
            words = ", ".join(self._words(joint))
            parts.append(_text(start + length + 8.0, y - 4.0, words, "fault-name" if "▸" in words else ""))
        return "".join(parts)

    def _symbols(self, joint: Joint, x: float, y: float, length: float, *, turned: bool) -> str:
        # Along x from the origin, then moved and turned; the symbols of one joint side by side.
        drawn = "".join(
            f'<g transform="translate(0 {-PARALLEL * k:.0f})">{symbol(length)}</g>' for k, symbol in enumerate(_symbols(joint))
        )
        across = PARALLEL * (len(_symbols(joint)) - 1)
        faulty = bool(self._notes(joint))
        halo = f'<rect x="4" y="{-across - 13:.0f}" width="{length - 8:.0f}" height="{across + 26:.0f}" rx="8" class="halo"/>'
        way = f"translate({x:.1f} {y:.1f})" + (" rotate(90)" if turned else "")
        name = escape(f"{'links' if isinstance(joint, Link) else 'contacts'}.{joint.name}", quote=True)
        kind = ' class="faulty"' if faulty else ""
        told = f'data-joint="{name}" data-length="{length:.1f}"'
        return f'<g transform="{way}" {told}{kind}>{halo if faulty else ""}{drawn}</g>'


def _rotations(model: RigModel) -> dict[str, str]:
    # A coordinate that only arms use is a motion of the body that they belong to: {coordinate: body}.
    joints: list[Joint] = [*model.links, *model.contacts]
    own = {end for joint in joints for end in (joint.a, joint.b)} | {*model.imposed}
    found: dict[str, str] = {}
    for arms, host in [*((joint.arms, joint.a) for joint in joints), *((s.arms, s.body) for s in model.sensors)]:
        for name in arms:
            if name not in own and host in own:
                found.setdefault(name, host)
    return found


def _mass(model: RigModel, name: str) -> str:
    return f"{model.body(name).mass:.3g} {unit_of(f'bodies.{name}.mass', model)}".replace("^2", "²")


def _tag(law: object) -> str:
    return str(law.__struct_config__.tag).replace("_", " ")  # type: ignore[attr-defined]


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    named = f' class="{kind}"' if kind else ""
    fill = "" if kind == "fault-name" else ' fill="currentColor"'
    return f'<text x="{x:.0f}" y="{y:.0f}"{fill} stroke="none"{named}>{escape(text)}</text>'


def _symbols(joint: Joint) -> Sequence[Callable[[float], str]]:
    if isinstance(joint, Contact):
        return [_plates]
    found = [symbol for symbol, there in ((_spring, joint.stiffness or joint.laws), (_dashpot, joint.damping)) if there]
    return found or [_spring]


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
