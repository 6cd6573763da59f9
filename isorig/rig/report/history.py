"""The parameter table compared with earlier campaigns, and the significant changes."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from math import hypot

from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.wording import with_std
from isorig.rig.files.parameter_table import ParameterFile
from isorig.rig.report.page import Section, Table
from isorig.rig.report.sections import number, words

#: Change in standard deviations that counts as significant.
CHANGED = 3.0


def history_sections(found: Characterization, history: Sequence[ParameterFile]) -> list[Section]:
    """A table with a column for each earlier campaign, oldest first; empty without history."""
    if not history:
        return []
    past = sorted(history, key=lambda item: item.measured or datetime.min.replace(tzinfo=UTC))
    last = past[-1]
    rows, sentences = [], []
    for name, entry in found.table.items():
        change = _change(entry.value, entry.std, last.values.get(name))
        if change is not None and abs(change) > CHANGED:
            sentences.append(f"{words(name).capitalize()} has changed by {change:+.1f} standard deviations since {_label(last)}.")
        earlier = (_shown(item.values.get(name)) for item in past)
        now = _shown(None if entry.value is None else (entry.value, entry.std or 0.0))
        rows.append((words(name), entry.unit, *earlier, now, "–" if change is None else f"{change:+.1f}"))
    table = Table(
        columns=("parameter", "unit", *(_label(item) for item in past), "now", "change, deviations"), rows=rows,
        caption="Value ± standard uncertainty, none where a value was given; the change is since the latest earlier campaign.",
    )  # fmt: skip
    quiet = f"No parameter has changed by more than {CHANGED:g} standard deviations since {_label(last)}."
    return [Section(title="Parameters compared with earlier campaigns", text=sentences or [quiet], tables=[table])]


def _label(item: ParameterFile) -> str:
    return item.campaign if item.measured is None else f"{item.campaign}, {item.measured:%Y-%m-%d}"


def _shown(pair: tuple[float, float] | None) -> str:
    if pair is None:
        return "–"
    return number(pair[0], 6) if pair[1] == 0.0 else with_std(*pair)


def _change(value: float | None, std: float | None, before: tuple[float, float] | None) -> float | None:
    spread = hypot(std or 0.0, before[1]) if before is not None else 0.0
    return None if value is None or before is None or spread == 0.0 else (value - before[0]) / spread
