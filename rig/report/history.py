"""The parameter table beside its history: what earlier campaigns found, and what has changed by more than its deviation."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from math import hypot

import numpy as np

from analysis.characterize import Characterization
from rig.characterized import ParameterFile
from rig.report.charts import SERIES, Chart, Panel, Trace
from rig.report.page import Section, Table
from rig.report.sections import number, words

#: Deviations from which on a change counts.
CHANGED = 3.0


def history_sections(found: Characterization, history: Sequence[ParameterFile]) -> list[Section]:
    """A table with a column for each earlier campaign, oldest first, and a chart of how they moved; nothing without history."""
    if not history:
        return []
    past = sorted(history, key=lambda item: item.measured or datetime.min.replace(tzinfo=UTC))
    last = past[-1]
    rows, told = [], []
    for name, entry in found.table.items():
        change = _change(entry.value, entry.std, last.values.get(name))
        if change is not None and abs(change) > CHANGED:
            told.append(f"{words(name).capitalize()} has changed by {change:+.1f} deviations since {_label(last)}.")
        earlier = (_shown(item.values.get(name)) for item in past)
        now = _shown(None if entry.value is None else (entry.value, entry.std or 0.0))
        rows.append((words(name), entry.unit, *earlier, now, "–" if change is None else f"{change:+.1f}"))
    table = Table(
        columns=("parameter", "unit", *(_label(item) for item in past), "now", "change, deviations"), rows=rows,
        caption="Value ± one standard deviation; the change is since the last of the earlier campaigns.",
    )  # fmt: skip
    quiet = f"No parameter has changed by more than {CHANGED:g} deviations since {_label(last)}."
    return [Section(title="Parameters beside their history", text=told or [quiet], tables=[table], charts=[_chart(found, past)])]


def _chart(found: Characterization, past: Sequence[ParameterFile]) -> Chart:
    shown = [name for name, entry in found.table.items() if entry.value and entry.method != "given"]
    traces = []
    for k, name in enumerate(shown):
        now = found.table[name].value or 1.0
        points = [item.values.get(name, (np.nan, np.nan)) for item in past] + [(now, found.table[name].std or 0.0)]
        value, std = (100.0 * np.array(column) / now for column in zip(*points, strict=True))
        x = np.arange(len(points), dtype=np.float64) + 1.0
        traces.append(
            Trace(
                name=words(name), x=x, y=value - 100.0, spread=std, role=SERIES[k % len(SERIES)],
                style="solid" if k < len(SERIES) else "dash",
            )
        )  # fmt: skip
    return Chart(
        name="history", caption="Each parameter in per cent of its value now, campaign by campaign, oldest first.",
        panels=[Panel(label="difference from now, %")], traces=traces, x_label="campaign", x_log=False,
    )  # fmt: skip


def _label(item: ParameterFile) -> str:
    return item.campaign if item.measured is None else f"{item.campaign}, {item.measured:%Y-%m-%d}"


def _shown(pair: tuple[float, float] | None) -> str:
    return "–" if pair is None else f"{number(pair[0], 6)} ± {number(pair[1], 2)}"


def _change(value: float | None, std: float | None, before: tuple[float, float] | None) -> float | None:
    spread = hypot(std or 0.0, before[1]) if before is not None else 0.0
    return None if value is None or before is None or spread == 0.0 else (value - before[0]) / spread
