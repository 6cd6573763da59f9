"""Speed and error of the simulator and of other packages: three-mass rig, 20 N of friction, drive of 60 N rms, 2048 Hz.

Run `python bench/simulate.py [--quick]`. Times are medians of repetitions in which all methods take turns, in ms of one core per
simulated second. Errors are those of the motor's speed relative to the table, rms over rms, compared with an integrator of
tests/analysis/reference.py (DOP853 at 1e-12, events located) over one second. diffrax, MuJoCo and CVODE (by scikit-SUNDAE) come
with the extra `bench`, and are omitted if they are not installed.
"""

from __future__ import annotations

import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from msgspec.structs import replace
from table import Row, alternated, keep, of_this_thread, options, within

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.rig_model import Drive, Link, RigModel, matrices
from isorig.analysis.simulate import Excitation, scan
from isorig.analysis.simulate.compiled import compile_rig
from isorig.analysis.simulate.excitation import random
from isorig.analysis.simulate.free_run import run_rig
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "analysis"), str(ROOT)]
RATE, RMS, FRICTION = 2048.0, 60.0, 20.0
#: Repetitions, those with `--quick`, and calls of a method of a few milliseconds in each.
REPEATS, QUICK, CALLS = 15, 3, 10
#: Limits in ms of one core per simulated second: of a single rig, and of one of a batch.
LIMIT, LIMIT_BATCH = 0.12, 0.008
#: Largest error of our slip speed, rms over rms.
LIMIT_ERROR = 1e-11
#: Steps of MuJoCo in a sample, and the time constant of its soft friction in s, which it limits to two steps.
SUBSTEPS, SOFT = 4, 1e-4
TRUTH = {"sliding": lambda v, s: FRICTION * s, "static": FRICTION}


def rig() -> RigModel:
    """The thesis's three-mass rig, driven by a force on the motor."""
    push = Drive(channel="force", factor=1.0, pushes={"motor": 1.0}, quantity="force")
    return replace(wire_bonder(THESIS), drive=push, free=())


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


def diffrax_run(force: FloatArray) -> Callable[[], FloatArray]:
    """Tsit5 with an arctan of 1e-4 m/s at its usual tolerances. Raises ImportError where it is not installed."""
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
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


def cvode_run(force: FloatArray) -> Callable[[], FloatArray]:
    """CVODE's BDF with an arctan of 1e-3 m/s at its usual tolerances. Raises ImportError where it is not installed."""
    from sksundae.cvode import CVODE

    mass, damping, stiffness = matrices(rig())
    weights, last, times = np.diag(mass), len(force) - 2, np.arange(len(force)) / RATE
    matrix = -np.hstack([stiffness, damping]) / weights[:, None]

    def rates(t: float, z: FloatArray, rate: FloatArray) -> None:
        k = min(max(int(t * RATE), 0), last)
        push = force[k] + (force[k + 1] - force[k]) * (t * RATE - k)
        friction = FRICTION * 2.0 / math.pi * math.atan((z[5] - z[3]) / 1e-3)
        rate[:3] = z[3:]
        rate[3:] = matrix @ z
        rate[3] += friction / weights[0]
        rate[5] += (push - friction) / weights[2]

    # Its usual limit is 500 steps from one sample to the next.
    solver = CVODE(rates, method="BDF", max_num_steps=100_000)
    return lambda: np.asarray(solver.solve(times, np.zeros(6)).y).T


def mujoco_run(force: FloatArray) -> Callable[[], FloatArray]:
    """MuJoCo's implicit integrator with its dry friction of a joint. Raises ImportError where it is not installed."""
    import mujoco
    import mujoco.rollout

    table, block, isolation = rig().links
    masses = {body.name: body.mass for body in rig().bodies}

    def body(name: str, link: Link, inside: str = "", friction: float = 0.0) -> str:
        return (
            f'<body><inertial pos="0 0 0" mass="{masses[name]}" diaginertia="1 1 1"/>'
            f'<joint name="{name}" type="slide" axis="1 0 0" stiffness="{link.stiffness}" '
            f'damping="{link.damping}" frictionloss="{friction}" solreffriction="{SOFT} 1" '
            f'solimpfriction="0.9999 0.9999 0.001"/>{inside}</body>'
        )

    inner = body("heatblock", block) + body("motor", isolation, friction=FRICTION)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{1.0 / (SUBSTEPS * RATE)}" gravity="0 0 0" integrator="implicit"/>'
        f"<worldbody>{body('table', table, inner)}</worldbody>"
        # A force on the motor acts along both of its joints.
        '<actuator><motor joint="table"/><motor joint="motor"/></actuator></mujoco>'
    )
    data, places = mujoco.MjData(model), np.arange(SUBSTEPS * (len(force) - 1)) / SUBSTEPS
    # The mean force of each step.
    push = np.interp(places + 0.5 / SUBSTEPS, np.arange(len(force)), force)
    control, start = np.repeat(push[None, :, None], 2, axis=2), np.zeros((1, 1 + model.nq + model.nv + model.na))

    def run() -> FloatArray:
        states, _ = mujoco.rollout.rollout(model, data, start, control)
        # The time, positions and speeds of the joints, which are relative to the table.
        at = np.concatenate([start, states[0, SUBSTEPS - 1 :: SUBSTEPS]])[:, 1:].T
        return np.concatenate([at[:1], at[1:3] + at[0], at[3:4], at[4:] + at[3]])

    return run


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


def split(model: RigModel) -> RigModel:
    """The rig with its contact as two equal ones, which stick and slip at the same instants."""
    (contact,) = model.contacts
    half = replace(contact, law=laws.Coulomb(friction_force=0.5 * FRICTION))
    return replace(model, contacts=(half, replace(half, name="second")))


def main(repeats: int) -> list[Row]:
    """Times and errors of ours and of peers."""
    from reference import Reference

    from thesis.printed_law import literal_run

    model, double = rig(), split(rig())
    force = random(samples=round(10 * RATE), sample_rate=RATE, rms=RMS, band=(1.0, 250.0), seed=60)
    short = force[: round(RATE)]
    want = Reference(**TRUTH).run(short, 1.0 / RATE).T
    slip = want[5] - want[3]

    def error(speeds: FloatArray) -> float:
        return float(np.std(speeds[-1] - speeds[-3] - slip) / np.std(slip))

    def literal(**chosen: Any) -> Callable[[], FloatArray]:
        return lambda: literal_run(model, short, RATE, **chosen).states.T

    peers = {
        "scipy RK45, thesis's law, its force lookup": literal(),
        "scipy RK45, thesis's law, force straight": literal(between="straight"),
        "scipy LSODA, arctan 1e-3": literal(between="straight", smoothing=1e-3, method="LSODA"),
    }
    others = {
        "diffrax Tsit5, arctan 1e-4": diffrax_run, "CVODE BDF, arctan 1e-3": cvode_run,
        f"MuJoCo implicit, {SUBSTEPS} steps per sample": mujoco_run,
    }  # fmt: skip
    for name, prepared in others.items():
        try:
            peers[name] = prepared(short)
        except ImportError:
            print(f"{name} is not installed: left out")
    # The first call compiles.
    errors = {name: error(run()) for name, run in peers.items()}
    engine, together = "exact engine", "exact engine, two equal contacts"
    errors |= {engine: error(ours(model, short)), together: error(ours(double, short))}

    compiled = compile_rig(replace(model, contacts=()), "unlocked", 1.0 / RATE)
    columns, out = compiled.rig.whole[0, 0], np.zeros(len(force))
    step, start, end = columns[:6, :6].T.copy(), columns[7, :6] - columns[8, :6], columns[8, :6].copy()
    recurrence(step, start, end, force, out)
    bare = "bare 6x6 recurrence"
    # Per simulated second: ours are played for ten, the others for one.
    ways = {
        engine: lambda: of_this_thread(lambda: ours(model, force), CALLS) * 100.0,
        together: lambda: of_this_thread(lambda: ours(double, force), CALLS) * 100.0,
        bare: lambda: of_this_thread(lambda: recurrence(step, start, end, force, out), CALLS) * 100.0,
    }
    ways |= {name: lambda run=run: of_this_thread(run) * 1000.0 for name, run in peers.items()}
    spent = alternated(ways, repeats)
    print(f"{'method':44s} {'ms per s':>9s} {'error':>9s} {'times as long':>14s} {'times the error':>16s}")
    for name, times in spent.items():
        wrong, longer = errors.get(name), statistics.median(times) / statistics.median(spent[engine])
        shown = "" if wrong is None else f"{wrong:9.1e} {longer:14.1f} {wrong / errors[engine]:16.1e}"
        print(f"{name:44s} {statistics.median(times):9.3f} {shown}")
    second, slow = "time of one simulated second", within(statistics.median(spent[engine]), LIMIT, "ms")
    kept = []
    for name in peers:
        kept.append(Row.of(second, "ms", spent[engine], name, spent[name], slow))
        kept.append(
            Row(
                what="error of the slip speed, rms over rms", unit="", ours=errors[engine], peer=name, theirs=errors[name],
                limit=within(errors[engine], LIMIT_ERROR, "of the slip speed"),
            )
        )  # fmt: skip
    kept.append(Row.of(second, "ms", spent[engine], bare, spent[bare], slow))
    what = "time of one simulated second, two equal contacts that switch together"
    kept.append(Row.of(what, "ms", spent[together], "ours with one contact of the same friction", spent[engine]))

    print(f"{'the exact engine with one law':44s} {'ms per s':>9s}")
    several = with_laws()
    for one in several.values():
        ours(one, short)
    by_law = {name: lambda one=one: of_this_thread(lambda: ours(one, force), CALLS) * 100.0 for name, one in several.items()}
    for name, times in alternated(by_law, repeats).items():
        print(f"{name:44s} {statistics.median(times):9.3f}")
    return [*kept, *batches(force, recurrence_ms=spent[bare], repeats=repeats), import_time(repeats)]


def batches(force: FloatArray, *, recurrence_ms: list[float], repeats: int) -> list[Row]:
    """Time of a rig of a batch, by what is kept of the simulation."""
    head = Excitation.prepare(force / THESIS["head_mass"], RATE, oversample=1)
    rigs = [wire_bonder({**THESIS, "motor_frequency": f}) for f in np.linspace(3.0, 7.0, 512)]
    watched = [replace(rig, sensors=rig.sensors[:1], free=()) for rig in rigs]
    calls = {
        "one figure, one sensor simulated": lambda: scan(watched, head, lambda seen: seen["motor"].max(axis=1)),
        "one figure, three sensors simulated": lambda: scan(rigs, head, lambda seen: seen["motor"].max(axis=1)),
        "all records stored": lambda: scan(rigs, head, lambda seen: np.stack(list(seen.values()), axis=1)),
    }

    def each(call: Callable[[], object]) -> float:
        # All cores, of one rig and simulated second.
        began = time.process_time()
        call()
        return (time.process_time() - began) * 1000.0 / 10.0 / len(rigs)

    for call in calls.values():
        call()
    kept = []
    for what, times in alternated({what: lambda call=call: each(call) for what, call in calls.items()}, repeats).items():
        middle = statistics.median(times)
        print(f"batch of {len(rigs)}, {what}: {middle:.4f} ms per simulated second, simulation and core")
        limit = within(middle, LIMIT_BATCH, "ms") if what == next(iter(calls)) else ""
        name = f"a rig of a batch of {len(rigs)}, {what}, one simulated second"
        kept.append(Row.of(name, "ms", times, "bare 6x6 recurrence", recurrence_ms, limit))
    return kept


def import_time(repeats: int) -> Row:
    """Of the package, in a process of its own."""
    code = "import time; t = time.perf_counter(); import isorig.analysis; print(time.perf_counter() - t)"
    light = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
        for _ in range(repeats)
    ]
    print(f"import isorig.analysis: {statistics.median(light):.3f} s")
    return Row.of("import of isorig.analysis", "s", light)


if __name__ == "__main__":
    given = options(__doc__).parse_args()
    keep(main(QUICK if given.quick else REPEATS), given.rows)
