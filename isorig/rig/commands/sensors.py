"""Compares a plan's sensors with their calibration sheets."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def sensors(plan: Path, *, listed: Annotated[Path | None, Parameter(name="--list")] = None, port: str | None = None) -> None:
    """Compare the sensors of a plan with the laboratory's list, and with the data sheets in their memories (TEDS).

    Reported are expired calibrations, sensors at another input than in the plan, and sensitivities that differ by more than 1 %.
    rig acquire makes the same comparison before the first run.

    Example: rig sensors session.toml --list sensors.csv

    Parameters
    ----------
    plan
        The plan of the session; its channels name the sensors by serial_number.
    listed
        The list, CSV with the columns serial_number, sensitivity and unit, and optionally calibrated and due; by default that of
        the plan (sensors).
    port
        Read the memories with the plan's instrument at this port; without it, none is read.
    """
    from datetime import date

    from isorig.rig.acquire.instruments import opened
    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.acquire.sensors import compare, lines, memories, read_list
    from isorig.rig.errors import PlanError

    planned = read_plan(plan, runs=False)
    place = listed or (Path(planned.sensors) if planned.sensors else None)
    if place is None and port is None:
        raise PlanError(f"{plan} names no list of sensors; give --list sensors.csv, or --port to read the sensors' memories")
    known = {} if place is None else read_list(place)
    read = {}
    if port is not None and not planned.instrument.analyzer:
        with opened(planned, port) as instrument:
            read = memories(planned, instrument)
    for line in lines(planned, known, read):
        print(line)
    found = compare(planned, known, read, date.today())
    if found:
        raise PlanError("; ".join(found))
