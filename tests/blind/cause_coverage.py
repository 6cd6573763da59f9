"""The study of a cause's uncertainty: how often the stated 95 % intervals hold the true parameters of sealed rigs.

`python tests/blind/cause_coverage.py --minutes 25` draws rigs of another simulation with every catalogued cause in turn, fits the
true cause from its true values, and compares; it goes on where docs/study/cause-coverage.csv ends and can be stopped at any
time. With `--minutes 0` it prints the shares and writes them to docs/theory.md alone.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd
from scipy.stats import binomtest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent / "foreign"))

from effects import EFFECTS
from foreign_campaign import Setting, draw
from rigs import FAMILIES
from study_table import append

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.errors import AnalysisError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.division import refined
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.score import score
from isorig.analysis.fitting.solve import Fit, fit
from isorig.analysis.fitting.uncertainty import assessed
from isorig.analysis.jackknife import NORMAL
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.files.recording import read
from isorig.rig.files.rigfile import rig_of

DOCS = Path(__file__).parents[2] / "docs"
TABLE, PAGE = DOCS / "study" / "cause-coverage.csv", DOCS / "theory.md"
COLUMNS = ("seed", "family", "cause", "place", "severity", "parameter", "own", "truth", "value", "std", "explained")
#: First seed; sizes of an effect, in turn.
FIRST, SIZES = 50000, (1.0, 1.0 / 3.0)
#: Steps per second of the other simulation: its own error must be small compared with the uncertainties.
FINEST, FINEST_BONDER = 131072.0, 262144.0
#: Causes that are counted. The levers of a rocking motor have no scale of their own, and the baseline has the mass of a lock.
CAUSES = tuple(name for name, effect in EFFECTS.items() if effect.cause == name and name != "moment_coupling")
#: Values at a bound, which no interval around them holds: a stop of the other simulation has no damping.
AT_BOUND = ("contact_damping", "residual", "forward_viscosity", "backward_viscosity")
BEGIN, END = "<!-- coverage of causes -->\n", "<!-- end -->\n"


def known(model: RigModel, values: Mapping[str, float]) -> RigModel:
    """The model with the values whose paths it has."""
    kept = {}
    for path, value in values.items():
        try:
            model.get(path)
        except AnalysisError:
            continue
        kept[path] = value
    return model.replace(kept)


def true_values(
    candidate: Candidate, model: RigModel, told: Mapping[str, float], values: Mapping[str, float]
) -> dict[str, float]:
    """The true values that the answer tells, by path."""
    if candidate.cause == "wrong_mass":
        return {reported.path: values[reported.path] for reported in candidate.reported if reported.path in values}
    if candidate.cause == "extra_mode":
        name, omega = f"{candidate.location}_added", 2.0 * np.pi * told["mode_frequency"]
        mass = told["mode_mass"]
        return {
            f"bodies.{name}.mass": mass, f"links.{name}.stiffness": mass * omega**2,
            f"links.{name}.damping": 2.0 * told["mode_damping"] * mass * omega,
        }  # fmt: skip
    if candidate.cause == "mains_hum":
        return {reported.path: float(round(reported.of(model), -1)) for reported in candidate.reported}
    names = {**told, "friction_force": told.get("friction_force", told.get("slip_force", np.nan))}
    return {r.path: names[r.name] for r in candidate.reported if np.isfinite(names.get(r.name, np.nan))}


def true_fit(campaign: Campaign, answer: Mapping[str, Any]) -> tuple[Candidate, Fit, dict[str, float]] | None:
    """The true cause, fitted from its true values, and these; None if the catalogue has no such place."""
    effect, values = answer["effects"][0], answer["values"]
    base = known(rig_of(campaign), values)
    trials = prepare(campaign, base)
    cause = next(one for one in CATALOGUE if one.name == effect["cause"])
    found = []
    for candidate in cause.candidates(base, observe(campaign, base, trials, base, base)):
        if candidate.location != effect["place"]:
            continue
        start = candidate.starts[0]
        if candidate.cause == "extra_mode":  # its start has other masses beside it
            name = f"{candidate.location}_added"
            start = msgspec.structs.replace(base, bodies=(*base.bodies, start.body(name)), links=(*base.links, start.link(name)))
        true = true_values(candidate, start, effect["parameters"], values)
        low = {f.path: max(f.low, 1e-6 * start.get(f.path)) for f in candidate.free if f.path.endswith("contact_damping")}
        free = candidate.parameters(base)
        own = {f.path for f in candidate.free}
        rest = {f.path: base.get(f.path) for f in free if f.path not in own}
        found.append((candidate, free, start.replace({**rest, **low, **true}), {**rest, **true}))
    if not found:
        return None
    # Crosstalk may come from several channels: the answer does not tell from which.
    candidate, free, model, true = min(found, key=lambda one: score(one[2], trials).figure)
    fine = [refined(trial) for trial in trials]
    return candidate, fit(model, free, Problem(fine, share=SIMULATION_LIMIT), iterations=12), true


def rows_of(seed: int, cause: str, family: str, severity: float) -> list[dict[str, object]]:
    """A rig's parameters: what is true, what is found, and its standard uncertainty; empty if it has no place for the cause."""
    finest = FINEST_BONDER if family == "wire_bonder" else FINEST
    with tempfile.TemporaryDirectory() as folder:
        setting = Setting(severity=severity, soiled=False, effects=(cause,), finest=finest)
        made = draw(family, seed, setting, Path(folder))
        if made is None:
            return []
        answer, campaign = json.loads(made[1].read_text()), read(made[0])
        found = true_fit(campaign, answer)
        if found is None:
            return []
        candidate, rough, true = found
        fine = [refined(trial) for trial in prepare(campaign, rough.model)]
        final = assessed(rough, fine, campaign.known)
    own, std = {reported.path for reported in candidate.reported}, final.fit.std
    return [
        {
            "seed": seed, "family": family, "cause": cause, "place": candidate.location, "severity": f"{severity:.2f}",
            "parameter": path, "own": int(path in own or path in {f.path for f in candidate.free}), "truth": f"{true[path]:.9g}",
            "value": f"{value:.9g}", "std": f"{std[path]:.4g}", "explained": int(final.explained),
        }
        for path, value in final.fit.values.items()
        if path in true and not path.endswith(AT_BOUND)
    ]  # fmt: skip


def covered(rows: pd.DataFrame) -> str:
    """The share of the intervals that hold the truth, with its own interval (Wilson 1927)."""
    if not len(rows):
        return "none yet"
    hits = int((np.abs(rows["value"] - rows["truth"]) <= NORMAL * rows["std"]).sum())
    limits = binomtest(hits, len(rows)).proportion_ci(method="wilson")
    return f"{hits} of {len(rows)}: {100 * hits / len(rows):.1f} % ({100 * limits.low:.0f} to {100 * limits.high:.0f} %)"


def page() -> str:
    """The table of docs/theory.md."""
    table = pd.read_csv(TABLE)
    own, others = table[table["own"] == 1], table[table["own"] == 0]
    lines = ["| cause | its own parameters | median of |error| / standard uncertainty |", "|---|---|---|"]
    for cause in CAUSES:
        rows = own[own["cause"] == cause]
        if len(rows):
            away = np.median(np.abs(rows["value"] - rows["truth"]) / rows["std"])
            lines.append(f"| {cause.replace('_', ' ')} | {covered(rows)} | {away:.2f} |")
    damping = others[others["parameter"].str.endswith("damping")]
    lines += [
        f"| all causes | {covered(own)} | {np.median(np.abs(own['value'] - own['truth']) / own['std']):.2f} |",
        f"| the rigs' other values | {covered(others)} | "
        f"{np.median(np.abs(others['value'] - others['truth']) / others['std']):.2f} |",
        f"| of these, dampings | {covered(damping)} | "
        f"{np.median(np.abs(damping['value'] - damping['truth']) / damping['std']):.2f} |",
    ]
    lines[0] = lines[0].replace("|error|", "error")
    return f"{table['seed'].nunique()} rigs.\n\n" + "\n".join(lines) + "\n\n"


def write_page() -> None:
    """The shares in docs/theory.md."""
    text = PAGE.read_text(encoding="utf-8")
    start, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    PAGE.write_text(text[:start] + page() + text[end:], encoding="utf-8")


def main() -> None:
    """Draw, fit, write the table, and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=25.0, help="processor time")
    until = time.process_time() + 60.0 * parser.parse_args().minutes
    seed = FIRST if not TABLE.exists() else int(pd.read_csv(TABLE)["seed"].max()) + 1
    families = list(FAMILIES)
    while time.process_time() < until:
        turn = (seed - FIRST) // len(CAUSES)
        cause, severity = CAUSES[(seed - FIRST) % len(CAUSES)], SIZES[turn % len(SIZES)]
        # The families take turns; the next one that has a place for the cause.
        for k in range(len(families)):
            rows = rows_of(seed, cause, families[(seed + turn + k) % len(families)], severity)
            if rows:
                break
        for row in rows:
            append(TABLE, COLUMNS, row)
        print(seed, cause, len(rows), flush=True)
        seed += 1
    if TABLE.exists():
        print(page())
        write_page()


if __name__ == "__main__":
    main()
