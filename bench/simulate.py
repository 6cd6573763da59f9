"""Speed and error of the simulator and of other packages: three-mass rig, 20 N of friction, drive of 60 N rms, 2048 Hz.

Run `python bench/simulate.py`. Times are the shortest of several repetitions, in ms of one core per simulated second. Errors are
those of the motor's speed relative to the table, rms over rms, compared with an integrator of tests/analysis/reference.py
(DOP853 at 1e-12, events located) over one second. diffrax comes with the extra `bench`, and is omitted if it is not installed.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
from msgspec.structs import replace
from table import Row, keep, options

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.rig_model import Drive, RigModel
from isorig.analysis.parallel import side_by_side
from isorig.analysis.simulate import Excitation, scan
from isorig.analysis.simulate.compiled import compile_rig
from isorig.analysis.simulate.excitation import random
from isorig.analysis.simulate.free_run import run_rig
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "analysis"), str(ROOT)]
RATE, RMS, FRICTION = 2048.0, 60.0, 20.0
TRUTH = {"sliding": lambda v, s: FRICTION * s, "static": FRICTION}


def rig() -> RigModel:
    """The thesis's three-mass rig, driven by a force on the motor."""
    push = Drive(channel="force", factor=1.0, pushes={"motor": 1.0}, quantity="force")
    return replace(wire_bonder(THESIS), drive=push, free=())


def least(work: Callable[[], object], repeats: int) -> float:
    """Seconds of one core, the shortest of the repetitions."""
    spent = []
    for _ in range(repeats):
        began = time.thread_time()
        work()
        spent.append(time.thread_time() - began)
    return min(spent)


def ours(model: RigModel, force: FloatArray) -> FloatArray:
    """Speeds of the three bodies by the exact engine, shape (3, n); includes the preparation of the rig."""
    out = np.zeros((3, len(force)))
    run_rig(model, "unlocked", force, 1.0 / RATE, 0.0, np.eye(3, 6, 3), out)
    return out


@numba.njit(error_model="numpy", fastmath={"contract"})
def recurrence(step: FloatArray, start: FloatArray, end: FloatArray, u: FloatArray, out: FloatArray) -> None:
    """The linear motion alone: the lower limit of any method that steps from sample to sample."""
    z, z1 = np.zeros(6), np.zeros(6)
    for k in range(len(u) - 1):
        for i in range(6):
            acc = start[i] * u[k] + end[i] * u[k + 1]
            for j in range(6):
                acc += step[i, j] * z[j]
            z1[i] = acc
        z, z1 = z1, z
        out[k + 1] = z[5]


def diffrax_run(force: FloatArray) -> Callable[[], FloatArray] | None:
    """Tsit5 with an arctan of 1e-4 m/s at its usual tolerances; None where it is not installed."""
    try:
        import diffrax
        import jax
        import jax.numpy as jnp
    except ImportError:
        return None
    jax.config.update("jax_enable_x64", True)
    from isorig.analysis.model.rig_model import matrices

    mass, damping, stiffness = (jnp.asarray(m) for m in matrices(rig()))
    u, weights, last = jnp.asarray(force), jnp.diag(mass), len(force) - 2

    def rates(t: float, z: object, _: object) -> object:
        k = jnp.clip(jnp.floor(t * RATE).astype(int), 0, last)
        push = u[k] + (u[k + 1] - u[k]) * (t * RATE - k)
        friction = FRICTION * 2.0 / jnp.pi * jnp.arctan((z[5] - z[3]) / 1e-4)
        forces = -stiffness @ z[:3] - damping @ z[3:] + jnp.array([friction, 0.0, push - friction])
        return jnp.concatenate([z[3:], forces / weights])

    times = jnp.arange(len(force)) / RATE

    @jax.jit
    def solved() -> object:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(rates), diffrax.Tsit5(), 0.0, times[-1], 1.0 / RATE, jnp.zeros(6),
            saveat=diffrax.SaveAt(ts=times), stepsize_controller=diffrax.PIDController(rtol=1e-3, atol=1e-6),
            max_steps=10_000_000,
        ).ys  # fmt: skip

    return lambda: np.asarray(solved()).T


def with_laws() -> dict[str, RigModel]:
    """The rig with one law at a time, of those that differ in how they are computed, at its contact or its motor's spring."""
    base = replace(rig(), contacts=())

    def rubbing(law: laws.ContactLaw) -> RigModel:
        return replace(base, contacts=(replace(rig().contacts[0], law=law),))

    def sprung(law: laws.SpringLaw) -> RigModel:
        return replace(base, links=(*base.links[:-1], replace(base.links[-1], laws=(law,))))

    return {
        "linear": base,
        "coulomb": rubbing(laws.Coulomb(friction_force=20.0)),
        "coulomb with breakaway": rubbing(laws.Coulomb(friction_force=20.0, static_force=26.0)),
        "karnopp": rubbing(laws.Karnopp(friction_force=10.0, static_force=13.0, band=0.01)),
        "stribeck": rubbing(laws.Stribeck(friction_force=20.0, static_force=26.0, stribeck_velocity=0.05)),
        "dahl": rubbing(laws.Dahl(friction_force=10.0, bristle_stiffness=1e4)),
        "lugre": rubbing(
            laws.LuGre(
                bristle_stiffness=1e4, friction_force=10.0, static_force=13.0, stribeck_velocity=0.05, bristle_damping=10.0
            )
        ),
        "cubic": sprung(laws.Cubic(cubic_stiffness=1e6)),
        "elasto-slip": sprung(laws.ElastoSlip(spring_stiffness=3e3, slip_force=5.0, clearance=1e-3)),
        "maxwell": sprung(laws.Maxwell(relaxation_stiffness=3e3, relaxation_time=0.01)),
    }


def main() -> list[Row]:
    """Times and errors of ours and of peers."""
    from reference import Reference

    from thesis.printed_law import literal_run

    model = rig()
    force = random(samples=round(10 * RATE), sample_rate=RATE, rms=RMS, band=(1.0, 250.0), seed=60)
    short = force[: round(RATE)]
    want = Reference(**TRUTH).run(short, 1.0 / RATE).T
    slip = want[5] - want[3]

    def error(speeds: FloatArray) -> float:
        return float(np.std(speeds[-1] - speeds[-3] - slip) / np.std(slip))

    rows: list[tuple[str, float, float]] = []
    ours(model, short)
    exact = least(lambda: ours(model, force), 15) * 100.0
    rows.append(("exact engine", exact, error(ours(model, short))))
    peers = {
        "scipy RK45, thesis's law, its force lookup": {},
        "scipy RK45, thesis's law, force straight": {"between": "straight"},
        "scipy LSODA, arctan 1e-3": {"between": "straight", "smoothing": 1e-3, "method": "LSODA"},
    }
    for name, chosen in peers.items():
        spent = least(lambda o=chosen: literal_run(model, short, RATE, **o), 5) * 1000.0
        rows.append((name, spent, error(literal_run(model, short, RATE, **chosen).states.T)))
    solved = diffrax_run(short)
    if solved is None:
        print("diffrax is not installed: left out")
    else:
        states = solved()
        rows.append(("diffrax Tsit5, arctan 1e-4", least(solved, 3) * 1000.0, error(states)))
    print(f"{'method':44s} {'ms per s':>9s} {'error':>9s} {'times as long':>14s} {'times the error':>16s}")
    for name, spent, wrong in rows:
        print(f"{name:44s} {spent:9.3f} {wrong:9.1e} {spent / rows[0][1]:14.0f} {wrong / rows[0][2]:16.1e}")
    kept = [
        Row(what=what, unit=unit, ours=rows[0][k], peer=row[0], theirs=row[k])
        for row in rows[1:]
        for k, what, unit in ((1, "time of one simulated second", "ms"), (2, "error of the slip speed, rms over rms", ""))
    ]

    print(f"{'the exact engine with one law':44s} {'ms per s':>9s}")
    for name, one in with_laws().items():
        ours(one, short)
        print(f"{name:44s} {least(lambda o=one: ours(o, force), 15) * 100.0:9.3f}")

    compiled = compile_rig(replace(model, contacts=()), "unlocked", 1.0 / RATE)
    columns, out = compiled.rig.whole[0, 0], np.zeros(len(force))
    step, start, end = columns[:6, :6].T.copy(), columns[7, :6] - columns[8, :6], columns[8, :6].copy()
    recurrence(step, start, end, force, out)
    bare = least(lambda: recurrence(step, start, end, force, out), 15) * 100.0
    print(
        f"bare 6x6 recurrence: {bare:.4f} ms per s ({bare / RATE * 1e6:.1f} ns a sample); "
        f"the exact engine takes {exact / bare:.1f} times as long"
    )
    kept.append(Row(what="time of one simulated second", unit="ms", ours=exact, peer="bare 6x6 recurrence", theirs=bare))

    head = Excitation.prepare(force / THESIS["head_mass"], RATE, oversample=1)
    cores = len(side_by_side(lambda k: k, range(8))) and numba.config.NUMBA_DEFAULT_NUM_THREADS
    rigs = [wire_bonder({**THESIS, "motor_frequency": f}) for f in np.linspace(3.0, 7.0, 512)]
    watched = [replace(rig, sensors=rig.sensors[:1], free=()) for rig in rigs]
    ways = {
        "one figure, one sensor simulated": lambda: scan(watched, head, lambda seen: seen["motor"].max(axis=1)),
        "one figure, three sensors simulated": lambda: scan(rigs, head, lambda seen: seen["motor"].max(axis=1)),
        "all records stored": lambda: scan(rigs, head, lambda seen: np.stack(list(seen.values()), axis=1)),
    }
    for what_is_kept, call in ways.items():
        call()
        whole = []
        for _ in range(5):
            began = time.process_time()
            call()
            whole.append(time.process_time() - began)
        each = min(whole) * 1000.0 / 10.0 / len(rigs)
        print(
            f"batch of {len(rigs)}, {what_is_kept}: {each:.4f} ms per simulated second, simulation and core ({cores} cores), "
            f"{each / bare:.2f} of the bare recurrence"
        )
        what = f"a rig of a batch of {len(rigs)}, {what_is_kept}, one simulated second"
        kept.append(Row(what=what, unit="ms", ours=each, peer="bare 6x6 recurrence", theirs=bare))
    return [*kept, import_time()]


def import_time() -> Row:
    """Of the package, in a process of its own."""
    light = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
        for code in ["import time; t = time.perf_counter(); import isorig.analysis; print(time.perf_counter() - t)"] * 3
    ]
    print(f"import isorig.analysis: {min(light):.3f} s")
    return Row(what="import of isorig.analysis", unit="s", ours=min(light))


if __name__ == "__main__":
    given = options(__doc__).parse_args()
    keep(main(), given.rows)
