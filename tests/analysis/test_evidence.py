"""What the records say before any fit: each hidden effect leaves its sign beside the sound rig's simulation, a sound rig none."""

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.causes.at_link import added
from isorig.analysis.diagnose.causes.base import exchange
from isorig.analysis.diagnose.estimate_pairs import Doubles, doubles
from isorig.analysis.diagnose.evidence import Sign, signs, surfaces
from isorig.analysis.diagnose.misfit import Discrepancy, discrepancies
from isorig.analysis.fitting.division import refined
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import BLOCKS, Score, improvement
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import Chain, RigModel
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

SOUND = wire_bonder({**THESIS, "friction_force": 10.0})
TAKES = (
    VirtualRun(id="u70a", configuration="unlocked", gain=70.0, seconds=40.0, start=0.0),
    VirtualRun(id="u35", configuration="unlocked", gain=35.0, seconds=40.0, start=60.0),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=30.0, start=120.0),
    VirtualRun(id="u70b", configuration="unlocked", gain=70.0, seconds=40.0, start=600.0),
)


def chained(channel: str, chain: Chain) -> RigModel:
    return msgspec.structs.replace(SOUND, sensors=exchange(SOUND.sensors, channel, chain=chain))


def rubbing(law: laws.FrictionLaw) -> RigModel:
    return msgspec.structs.replace(SOUND, contacts=exchange(SOUND.contacts, "isolation", law=law), free=())


def linked(law: laws.LinkLaw) -> RigModel:
    return added(SOUND, SOUND.link("isolation"), law)


Seen = tuple[Campaign, tuple[Trial, ...], Doubles]
SEEN: dict[bytes, Seen] = {}


def seen(model: RigModel) -> Seen:
    """The records of a rig, its runs, and the sound rig's simulation next to them; simulated once."""
    if model.encoded not in SEEN:
        campaign = virtual_campaign(model, TAKES, seed=5)
        trials = tuple(refined(trial) for trial in prepare(campaign, SOUND))
        SEEN[model.encoded] = campaign, trials, doubles(SOUND, trials)
    return SEEN[model.encoded]


def said(model: RigModel) -> tuple[Sign, ...]:
    campaign, trials, pairs = seen(model)
    return signs(campaign, SOUND, trials, pairs)


def wrong(model: RigModel) -> tuple[Discrepancy, ...]:
    campaign, trials, pairs = seen(model)
    return discrepancies(campaign, SOUND, trials, pairs)


HIDDEN = {
    "sensor_gain": (chained("motor", Chain(gain=1.08)), "motor", ("Constant ratio", "Rigid bodies")),
    "channel_delay": (chained("table", Chain(delay=5e-4)), "table", ("Linear phase", "Rigid bodies")),
    "clipping": (chained("table", Chain(limit=2.5)), "table", ("Flat tops",)),
    "hardening_stiffness": (linked(laws.Cubic(cubic_stiffness=2e9)), "isolation", ("Restoring force", "Homogeneity")),
    "stiffness_drift": (linked(laws.Drift(drift_rate=3e-4, until=690.0)), "isolation", ("Repeatability",)),
    "asymmetric_friction": (
        rubbing(laws.Asymmetric(forward_force=10.0, backward_force=10.0, forward_viscosity=80.0)),
        "isolation", ("Friction force",),
    ),
    "stribeck_friction": (
        rubbing(laws.Stribeck(friction_force=8.0, static_force=16.0, stribeck_velocity=0.01)), "isolation", ("Friction force",),
    ),
}  # fmt: skip


@pytest.mark.parametrize("cause", HIDDEN)
def test_effect_leaves_its_sign(cause: str) -> None:
    model, place, kinds = HIDDEN[cause]
    found = said(model)
    for kind in kinds:
        assert any(sign.text.startswith(kind) and sign.supports(cause, place) for sign in found), kind


def test_sound_rig_leaves_none() -> None:
    found = said(SOUND)
    starts = {sign.text.split(":")[0] for sign in found}
    assert starts == {"Rigid bodies", "Configurations", "Homogeneity", "Repeatability", "Periods"}
    assert all("agree" in s.text for s in found if s.text.startswith(("Rigid", "Repeat")))
    assert wrong(SOUND) == ()


def test_a_discrepancy_names_its_run_first() -> None:
    found = wrong(linked(laws.Cubic(cubic_stiffness=2e9)))
    assert any(re.match(r"In run 'u70b' \(unlocked at gain 70\) the \w+ is simulated between \S+ and", d.text) for d in found)


def test_released_runs_have_no_period_to_miss() -> None:
    campaign, trials, _ = seen(SOUND)
    released = tuple(replace(trial, run=replace(trial.run, excitation="free")) for trial in trials)
    mixed = (*released[1:], trials[0])
    for some, expected in ((released, False), (mixed, True)):
        assert any(sign.text.startswith("Periods") for sign in signs(campaign, SOUND, some, doubles(SOUND, some))) is expected


def test_the_surface_gives_the_stiffness_over_deflection() -> None:
    """Secant stiffness of k d + k3 d^3 is k + k3 E[d^4] / E[d^2] in each bin: it lies between k and k + k3 d^2."""
    k3 = 2e9
    _, _, pairs = seen(linked(laws.Cubic(cubic_stiffness=k3)))
    (surface,) = (s for s in surfaces(SOUND, pairs) if s.link == "isolation")
    edges = surface.swing * np.arange(1, 7) / 6.0
    k = SOUND.link("isolation").stiffness
    middle = k + k3 * ((edges + edges - edges[0]) / 2.0) ** 2
    assert surface.stiffness[2:5] == pytest.approx(middle[2:5], rel=0.05)


def test_discrepancies_of_a_stiffer_spring() -> None:
    found = wrong(linked(laws.Cubic(cubic_stiffness=2e9)))
    assert {"frf", "coherence", "ratio"} <= {d.what for d in found}
    peak = next(d for d in found if "peak" in d.text and d.channel == "motor")
    assert "higher than simulated" in peak.text
    assert "changes with the gain" in peak.text
    assert "the locked peaks agree" in peak.text


def test_gain_has_its_interval() -> None:
    """Errors of equal blocks have no spread; the removed share is that of the figures."""
    before = Score(error=np.full((2, 3), 0.2), blocks=np.full((2, 3, BLOCKS), 400.0), power=np.full((2, 3, BLOCKS), 0.04))
    after = Score(error=np.full((2, 3), 0.02), blocks=np.full((2, 3, BLOCKS), 4.0), power=np.full((2, 3, BLOCKS), 0.04))
    brought = improvement(before, after, 0.01)
    assert brought.before == pytest.approx((0.2, 0.2))
    assert brought.removed == pytest.approx(0.18 / 0.19)
    generator = np.random.default_rng(3)
    blocks = 4.0 * generator.chisquare(8, (2, 3, BLOCKS)) / 8
    after = Score(error=np.full((2, 3), 0.02), blocks=blocks, power=1e-4 * blocks)
    low, high = improvement(before, after, 0.01).after
    assert 0.015 < low < 0.02 < high < 0.025
