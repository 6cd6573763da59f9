"""A sketch of the rig as SVG, drawn from its model: bodies, springs, friction, the drive, the sensors."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import GROUND, RigModel

#: Dimensions in pixels: width, height of a body, space for a link, margins.
WIDTH, BODY, LINK, SIDE, TOP, FLOOR = 460, 46, 52, 14, 30, 26
SPRING = 7


def sketch(model: RigModel) -> str:
    """The drawing, in the colours of the page."""
    levels = _levels(model)
    height = TOP + len(levels) * (BODY + LINK) + FLOOR
    ground = height - FLOOR
    places: dict[str, tuple[float, float, float]] = {GROUND: (SIDE, ground, WIDTH - 2.0 * SIDE)}
    for k, names in enumerate(levels):
        # Upper levels are narrower, to show which body is on which.
        wide = (WIDTH - 2.0 * SIDE - 24.0 * (k + 1) - 20.0 * (len(names) - 1)) / len(names)
        start = 0.5 * (WIDTH - wide * len(names) - 20.0 * (len(names) - 1))
        for j, name in enumerate(names):
            places[name] = (start + j * (wide + 20.0), ground - (k + 1) * (BODY + LINK), wide)
    parts = [_ground(ground)]
    parts += [_body(model, name, places[name]) for names in levels for name in names]
    parts += _joints(model, places)
    parts += [_drive(model, places)]
    label = escape(f"Sketch of the rig {model.name}")
    return (
        f'<svg viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{label}" fill="none" stroke="currentColor" '
        f'stroke-width="1.5" font-size="13">{"".join(parts)}</svg>'
    )


#: Colours of a stand-alone picture, the same as in the style of a page.
STYLE = (
    "svg{background:#fff;color:#1c2733;font-family:system-ui,sans-serif}.body{fill:#e8f0f6}.sensor{fill:#1f6f9f;stroke:none}"
    ".sensor-name{fill:#5a6672}.rubs,.drive{stroke:#c4481c}"
)


def picture(model: RigModel) -> str:
    """The drawing as a stand-alone SVG file."""
    head, body = sketch(model).split(">", 1)
    return f'{head} xmlns="http://www.w3.org/2000/svg"><style>{STYLE}</style>{body}\n'


def _levels(model: RigModel) -> list[list[str]]:
    # Bodies by the number of links between them and the ground.
    ends = [(link.a, link.b) for link in model.links] + [(contact.a, contact.b) for contact in model.contacts]
    placed = {GROUND}
    levels: list[list[str]] = []
    while True:
        above = [b.name for b in model.bodies if b.name not in placed and any(b.name in e and placed & {*e} for e in ends)]
        if not above:
            # What no joint leads to from the ground stands by itself.
            alone = [body.name for body in model.bodies if body.name not in placed]
            return [*levels, alone] if alone else levels
        levels.append(above)
        placed |= set(above)


def _ground(y: float) -> str:
    ticks = "".join(f'<path d="M{x} {y}l-8 10"/>' for x in range(SIDE + 10, WIDTH - SIDE, 18))
    return f'<path d="M{SIDE} {y}H{WIDTH - SIDE}" stroke-width="2.5"/>{ticks}'


def _body(model: RigModel, name: str, place: tuple[float, float, float]) -> str:
    x, y, wide = place
    sensors = [sensor.channel for sensor in model.sensors if sensor.body == name]
    seen = "".join(
        f'<circle cx="{x + 14.0 + 90.0 * k:.0f}" cy="{y + 34.0:.0f}" r="4" class="sensor"/>'
        f"{_words(x + 23.0 + 90.0 * k, y + 38.0, channel, 'sensor-name')}"
        for k, channel in enumerate(sensors)
    )
    mass = f"{name}, {model.body(name).mass:.3g} {unit_of(f'bodies.{name}.mass', model)}"
    box = f'<rect x="{x:.0f}" y="{y:.0f}" width="{wide:.0f}" height="{BODY}" rx="4" class="body"/>'
    return f"{box}{_words(x + 10.0, y + 18.0, mass)}{seen}"


def _words(x: float, y: float, text: str, kind: str = "") -> str:
    named = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.0f}" y="{y:.0f}" fill="currentColor" stroke="none"{named}>{escape(text)}</text>'


def _joints(model: RigModel, places: dict[str, tuple[float, float, float]]) -> list[str]:
    parts = []
    for link in model.links:
        if link.a in places and link.b in places:
            top, bottom, x = _gap(places[link.a], places[link.b], 0.12)
            parts += [_spring(x, top, bottom), _words(x + 14.0, 0.5 * (top + bottom) + 4.0, link.name)]
    for contact in model.contacts:
        if contact.a in places and contact.b in places:
            top, bottom, x = _gap(places[contact.a], places[contact.b], 0.62)
            parts.append(f'<path d="M{x:.0f} {top:.0f}V{bottom:.0f}" class="rubs" stroke-width="5" stroke-dasharray="3 4"/>')
            # Two lines: next to a narrow body there is no room for one.
            middle = 0.5 * (top + bottom)
            parts.append(_words(x + 8.0, middle - 4.0, "friction"))
            parts.append(_words(x + 8.0, middle + 12.0, f"({contact.law.__struct_config__.tag})"))
    return parts


def _gap(a: Sequence[float], b: Sequence[float], share: float) -> tuple[float, float, float]:
    # From the bottom of the upper body to the top of the lower one, at a share of the upper one's width.
    upper, lower = (a, b) if a[1] < b[1] else (b, a)
    return upper[1] + BODY, lower[1], upper[0] + share * upper[2]


def _spring(x: float, top: float, bottom: float) -> str:
    step = (bottom - top) / (2.0 * SPRING + 2.0)
    zigzag = "".join(f"l{8 if k == 0 else (16 if k % 2 == 0 else -16)} {step:.2f}" for k in range(2 * SPRING))
    return f'<path d="M{x:.1f} {top:.1f}v{step:.2f}{zigzag}L{x:.1f} {bottom - step:.2f}V{bottom:.1f}"/>'


def _drive(model: RigModel, places: dict[str, tuple[float, float, float]]) -> str:
    parts = []
    count: dict[str, int] = {}
    for drive in model.drives:
        driven = next((name for name in (drive.imposes, *drive.pushes) if name in places), None)
        if driven is None:
            continue
        x, y, wide = places[driven]
        # Several on one body next to each other.
        end = x + wide - 8.0 - 120.0 * count.setdefault(driven, 0)
        count[driven] += 1
        shaft = f"M{end - 84.0:.0f} {y - 8.0:.0f}H{end:.0f}"
        heads = f"m-8 -5l8 5l-8 5M{end - 76.0:.0f} {y - 13.0:.0f}l-8 5l8 5"
        word = "drive" if drive.imposes is None else "imposed"
        parts.append(f'<path d="{shaft}{heads}" class="drive"/>{_words(end - 84.0, y - 16.0, f"{word}: {drive.channel}")}')
    return "".join(parts)
