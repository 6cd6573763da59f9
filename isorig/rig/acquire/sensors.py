"""The sensors of a plan compared with the laboratory's list (CSV) and with the data sheets in their memories (TEDS)."""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from isorig.drivers.instrument import Describing
from isorig.drivers.teds import decode
from isorig.rig.acquire.plan import ChannelPlan, Plan
from isorig.rig.acquire.policy import SENSITIVITY_DIFFERENCE
from isorig.rig.errors import PlanError
from isorig.rig.files.inputs import content_of

#: Standard acceleration of gravity, m/s^2, for sensitivities per g.
GRAVITY = 9.80665
#: Units of sensitivities in the list, in the unit of the plan.
UNITS = {"V/(m/s^2)": 1.0, "mV/(m/s^2)": 1e-3, "V/g": 1.0 / GRAVITY, "mV/g": 1e-3 / GRAVITY, "V/N": 1.0, "mV/N": 1e-3, "V/V": 1.0}
#: Columns of the list; the others are ignored.
NEEDED, OPTIONAL = ("serial_number", "sensitivity", "unit"), ("calibrated", "due", "model")
#: Largest list.
MOST_ROWS, LARGEST = 10_000, 1 << 22


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A sensor's sheet: sensitivity in the unit of the plan, dates of its calibration and of the next one, where it is from, and
    the quantity that it measures, empty if unknown."""

    serial_number: str
    sensitivity: float | None
    calibrated: date | None = None
    due: date | None = None
    source: str = ""
    quantity: str = ""


def read_list(path: Path) -> dict[str, Sheet]:
    """The sensors of a list by serial number. Raises PlanError, with the row and what is allowed, if one is invalid."""
    try:
        rows = list(csv.reader(content_of(path, LARGEST).decode("utf-8-sig").splitlines()))
    except OSError as error:
        raise PlanError(f"{path} cannot be read ({error.strerror}); give the laboratory's list of sensors, a CSV file") from None
    except (UnicodeDecodeError, csv.Error):
        raise PlanError(f"{path} is not CSV text; save the list of sensors as CSV in UTF-8") from None
    if not rows or len(rows) > MOST_ROWS:
        raise PlanError(f"{path} has {len(rows)} rows; a list of sensors has a row of names, and up to {MOST_ROWS} rows")
    names = [name.strip().lower() for name in rows[0]]
    missing = [name for name in NEEDED if name not in names]
    if missing:
        raise PlanError(f"{path} lacks the columns {', '.join(missing)}; a list of sensors has {', '.join(NEEDED + OPTIONAL)}")
    found: dict[str, Sheet] = {}
    for number, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        here = f"{path}: row {number}"
        sheet = _sheet(dict(zip(names, (cell.strip() for cell in row), strict=False)), here, path.name)
        if sheet.serial_number in found:
            raise PlanError(f"{here} has the serial number {sheet.serial_number!r} a second time; each sensor has one row")
        found[sheet.serial_number] = sheet
    return found


def _sheet(row: Mapping[str, str], here: str, source: str) -> Sheet:
    serial = row.get("serial_number", "")
    if not serial or not serial.isprintable():
        raise PlanError(f"{here} has no serial number; each sensor has one")
    unit = row.get("unit", "")
    if unit not in UNITS:
        raise PlanError(f"{here} has the unit {unit!r}; allowed are {', '.join(UNITS)}")
    try:
        sensitivity = float(row.get("sensitivity", "")) * UNITS[unit]
    except ValueError:
        sensitivity = math.nan
    if not 0.0 < abs(sensitivity) < math.inf:
        raise PlanError(f"{here} has the sensitivity {row.get('sensitivity', '')!r}; give a number other than 0")
    return Sheet(
        serial_number=serial, sensitivity=sensitivity, calibrated=_date(row.get("calibrated", ""), here),
        due=_date(row.get("due", ""), here), source=source,
    )  # fmt: skip


def _date(text: str, here: str) -> date | None:
    if not text:
        return None
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise PlanError(f"{here} has the date {text!r}; write dates as 2026-01-31") from None


def memories(plan: Plan, instrument: object) -> dict[str, Sheet]:
    """The data sheets in the sensors' memories by channel, where the instrument hands them out. Raises ProtocolError if a memory
    holds something else."""
    if not isinstance(instrument, Describing):
        return {}
    found: dict[str, Sheet] = {}
    for name, channel in plan.channels.items():
        if data := instrument.memory(channel.input):
            teds = decode(data)
            sensitivity = instrument.force_sensitivity(channel.input) if teds.quantity == "force" else teds.sensitivity
            found[name] = Sheet(
                serial_number=str(teds.serial_number), sensitivity=sensitivity, calibrated=teds.calibrated, due=teds.due,
                source="its memory", quantity=teds.quantity,
            )  # fmt: skip
    return found


def compare(plan: Plan, known: Mapping[str, Sheet], read: Mapping[str, Sheet], today: date) -> list[str]:
    """What contradicts the plan, each as a sentence with the remedy.

    `known` is the laboratory's list by serial number, `read` are the sheets in the sensors' memories by channel.
    """
    channels = plan.channels.items()
    return [*_twice(plan), *(text for name, channel in channels for text in _one(plan, name, channel, known, read, today))]


def refuse_sensors(plan: Plan, instrument: object) -> None:
    """Compare the plan with its list and with the memories that an instrument hands out, before the first run. Raises PlanError
    if they contradict each other, or the list cannot be read; ProtocolError if a memory cannot be read."""
    known = read_list(Path(plan.sensors)) if plan.sensors else {}
    found = compare(plan, known, memories(plan, instrument), date.today())
    if found:
        raise PlanError(f"the session was not started: {'; '.join(found)}; --force starts it anyway")


def _twice(plan: Plan) -> Iterator[str]:
    names: dict[str, str] = {}
    for name, channel in plan.channels.items():
        serial = channel.serial_number
        if serial and serial in names:
            yield f"the channels {names[serial]} and {name} name the same sensor {serial}; correct serial_number"
        names.setdefault(serial, name)


def _one(
    plan: Plan, name: str, channel: ChannelPlan, known: Mapping[str, Sheet], read: Mapping[str, Sheet], today: date
) -> Iterator[str]:
    serial = channel.serial_number
    sheets: list[Sheet] = []
    if name in read:
        own = read[name]
        if serial and own.serial_number != serial:
            other = next((n for n, c in plan.channels.items() if c.serial_number == own.serial_number), None)
            swapped = f", which the plan has at {other}: exchange the cables" if other else "; correct serial_number"
            yield f"the sensor at input {channel.input} ({name}) is {own.serial_number}, not {serial}{swapped}"
        sheets.append(own)
    if serial and known and serial not in known:
        yield f"{name} names the sensor {serial}, which is not in {plan.sensors}; add it, or correct serial_number"
    if serial in known:
        sheets.append(known[serial])
    for sheet in sheets:
        yield from _sheet_against(name, channel, sheet, today)


def _sheet_against(name: str, channel: ChannelPlan, sheet: Sheet, today: date) -> Iterator[str]:
    if sheet.quantity and sheet.quantity != channel.quantity:
        yield f"{name} is {channel.quantity} in the plan, and its sensor measures {sheet.quantity} by {sheet.source}; correct one"
    elif sheet.sensitivity is not None and abs(channel.sensitivity / sheet.sensitivity - 1.0) > SENSITIVITY_DIFFERENCE:
        yield (
            f"the sensitivity of {name} is {channel.sensitivity:.6g} in the plan and {sheet.sensitivity:.6g} in {sheet.source}; "
            "correct the one that is wrong"
        )
    if sheet.due is not None and sheet.due < today:
        yield f"the calibration of {sheet.serial_number} ({name}) expired on {sheet.due}, by {sheet.source}; have it calibrated"
    if sheet.calibrated is not None and sheet.calibrated > today:
        yield f"the calibration of {sheet.serial_number} ({name}) is dated {sheet.calibrated}, after today; correct the date"
    if channel.calibrated and sheet.calibrated is not None and channel.calibrated != sheet.calibrated.isoformat():
        yield f"{name} was calibrated on {channel.calibrated} by the plan, on {sheet.calibrated} by {sheet.source}; correct one"


def lines(plan: Plan, known: Mapping[str, Sheet], read: Mapping[str, Sheet]) -> Sequence[str]:
    """One line for each channel: its sensor, sensitivity and dates."""
    found = []
    for name, channel in plan.channels.items():
        sheet = read.get(name) or known.get(channel.serial_number)
        serial = (sheet.serial_number if sheet else channel.serial_number) or "no serial number"
        dates = "" if sheet is None else f", calibrated {sheet.calibrated or 'unknown'}, due {sheet.due or 'unknown'}"
        found.append(f"{name}: input {channel.input}, {serial}, {channel.sensitivity:.6g} V per {channel.unit}{dates}")
    return found
