"""Sections of every report: the rig and its runs, and the source of the numbers."""

from __future__ import annotations

import hashlib
import math
import re
import sys
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.wording import displayed_unit, sized, state, words
from isorig.rig.report.page import Section, Table
from isorig.rig.wire_bonder.description import SUMMARY

if TYPE_CHECKING:
    from isorig.analysis.parameters.joint_fit import Entry
    from isorig.rig.files.findings import Value

#: Text for missing information of a recording.
NOT_GIVEN = "not given"
#: Of a diagnosis that reached its time limit.
CUT_SHORT = "The time limit ended the search for causes before all were tried."
#: Advice where no whole run was held out.
HOLD_OUT = 'Record one more run with use = "holdout": a whole held-out run tests the model more strictly.'
#: Number from which on a table gives an exponent: before that, digits are easier to compare.
PLAIN_MOST = 1e7
LIBRARIES = ("isorig", "numpy", "scipy", "numba", "h5py")


def unbroken(text: str) -> str:
    """A sentence whose numbers stay with their uncertainties and units when it wraps."""
    return re.sub(r"(?<=[\d±]) (?=[±\d%]|[a-zA-Zµ]{1,2}(?:[ ,;.)/²³]|$))", "\u00a0", text)


def label(run: Run, alone: bool) -> str:
    """Name of a run in a legend."""
    return f"{run.id} ({state(run.configuration, run.gain, alone)})"


def number(value: float | None, digits: int = 5) -> str:
    """A number for a table, with an exponent only above `PLAIN_MOST`; a dash if there is none.

    Examples
    --------
    >>> number(104.0, 2), number(6409764.2, 6), number(3.1e9, 2), number(None)
    ('100', '6409760', '3.1e+09', '–')
    """
    if value is None:
        return "–"
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < PLAIN_MOST else text


def channels_table(campaign: Campaign) -> Table:
    """Every channel with its quantity, sensor, place and range as far as given, from the first run that has it."""
    first: dict[str, Channel] = {}
    for run in campaign.runs:
        for name, channel in run.sensors.items():
            first.setdefault(name, channel)
    columns: dict[str, list[str]] = {
        "channel": list(first),
        "quantity": [f"{words(channel.quantity)}, {displayed_unit(channel.unit)}" for channel in first.values()],
        "sensor": [channel.about.get("sensor") or NOT_GIVEN for channel in first.values()],
        "place": [channel.about.get("place") or NOT_GIVEN for channel in first.values()],
        "range": [
            NOT_GIVEN if channel.full_scale is None else f"±{channel.full_scale:.3g}\u00a0{displayed_unit(channel.unit)}"
            for channel in first.values()
        ],
    }
    # A description that is not given has no column.
    shown = {name: column for name, column in columns.items() if set(column) != {NOT_GIVEN}}
    return Table(columns=tuple(shown), rows=list(zip(*shown.values(), strict=True)))


def runs_section(campaign: Campaign) -> Section:
    """The measured runs, and the given values."""
    columns: dict[str, list[str]] = {
        "run": [run.id for run in campaign.runs],
        **({} if campaign.alone else {"configuration": [run.configuration for run in campaign.runs]}),
        "gain": [f"{run.gain:g}" for run in campaign.runs],
        "excitation": [run.excitation for run in campaign.runs],
        "band, Hz": ["" if run.band is None else f"{run.band[0]:g}–{run.band[1]:g}" for run in campaign.runs],
        "s": [f"{run.duration:.0f}" for run in campaign.runs],
        "samples/s": [f"{run.sample_rate:g}" for run in campaign.runs],
        "use": [run.use for run in campaign.runs],
        "lost": [f"{sum(gap.count for gap in run.gaps) or ''}" for run in campaign.runs],
        "started": ["" if run.started is None else f"{run.started:%Y-%m-%d %H:%M:%S %z}" for run in campaign.runs],
    }
    known = ", ".join(f"{words(name)} {value:.6g}" for name, value in campaign.known.items())
    shown = {name: column for name, column in columns.items() if any(column)}
    return Section(
        title="Rig and runs",
        text=[*([] if campaign.description else [SUMMARY]), *([f"Given values (SI): {known}."] if known else [])],
        tables=[Table(columns=tuple(shown), rows=list(zip(*shown.values(), strict=True)))],
    )


def parameters_table(parameters: Mapping[str, Value]) -> Table:
    """Fitted values by path, as in findings.json."""
    caption = "Fitted to all runs at once, with standard uncertainties."
    rows = [(name, with_unit(row.value, row.unit, row.std)) for name, row in parameters.items()]
    return Table(columns=("parameter", "value ± std"), rows=rows, caption=caption)


def entries_table(entries: Mapping[str, Entry]) -> Table:
    """The parameters of a joint fit by name."""
    rows = [(name, with_unit(e.value, e.unit, e.uncertainty), e.method, e.note) for name, e in entries.items()]
    return Table(columns=("parameter", "value ± std", "method", "note"), rows=rows)


def with_unit(value: float | None, unit: str, std: float | None = None) -> str:
    """A value for a table, with its unit and to the digits that its uncertainty justifies; a dash if there is none."""
    return "–" if value is None or not math.isfinite(value) else sized(value, unit, std, digits=4)


def provenance_section(campaign: Campaign) -> Section:
    """File, hash, versions and command."""
    path = Path(campaign.source)
    digest = "not on disk"
    if path.is_file():
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    rows = [("file", path.name), ("sha256", digest)]
    rows += [(name, version(name)) for name in LIBRARIES]
    rows += [("Python", sys.version.split()[0]), ("command", " ".join(["rig", *sys.argv[1:]]))]
    return Section(title="Source of the numbers", tables=[Table(columns=("what", "value"), rows=rows)])
