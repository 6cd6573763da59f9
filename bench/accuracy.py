"""Accuracy of the thesis's ways compared with ours, on records whose truth is known: writes docs/accuracy.md.

Run `python bench/accuracy.py [--quick]`: half-power (and pyEMA's LSCF and SDynPy's PolyMax, of the extra `bench`) in the cases of
docs/theory.md, the error surface, and the integration of friction with a velocity dead zone; for the common table also the modes
of a machine in operation, compared with those that pyOMA2 chooses. The page is not written with `--quick`.
"""

from __future__ import annotations

import contextlib
import io
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from damping import lscf, polymax
from msgspec.structs import replace

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "analysis"), str(ROOT)]

import machine_in_operation as machine  # noqa: E402
from modal_coverage import CASES, DAMPING, FREQUENCY, QUANTILE, estimated, fitted_mode  # noqa: E402
from reference import Reference  # noqa: E402
from simulate import RATE, RMS, ours, rig  # noqa: E402
from table import Row, keep, options  # noqa: E402

from isorig.analysis.campaign import FloatArray  # noqa: E402
from isorig.analysis.errors import AnalysisError  # noqa: E402
from isorig.analysis.parameters.joint_fit import characterize  # noqa: E402
from isorig.analysis.simulate.excitation import random  # noqa: E402
from isorig.analysis.spectra.half_power import half_power  # noqa: E402
from isorig.analysis.spectra.operating import operating_modes  # noqa: E402
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
#: Repeats of the modes in operation, two modes each, and those with `--quick`.
RECORDS, FEW = 100, 3
#: Lags and largest order of pyOMA2's subspace identification: the lags are those of `rig modes --operating` for this band, and
#: the largest order that they allow. Its segment of spectra is its default.
BLOCK_ROWS, SEGMENT = 20, 1024
SUBSPACE, PEAKS, STATED = "pyOMA2, SSI-cov, lowest stable order", "pyOMA2, EFDD", "stated"
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


def rated(covered: float, wide: float, repeats: int) -> str:
    """Coverage of intervals in percent and stated over actual scatter as text, and whether both meet their limits."""
    met = COVERED[0] <= covered <= COVERED[1] and wide <= WIDE
    return f"{covered:.1f} % covered, stated {wide:.2f} of the scatter over {repeats} repeats: {'met' if met else 'not met'}"


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
        limit = rated(covered, wide, repeats)
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


def chosen_by_pyoma2(records: FloatArray, near: Sequence[float]) -> dict[str, FloatArray]:
    """Damping ratios of the modes near these frequencies in Hz, by pyOMA2's own choice of poles and standard uncertainty."""
    from pyoma2.algorithms import EFDD, SSI
    from pyoma2.setup.single import SingleSetup

    logging.getLogger("pyoma2").setLevel(logging.ERROR)
    setup = SingleSetup(records.T, fs=machine.RATE)
    subspace = SSI(name="SSI", method="cov", br=BLOCK_ROWS, ordmax=BLOCK_ROWS, calc_unc=True)
    peaks = EFDD(name="EFDD", nxseg=SEGMENT)
    setup.add_algorithms(subspace, peaks)
    with np.errstate(all="ignore"), contextlib.redirect_stderr(io.StringIO()):
        setup.run_all()
        setup.mpe("SSI", sel_freq=list(near), order_in="find_min")
        setup.mpe("EFDD", sel_freq=list(near))
    return {SUBSPACE: subspace.result.Xi, PEAKS: peaks.result.Xi, STATED: subspace.result.Xi_std}


def in_operation(repeats: int) -> list[Row]:
    """Rows of the modes of a machine in operation: errors of the damping ratio, and intervals that do not contain it."""
    frequency, damping = machine.truth()
    own, stated = [], []
    peers: dict[str, list[FloatArray]] = {SUBSPACE: [], PEAKS: [], STATED: []}
    for seed in range(repeats):
        records = machine.records(seed)
        modes = operating_modes(records, machine.RATE, machine.BAND, responses=machine.RESPONSES).modes
        nearest = [min(modes, key=lambda mode: abs(mode.frequency - f)) for f in frequency]
        own.append([mode.damping for mode in nearest])
        stated.append([mode.damping_std for mode in nearest])
        for name, values in chosen_by_pyoma2(records, list(frequency)).items():
            peers[name].append(values)

    def missed(values: Sequence[Sequence[float] | FloatArray], stds: Sequence[Sequence[float] | FloatArray]) -> float:
        return float(100.0 * np.mean(np.abs(np.array(values) - damping) > QUANTILE * np.array(stds)))

    def off(values: Sequence[Sequence[float] | FloatArray]) -> float:
        return float(100.0 * np.sqrt(np.mean((np.array(values) / damping - 1.0) ** 2)))

    wrong = missed(own, stated)
    scatter = np.sqrt(np.mean(np.var(own, axis=0, ddof=1)))
    wide = float(np.sqrt(np.mean(np.square(stated))) / scatter)
    limit = rated(100.0 - wrong, wide, repeats)
    what = "damping ratios of a machine in operation, five minutes"
    kept = [Row(what=f"rms error, {what}", unit="%", ours=off(own), peer=name, theirs=off(peers[name]), limit=limit)
            for name in (SUBSPACE, PEAKS)]  # fmt: skip
    kept.append(Row(what=f"95 % intervals that miss, {what}", unit="%", ours=wrong, peer=SUBSPACE,
                    theirs=missed(peers[SUBSPACE], peers[STATED])))  # fmt: skip
    for row in kept:
        print(f"{row.what}: {row.ours:.3g} %, {row.peer} {row.theirs:.3g} %; {row.limit}", flush=True)
    return kept


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
    return [*kept, *in_operation(RECORDS if page else FEW)]


if __name__ == "__main__":
    given = options(__doc__).parse_args()
    keep(main(QUICK if given.quick else REPEATS, page=not given.quick), given.rows)
