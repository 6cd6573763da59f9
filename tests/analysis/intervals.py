"""The study of intervals: short campaigns on random rigs, characterized, and how often 95 % intervals hold the truth.

`python tests/analysis/intervals.py --minutes 20` goes on where the table ends; it can be stopped at any time. At the end
(and with `--minutes 0` alone) it prints the share covered, parameter by parameter. `--noises` counts shorter campaigns with other
noise than that of white sensors instead, in a table of its own.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1] / "blind"))

from envelopes import drawn_rig

from isorig.analysis.campaign import Campaign
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parameters.joint_fit import characterize
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

TABLE = Path(__file__).parents[2] / "docs" / "study" / "coverage.csv"
NOISES_TABLE = TABLE.with_name("noise-coverage.csv")
COLUMNS = ("noise", "seed", "parameter", "truth", "value", "std")
TAKES = (
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=30.0, start=0.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=20.0, start=40.0, band=(0.5, 400.0)),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=20.0, start=80.0),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=20.0, start=120.0, band=(0.5, 400.0)),
)
#: Campaigns with other noise: one at each of two gains, and one locked.
SHORT = (
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=10.0, start=0.0),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=8.0, start=20.0, band=(0.5, 400.0)),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=8.0, start=40.0, band=(0.5, 400.0)),
)
#: Noise of drive and responses, as shares of the rms of each channel in each run or in all runs together; coloured noise is white
#: noise through a low-pass filter of first order at 3.3 Hz.
WHITE = "white"
NOISES = ("0.2 % of all runs", "1 % of each run", "coloured, 0.2 % of all runs", "5 % on the drive")
SENSOR, POLE = 1e-3, 0.98
#: Two-sided 95 % of the normal distribution, and what the covered share should lie in.
QUANTILE, WANTED = 1.959964, (0.90, 0.98)


def truths(model: RigModel) -> dict[str, float]:
    """The parameter table of a rig."""
    values = {"friction_force": model.get("contacts.isolation.law.friction_force")}
    for body, link in (("table", "table"), ("heatblock", "heatblock"), ("motor", "isolation")):
        m, k, c = model.body(body).mass, model.link(link).stiffness, model.link(link).damping
        values |= {
            f"{body}_mass": m, f"{body}_frequency": math.sqrt(k / m) / (2 * math.pi),
            f"{body}_damping": c / (2 * math.sqrt(k * m)),
        }  # fmt: skip
    return values


def with_noise(clean: Campaign, noise: str, drive: str, seed: int) -> Campaign:
    """A campaign without noise, and one of `NOISES` added."""
    draw = np.random.default_rng([seed, 77])
    whole = {name: np.sqrt(np.mean([np.mean(run.read(name) ** 2) for run in clean.runs])) for name in clean.runs[0].channels}
    runs = []
    for run in clean.runs:
        rows = {name: run.read(name) for name in run.channels}
        own = {name: float(values.std()) for name, values in rows.items()}
        sizes = {
            NOISES[0]: {name: 0.002 * size for name, size in whole.items()},
            NOISES[1]: {name: 0.01 * size for name, size in own.items()},
            NOISES[2]: {name: 0.002 * size for name, size in whole.items()},
            NOISES[3]: {name: 0.05 * size if name == drive else SENSOR for name, size in own.items()},
        }[noise]
        channels = {}
        for name, values in rows.items():
            added = draw.standard_normal(len(values))
            if noise == NOISES[2]:
                added = lfilter([np.sqrt(1.0 - POLE**2)], [1.0, -POLE], added)
            channels[name] = replace(run.channels[name], samples=values + sizes[name] * added, scale=1.0)
        runs.append(replace(run, channels=channels))
    return replace(clean, runs=tuple(runs))


def rows_of(seed: int, noise: str = WHITE) -> list[dict[str, object]]:
    """One campaign: what was true, what was found and how well it claims to be known."""
    model = drawn_rig(np.random.default_rng(seed))
    if noise == WHITE:
        campaign = virtual_campaign(model, TAKES, seed=seed)
    else:
        campaign = with_noise(virtual_campaign(model, SHORT, seed=seed, noise=0.0), noise, model.drive.channel, seed)
    found = characterize(campaign, baseline_model(campaign))
    true = truths(model)
    return [
        {
            "noise": noise, "seed": seed, "parameter": name, "truth": f"{true[name]:.9g}",
            "value": "" if entry.value is None else f"{entry.value:.9g}",
            "std": "" if entry.std is None else f"{entry.std:.4g}",
        }
        for name, entry in found.table.items()
        if not entry.fixed
    ]  # fmt: skip


def summary(table: Path) -> bool:
    """Print the covered share of each parameter; whether all lie in what is wanted."""
    with table.open() as file:
        all_rows = list(csv.DictReader(file))
    held = True
    for noise in dict.fromkeys(row.get("noise", WHITE) for row in all_rows):
        held &= _summary(noise, [row for row in all_rows if row.get("noise", WHITE) == noise])
    return held


def _summary(noise: str, rows: list[dict[str, str]]) -> bool:
    print(f"noise: {noise}, {len({row['seed'] for row in rows})} campaigns")
    print(f"{'parameter':22s} {'covered':>8s} {'z rms':>6s} {'std, ppm':>9s} {'refused':>8s}")
    held = True
    for name in dict.fromkeys(row["parameter"] for row in rows):
        own = [row for row in rows if row["parameter"] == name]
        told = [(float(r["truth"]), float(r["value"]), float(r["std"])) for r in own if r["value"]]
        z = np.array([(value - truth) / std for truth, value, std in told])
        share = float(np.mean(np.abs(z) <= QUANTILE))
        held &= WANTED[0] <= share <= WANTED[1]
        ppm = 1e6 * float(np.median([std / truth for truth, _, std in told]))
        print(f"{name:22s} {share:8.3f} {np.sqrt(np.mean(z**2)):6.2f} {ppm:9.1f} {len(own) - len(told):8d}")
    print(f"limits ({WANTED[0]:.0%} to {WANTED[1]:.0%} each): {'held' if held else 'broken'}")
    return held


def main() -> int:
    """Go on with the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--noises", action="store_true")
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    args.table = args.table or (NOISES_TABLE if args.noises else TABLE)
    done: set[tuple[str, int]] = set()
    if args.table.exists():
        with args.table.open() as file:
            done = {(row.get("noise", WHITE), int(row["seed"])) for row in csv.DictReader(file)}
    args.table.parent.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + 60.0 * args.minutes
    wanted = [(noise, seed) for seed in range(args.campaigns) for noise in (NOISES if args.noises else (WHITE,))]
    for noise, seed in (each for each in wanted if each not in done):
        if time.monotonic() > end:
            break
        rows = rows_of(seed, noise)
        fresh = not args.table.exists()
        with args.table.open("a", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS[not args.noises :], lineterminator="\n", extrasaction="ignore")
            if fresh:
                writer.writeheader()
            writer.writerows(rows)
    return 0 if summary(args.table) else 1


if __name__ == "__main__":
    sys.exit(main())
