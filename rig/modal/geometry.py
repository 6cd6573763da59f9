"""Where the points of mode shapes lie in a picture: on the rig's description, at given coordinates, or in a row."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import msgspec

from isorig.analysis.errors import DataError
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.files.inputs import regular
from isorig.rig.report.sketch import BODY, layout

#: Screen directions (x to the right, y down) of the axes of coordinates: y is drawn obliquely to the back.
AXES = {"x": (1.0, 0.0), "y": (0.35, -0.35), "z": (0.0, -1.0)}
#: Columns of a file of coordinates.
COLUMNS = ("channel", "x", "y", "z", "direction")
#: Width of a picture, and the largest displacement in it, as a share of its larger side.
WIDE, MOVED = 640.0, 0.12


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """A response in the picture: its place, the size of its box (0 for a point), the direction in which it moves.

    `channel` is empty for a body without a sensor, which is drawn but does not move.
    """

    channel: str
    label: str
    x: float
    y: float
    width: float = 0.0
    height: float = 0.0
    move_x: float = 0.0
    move_y: float = 0.0


class Geometry(msgspec.Struct, frozen=True, kw_only=True):
    """All points of a picture with its size; `joined` where a line connects them in their order."""

    points: tuple[Point, ...]
    width: float
    height: float
    joined: bool


def of_row(responses: Sequence[str]) -> Geometry:
    """Responses in a row from left to right, moving up and down."""
    step = WIDE / (len(responses) + 1)
    points = tuple(
        Point(channel=name, label=name, x=step * (k + 1), y=0.25 * WIDE, move_y=-MOVED * WIDE) for k, name in enumerate(responses)
    )
    return Geometry(points=points, width=WIDE, height=0.5 * WIDE, joined=True)


def of_description(model: RigModel, responses: Sequence[str]) -> Geometry | None:
    """The bodies of a description as in its sketch, moving to the side; None where it does not have all responses on bodies.

    A body takes the first response that is on it.
    """
    on = {sensor.channel: sensor.body for sensor in model.sensors}
    if any(on.get(name, "") not in {body.name for body in model.bodies} for name in responses):
        return None
    found, width, height = layout(model)
    first: dict[str, str] = {}
    for name in responses:
        first.setdefault(on[name], name)
    points = tuple(
        Point(
            channel=first.get(body.name, ""), label=body.name, x=x, y=y, width=wide, height=BODY,
            move_x=MOVED * width if body.name in first else 0.0,
        )
        for body in model.bodies
        for x, y, wide in (found[body.name],)
    )  # fmt: skip
    return Geometry(points=points, width=width, height=height, joined=False)


def of_file(path: Path, responses: Sequence[str]) -> Geometry:
    """Points of a CSV file: channel, x, y, z (any one unit) and direction (x, y, z, -x, -y or -z), joined in the file's order.

    Raises
    ------
    DataError
        Where columns or channels are missing, or a value cannot be used.
    """
    try:
        regular(path)
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{path} cannot be read as CSV ({error}); write a table with {', '.join(COLUMNS)}") from None
    if not rows or not set(COLUMNS) <= set(rows[0]):
        raise DataError(f"{path} lacks columns; write a table with the columns {', '.join(COLUMNS)}")
    flat: list[tuple[str, float, float, float, float]] = []
    for number, row in enumerate(rows, 2):
        name, direction = (row["channel"] or "").strip(), (row["direction"] or "").strip()
        if name not in responses:
            raise DataError(f"{path}, line {number}: there is no response {name!r}; there are {', '.join(responses)}")
        if direction.lstrip("-") not in AXES:
            raise DataError(f"{path}, line {number}: the direction is {direction!r}; give x, y, z, -x, -y or -z")
        try:
            at = [float(row[axis]) for axis in AXES]
        except (TypeError, ValueError):
            raise DataError(f"{path}, line {number}: x, y or z is no number; give all three") from None
        sign = -1.0 if direction.startswith("-") else 1.0
        across, down = AXES[direction.lstrip("-")]
        place = [sum(c * AXES[axis][k] for c, axis in zip(at, AXES, strict=True)) for k in (0, 1)]
        flat.append((name, place[0], place[1], sign * across, sign * down))
    absent = [name for name in responses if name not in {row[0] for row in flat}]
    if absent:
        raise DataError(f"{path} has no row for the response {absent[0]!r}; add it")
    return _fitted(flat)


def _fitted(flat: Sequence[tuple[str, float, float, float, float]]) -> Geometry:
    left, top = min(row[1] for row in flat), min(row[2] for row in flat)
    wide, high = max(row[1] for row in flat) - left, max(row[2] for row in flat) - top
    scale, margin = 0.7 * WIDE / (max(wide, high) or 1.0), 0.15 * WIDE
    points = tuple(
        Point(
            channel=name, label=name, x=margin + (x - left) * scale, y=margin + (y - top) * scale,
            move_x=MOVED * WIDE * across, move_y=MOVED * WIDE * down,
        )
        for name, x, y, across, down in flat
    )  # fmt: skip
    return Geometry(points=points, width=wide * scale + 2.0 * margin, height=high * scale + 2.0 * margin, joined=True)
