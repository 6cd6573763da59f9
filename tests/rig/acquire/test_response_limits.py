"""Limits of the rig's response: predicted before a session, watched during a run, the drive stopped at once."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from ramps import Watcher, acquire, plan_of

from isorig.analysis.model.limits import Limits
from isorig.analysis.proposals.limits import simulated_peaks
from isorig.analysis.simulate import Excitation
from isorig.drivers.errors import InstrumentError
from isorig.rig.acquire.drive import drive_of
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.policy import CERTAIN
from isorig.rig.acquire.response_limits import check_responses
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read

RATE = 1024.0
NI = {
    "kind": "nidaqmx", "inputs": [f"cDAQ1Mod1/ai{k}" for k in range(4)], "output": "cDAQ1Mod3/ao0", "drive_volts": 0.01,
    "full_scale": 1e9,
}  # fmt: skip


@pytest.fixture(autouse=True)
def far_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "drivers"))


def limited(limits: Limits, *, gain: float = 70.0, seconds: float = 8.0, excitation: str = "random") -> Plan:
    run = {"id": "a", "configuration": "unlocked", "gain": gain, "seconds": seconds, "excitation": excitation}
    if excitation == "random":
        run["band"] = [0.5, 20.0]
    return msgspec.structs.replace(plan_of(run, rate=RATE, instrument=NI), limits=limits)


def predicted(plan: Plan) -> float:
    """The isolation's deflection in a simulation of the whole run, m."""
    (run,) = plan.runs
    drive = Excitation.prepare(run.gain * drive_of(run, 0, RATE)[:], RATE)
    return simulated_peaks([plan.nominal()], drive, "unlocked", 0.0).stroke["isolation"]


@pytest.mark.parametrize("kind", ["stroke", "channels", "force"])
def test_a_run_that_would_exceed_a_limit_is_refused_before_anything_moves(kind: str, tmp_path: Path) -> None:
    from ni_device import chassis

    limits = {
        "stroke": Limits(stroke={"isolation": 1e-4}),
        "channels": Limits(channels={"motor": 1e-3}),
        "force": Limits(force=1.0),
    }
    with chassis() as device, pytest.raises(PlanError, match=r"run 'a' was not started: by simulation the .* allowed; lower its"):
        acquire(limited(limits[kind]), "cDAQ1", tmp_path / "c.h5", Watcher().operator)
    assert device.calls == []
    assert list(tmp_path.iterdir()) == []


def test_the_boundary_is_where_the_prediction_is_certain() -> None:
    reached = predicted(limited(Limits()))
    for share, refused in ((1.01, False), (0.99, True)):
        plan = limited(Limits(stroke={"isolation": share * reached / CERTAIN}))
        runs = [(plan.runs[0], 0)]
        if refused:
            with pytest.raises(PlanError, match=f"deflection of the isolation would reach {reached:.3g} m"):
                check_responses(plan, runs)
        else:
            check_responses(plan, runs)


def test_a_long_drive_is_simulated_in_parts_that_build_up() -> None:
    long = limited(Limits(), seconds=90.0, excitation="moves")
    plan = msgspec.structs.replace(long, limits=Limits(stroke={"isolation": 0.99 * predicted(long) / CERTAIN}))
    with pytest.raises(PlanError, match="deflection of the isolation"):
        check_responses(plan, [(plan.runs[0], 0)])


def test_a_record_above_its_limit_ends_the_run_and_the_drive(tmp_path: Path) -> None:
    from ni_device import chassis

    # The second input is three times the number of the tick.
    plan = limited(Limits(channels={"motor": 3e4}), gain=1.0, seconds=30.0)
    plan = msgspec.structs.replace(
        plan, channels={name: msgspec.structs.replace(plan.channels[name], sensitivity=1.0) for name in ("head", "motor")}
    )
    with chassis() as device:
        with pytest.raises(InstrumentError, match=r"motor reached 3.* m/s\^2 and limits\.channels allows 3e\+04, so the run was"):
            acquire(plan, "cDAQ1", tmp_path / "c.h5", Watcher().operator, force=True)
        assert device.level == 0.0
    run = read(tmp_path / "c.h5").runs[0]
    assert 10_000 <= len(run) < 30_000


@pytest.mark.parametrize(("seconds", "refused"), [(8.0, False), (7.9, True)])
def test_a_run_longer_than_its_limit_is_refused(seconds: float, refused: bool, tmp_path: Path) -> None:
    from ni_device import chassis

    plan = limited(Limits(seconds=seconds), gain=1.0)
    with chassis():
        if refused:
            with pytest.raises(PlanError, match=r"lasts 8 s; limits\.seconds allows 7\.9, so shorten it"):
                acquire(plan, "cDAQ1", tmp_path / "c.h5", Watcher().operator, force=True)
        else:
            acquire(plan, "cDAQ1", tmp_path / "c.h5", Watcher().operator, force=True)
