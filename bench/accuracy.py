"""Accuracy of the thesis's ways compared with ours, on records whose truth is known: writes docs/accuracy.md.

Run `python bench/accuracy.py [--quick]`: half-power (and pyEMA's LSCF and SDynPy's PolyMax, of the extra `bench`) in the cases of
docs/theory.md, the error surface, and the integration of friction with a velocity dead zone. The page is not written with
`--quick`.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from damping import lscf, polymax
from msgspec.structs import replace

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "analysis"), str(ROOT)]

from modal_coverage import CASES, DAMPING, FREQUENCY, QUANTILE, estimated, fitted_mode  # noqa: E402
from reference import Reference  # noqa: E402
from simulate import RATE, RMS, ours, rig  # noqa: E402
from table import Row, keep, options  # noqa: E402

from isorig.analysis.campaign import FloatArray  # noqa: E402
from isorig.analysis.errors import AnalysisError  # noqa: E402
from isorig.analysis.parameters.joint_fit import characterize  # noqa: E402
from isorig.analysis.simulate.excitation import random  # noqa: E402
from isorig.analysis.spectra.half_power import half_power  # noqa: E402
from isorig.rig.model.baseline import baseline_model  # noqa: E402
from isorig.rig.virtual.levels import HEAD_PER_GAIN  # noqa: E402
from isorig.rig.wire_bonder.description import THESIS, wire_bonder  # noqa: E402
from thesis.campaign import SECONDS, campaign_takes, play  # noqa: E402
from thesis.figure_readings import read  # noqa: E402
from thesis.printed_law import literal_run  # noqa: E402
from thesis.step import table  # noqa: E402

PAGE = ROOT / "docs" / "accuracy.md"
#: Friction of the rigs, N, and seconds of simulated time that the integrators are compared over.
FORCES, COMPARED = (0.0, 1.0, 5.0, 20.0), 1.0
#: Lengths of the runs for the error surface as a share of the thesis's.
SHARE = 0.5
#: Repeats, with which a coverage has a standard uncertainty of 1.3 %, those with `--quick`, and those of the other methods.
REPEATS, QUICK, OTHERS = 300, 10, 50
#: Limits of the coverage of 95 % intervals in percent, and of the stated standard uncertainty over the scatter of the values.
COVERED, WIDE = (92.0, 98.0), 1.1
HEAD = """# Accuracy compared with the thesis's ways

`python bench/accuracy.py` computes and writes this page. All records are simulated, so the true values are known.
"""
MODES = """
## Frequency and damping of a peak: half-power

The cases of [theory](theory.md): one mode, {frequency:g} Hz, damping ratio {damping:g}, {repeats} repeats, {others} of them by
the other methods. Errors are the rms over the repeats, relative to the true value. "Covered" are the repeats whose 95 % interval
of the damping contains the truth; "stated / scatter" is the stated standard uncertainty over the scatter of the values.
Half-power, pyEMA and SDynPy state none. "None" means that the method gives no value.
"""
SURFACE = """
## Mass and damping of the table: the error surface

The thesis's rig with different friction, measured as in the thesis (runs of {low:g} and {high:g} s): the minimum of the error
surface, and the joint fit with its standard uncertainty. True are {mass:g} kg and {damping:g}.
"""
FRICTION = """
## Motion with friction: integration with a velocity dead zone

Error of the motor's speed relative to the table over {seconds:g} s, rms over rms, under a drive of {rms:g} N rms, compared with
an integrator of high order that locates the events (DOP853 at 1e-12). The thesis's law sticks below 1e-6 m/s and chatters there;
it is integrated by Runge-Kutta 4(5) at scipy's usual tolerances, once with the drive of the nearest sample as in the thesis, once
with the drive between samples as in the reference.
"""


def error(values: Sequence[float], true: float) -> float:
    """The rms error in percent of the true value, over the repeats with a value; nan if there is none."""
    known = np.array([value for value in values if np.isfinite(value)])
    return float(100.0 * np.sqrt(np.mean((known / true - 1.0) ** 2))) if len(known) else float("nan")


def shown(percent: float) -> str:
    """An error as text."""
    return "none" if np.isnan(percent) else f"{percent:.2g} %"


def modes(repeats: int) -> tuple[list[str], list[Row]]:
    """The table of one peak, and its rows of the common table."""
    lines, kept = [], []
    for case in CASES:
        fitted, halves = [], []
        peers: dict[str, list[float]] = {"half-power": [], "pyEMA": [], "SDynPy": []}
        for seed in range(repeats):
            frf = estimated(case, seed).frf("answer", "drive")
            with contextlib.suppress(AnalysisError):
                fitted.append(fitted_mode(frf))
            if seed >= OTHERS:
                continue
            with contextlib.suppress(AnalysisError):
                if (mode := half_power(frf, (0.7 * FREQUENCY, 1.4 * FREQUENCY)).mode) is not None:
                    halves.append(mode.frequency)
                    peers["half-power"].append(mode.damping)
            for name, method in (("pyEMA", lscf), ("SDynPy", polymax)):
                peers[name].append(method(frf, FREQUENCY))
        values, stated = np.array([mode.damping for mode in fitted]), np.array([mode.damping_std for mode in fitted])
        own, others = error(list(values), DAMPING), {name: error(found, DAMPING) for name, found in peers.items()}
        covered = float(100.0 * np.mean(np.abs(values - DAMPING) <= QUANTILE * stated))
        wide = float(np.sqrt(np.mean(stated**2)) / values.std(ddof=1))
        met = COVERED[0] <= covered <= COVERED[1] and wide <= WIDE
        limit = f"{covered:.1f} % covered, stated {wide:.2f} of the scatter over {repeats} repeats: {'met' if met else 'not met'}"
        kept += [
            Row(what=f"rms error, {case}", unit="%", ours=own, peer=name, theirs=value, limit=limit)
            for name, value in others.items() if not np.isnan(value)
        ]  # fmt: skip
        print(f"{case:35s} {limit}; rms error {own:.2g} %, {', '.join(f'{n} {shown(v)}' for n, v in others.items())}", flush=True)
        lines.append(
            (
                case, shown(error(halves, FREQUENCY)), shown(error([mode.frequency for mode in fitted], FREQUENCY)),
                *map(shown, others.values()), shown(own), f"{covered:.0f} %", f"{wide:.2f}",
            )
        )  # fmt: skip
    heads = (
        "case", "frequency, half-power", "frequency, ours", "damping, half-power", "damping, pyEMA", "damping, SDynPy",
        "damping, ours", "covered", "stated / scatter",
    )  # fmt: skip
    return table(heads, lines), kept


def surface() -> list[str]:
    """The table of the error surface."""
    rows = []
    for force in FORCES:
        campaign = play(wire_bonder({**THESIS, "friction_force": force}), campaign_takes(HEAD_PER_GAIN, SHARE))
        found, fit = read(campaign).surface, characterize(campaign, baseline_model(campaign)).table
        mass, damping = fit["table_mass"], fit["table_damping"]
        rows.append(
            (
                f"{force:g} N", f"{found.best[0]:.4g} kg" if found else "none", f"{mass.value:.5g} ± {mass.std:.1g} kg",
                f"{found.best[1]:.3g}" if found else "none", f"{damping.value:.5g} ± {damping.std:.1g}",
            )
        )  # fmt: skip
    return table(("friction", "mass, error surface", "mass, joint fit", "damping, error surface", "damping, joint fit"), rows)


def friction() -> list[str]:
    """The table of the integrators."""
    drive, rows = random(samples=round(COMPARED * RATE), sample_rate=RATE, rms=RMS, band=(1.0, 250.0), seed=60), []
    for force in FORCES[1:]:
        want = Reference(sliding=lambda v, s, size=force: size * s, static=force).run(drive, 1.0 / RATE).T
        slip = want[5] - want[3]

        def apart(speeds: FloatArray, slip: FloatArray = slip) -> str:
            return f"{np.std(speeds[-1] - speeds[-3] - slip) / np.std(slip):.2g}"

        model = replace(wire_bonder({**THESIS, "friction_force": force}), drive=rig().drive, free=())
        thesis = [apart(literal_run(model, drive, RATE, between=way).states.T) for way in ("nearest", "straight")]
        rows.append((f"{force:g} N", *thesis, apart(ours(model, drive))))
    return table(("friction", "thesis, drive of the nearest sample", "thesis, same drive as the reference", "ours"), rows)


def main(repeats: int, *, page: bool) -> list[Row]:
    """Compute everything, and write the page."""
    peaks, kept = modes(repeats)
    parts = [
        HEAD, MODES.format(frequency=FREQUENCY, damping=DAMPING, repeats=repeats, others=OTHERS), *peaks,
        SURFACE.format(
            low=SHARE * SECONDS[max(SECONDS)], high=SHARE * SECONDS[min(SECONDS)], mass=THESIS["table_mass"],
            damping=THESIS["table_damping"],
        ),
        *surface(), FRICTION.format(seconds=COMPARED, rms=RMS), *friction(),
    ]  # fmt: skip
    if page:
        PAGE.write_text("\n".join(parts) + "\n", encoding="utf-8")
    return kept


if __name__ == "__main__":
    given = options(__doc__).parse_args()
    keep(main(QUICK if given.quick else REPEATS, page=not given.quick), given.rows)
