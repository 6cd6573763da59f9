"""What the study's verdicts rest on: each call of a rule with its arguments, so other thresholds can be tried without a fit.

`recorded_files` diagnoses and keeps the calls in the answer's folder, `keep` adds them to a study's table of decisions, and
`sensitivity` counts the answers that half and double of each threshold would have changed.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from functools import wraps
from pathlib import Path
from typing import Any, Literal
from unittest.mock import patch

import numpy as np

from isorig.analysis.diagnose import diagnosis, policy, step
from isorig.analysis.diagnose.policy import POLICY, Policy, Stage
from isorig.rig.diagnose import many as diagnose_many
from isorig.rig.diagnose.many import CampaignOutcome

FILE = "decisions.json"
#: Rules by the module that calls them.
RULES = {
    "verdict": diagnosis, "step_counts": diagnosis, "explains_own_channel": diagnosis, "may_be_noise": diagnosis,
    "form_stands": step, "rivals_alike": step,
}  # fmt: skip
#: Thresholds that steer the search or enter before these rules are asked: nothing recorded says what they would change.
ELSEWHERE = ("main", "settled", "rest", "refitted", "certain", "beyond_calibration", "calibrations", "scatter")
#: Thresholds that are shares or probabilities near one: half and double of what is missing to one.
NEAR_ONE = ("explained", "certain", "form_share")
#: Thresholds that are ratios: half and double of what they exceed one by.
RATIOS = ("enough", "matters", "form_alike", "form_close", "distinguishable", "beyond_calibration")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [_plain(row) for row in value] if value.ndim > 1 else [float(f"{x:.5g}") for x in value]
    if isinstance(value, Stage):
        return {key: _plain(entry) for key, entry in asdict(value).items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


@contextmanager
def recording() -> Iterator[None]:
    """Keep what every rule was asked, in the folder of each diagnosis that this process makes meanwhile."""
    of_thread = threading.local()

    def kept(name: str, rule: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(rule)
        def asked(*given: Any) -> Any:
            answer = rule(*given)
            of_thread.calls.append({"rule": name, "given": _plain(given), "answer": _plain(answer)})
            return answer

        return asked

    def diagnosed(file: Path, folder: Path, *given: Any, **more: Any) -> Any:
        of_thread.calls = []
        outcome = plain(file, folder, *given, **more)
        (folder / FILE).write_text(json.dumps(of_thread.calls))
        return outcome

    plain = diagnose_many.diagnose_file
    patches = [patch.object(module, name, kept(name, getattr(module, name))) for name, module in RULES.items()]
    patches.append(patch.object(diagnose_many, "diagnose_file", diagnosed))
    for each in patches:
        each.start()
    try:
        yield
    finally:
        for each in patches:
            each.stop()


def recorded_files(jobs: Sequence[tuple[Path, Path]], baseline: Literal["coulomb", "linear"]) -> Iterator[CampaignOutcome]:
    """Outcomes of `rig diagnose` on recordings, with the rules' calls kept in each folder."""
    with recording():
        yield from diagnose_many.diagnose_files(jobs, baseline)


def keep(folder: Path, table: Path) -> None:
    """Add the calls of one campaign to the decisions that belong to a study's table."""
    with decisions_of(table).open("a") as file:
        file.write((folder / FILE).read_text() + "\n")


def decisions_of(table: Path) -> Path:
    """Where the decisions of a study's table are kept: one line a campaign."""
    return table.with_name(f"{table.stem}-decisions.jsonl")


def varied(name: str, factor: float) -> Policy:
    """The policy with one threshold at a multiple of itself."""
    value = getattr(POLICY, name)
    if name in NEAR_ONE:
        value = max(1.0 - factor * (1.0 - value), 0.0)
    elif name in RATIOS:
        value = 1.0 + factor * (value - 1.0)
    else:
        value = min(factor * value, 1.0) if value < 1.0 else factor * value
    return replace(POLICY, **{name: value})


def decided(call: dict[str, Any], other: Policy) -> Any:
    """The answer of a recorded call under another policy."""
    rule, given = call["rule"], [np.array(x) if _is_table(x) else x for x in call["given"]]
    if rule in ("verdict", "step_counts"):
        given[0] = [Stage(**{**stage, "error": np.array(stage["error"])}) for stage in call["given"][0]]
        place = 2 if rule == "verdict" else 3
        # The adequacy threshold follows from the policy unless the data's own calibration raised it.
        given[place] = other.enough if given[place] == POLICY.enough else given[place]
    return _plain(getattr(policy, rule)(*given, policy=other))


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], list)


def changed(campaigns: Sequence[Sequence[dict[str, Any]]], other: Policy) -> tuple[int, int]:
    """Campaigns in which a rule decides otherwise, and campaigns whose verdict or number of causes changes."""
    any_rule = [[call for call in calls if decided(call, other) != call["answer"]] for calls in campaigns]
    return sum(map(bool, any_rule)), sum(any(call["rule"] == "verdict" for call in calls) for calls in any_rule)


def sensitivity(tables: Sequence[Path]) -> tuple[int, list[tuple[str, str, tuple[int, int], tuple[int, int]]]]:
    """What half and double of each threshold would have changed in studies.

    Returns
    -------
    The number of campaigns, and of each threshold its name, its value and at half and at double of it: campaigns in which a rule
    decides otherwise, and campaigns whose verdict or number of causes changes.
    """
    files = [decisions_of(table) for table in tables]
    campaigns = [json.loads(line) for file in files if file.exists() for line in file.read_text().splitlines()]
    names = [field.name for field in fields(Policy) if field.name not in ELSEWHERE]
    rows = [
        (name, f"{getattr(POLICY, name):g}", changed(campaigns, varied(name, 0.5)), changed(campaigns, varied(name, 2.0)))
        for name in names
    ]
    return len(campaigns), rows
