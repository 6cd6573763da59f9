"""Hypothetical causes at the smallest relevant size: what a run must be able to reveal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from math import isclose, pi

from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.diagnose.mechanisms import CATALOGUE
from isorig.analysis.diagnose.mechanisms.base import Evidence
from isorig.analysis.diagnose.mechanisms.relaxation import natural
from isorig.analysis.diagnose.observe import push_of
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.limits import Peaks
from isorig.analysis.proposals.policy import HIDDEN_MODES, HUM, MAINS, SESSION, SMALLEST, TINY
from isorig.analysis.proposals.prediction import Variant

Sized = Callable[[Candidate, RigModel, Evidence], Mapping[str, float]]


def hypotheses(model: RigModel, peaks: Peaks, speed: Mapping[str, float], sample_rate: float) -> tuple[Variant, ...]:
    """Every cause of the catalogue at every place, at its smallest relevant size, added to a model.

    Parameters
    ----------
    model
        The model that explains the runs so far.
    peaks, speed
        Largest magnitudes, and largest velocity by link (m/s), in the strongest allowed runs: sizes are relative to these.
    sample_rate
        Hz.
    """
    deflections = {link.name: max(peaks.stroke.get(link.name, 0.0), TINY) for link in model.links}
    evidence = Evidence(
        deflection=deflections, speed={link.name: max(speed.get(link.name, 0.0), TINY) for link in model.links},
        sample_rate=sample_rate, end_time=SESSION, peak=peaks.channels,
        flat_tops={s.channel: SMALLEST.clipping * peaks.channels.get(s.channel, 0.0) for s in model.sensors},
        mains={s.channel: MAINS for s in model.sensors}, misfit_frequencies=HIDDEN_MODES, guess=model,
        forces={}, push=push_of(model, peaks.channels),
        configurations=frozenset(model.configurations),
    )  # fmt: skip
    found = []
    for mechanism in CATALOGUE:
        for candidate in mechanism.candidates(model, evidence):
            sized = SIZED.get(candidate.cause)
            if sized is None:
                continue
            for start in _starts(candidate):
                with suppress(ModelError, KeyError):
                    rig = start.replace(_by_path(candidate, sized(candidate, start, evidence)))
                    hum = (candidate.location, HUM, MAINS) if candidate.cause == "mains_hum" else None
                    found.append(Variant(cause=candidate.cause, location=candidate.location, model=rig, hum=hum))
    # Causes that do not change the motion come first: one simulation serves all of them.
    return tuple(sorted(found, key=lambda variant: kind_of(variant.cause) != "sensor"))


def _starts(candidate: Candidate) -> tuple[RigModel, ...]:
    # One attached resonator for each frequency; for all others the starting value closest to the rig without it.
    if candidate.cause != "extra_mode":
        return candidate.starts[:1]
    name = f"{candidate.location}_added"
    ratios = {f: (2.0 * pi * f) ** 2 for f in HIDDEN_MODES}
    at = {f: [s for s in candidate.starts if isclose(s.link(name).stiffness, r * s.body(name).mass)] for f, r in ratios.items()}
    return tuple(starts[-1] for starts in at.values() if starts)


def _resonator(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    name = f"{c.location}_added"
    share = SMALLEST.resonator * m.body(c.location).mass / m.body(name).mass
    link = m.link(name)
    return {
        f"bodies.{name}.mass": share * m.body(name).mass, f"links.{name}.stiffness": share * link.stiffness,
        f"links.{name}.damping": share * link.damping,
    }  # fmt: skip


def _by_path(candidate: Candidate, values: Mapping[str, float]) -> dict[str, float]:
    # A candidate's parameters by the last part of their paths.
    paths = [free.path for free in candidate.free]
    return {next((p for p in paths if p.endswith(f".{end}")), end): value for end, value in values.items()}


def _link(candidate: Candidate, model: RigModel, evidence: Evidence) -> tuple[float, float, float]:
    # Stiffness of the candidate's link, its largest deflection and velocity.
    name = candidate.location
    return model.link(name).stiffness, evidence.deflection[name], evidence.speed[name]


def _force(candidate: Candidate, evidence: Evidence) -> float:
    # The dry friction of the rig before the candidate is added.
    return max(evidence.guess.get(f"contacts.{candidate.location}.law.friction_force"), TINY)


def _hardening(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    stiffness, swing, _ = _link(c, m, e)
    return {"cubic_stiffness": SMALLEST.spring * stiffness / swing**2}


def _softening(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    return {"softening": SMALLEST.spring, "scale": SMALLEST.softening_scale * _link(c, m, e)[1]}


def _drag(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    _, _, speed = _link(c, m, e)
    dry = [x.law.friction_force for x in m.contacts if x.name == c.location and isinstance(x.law, Coulomb)]
    return {"quadratic_damping": SMALLEST.drag * max(*dry, m.link(c.location).damping * speed, TINY) / speed**2}


def _stribeck(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    force = _force(c, e)
    return {
        f"contacts.{c.location}.law.friction_force": force, "static_force": (1.0 + SMALLEST.breakaway) * force,
        "stribeck_velocity": SMALLEST.stribeck_speed * e.speed[c.location],
    }  # fmt: skip


def _presliding(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    return {"bristle_stiffness": _force(c, e) / (SMALLEST.presliding * e.deflection[c.location])}


def _asymmetric(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    force = _force(c, e)
    return {"forward_force": (1.0 + SMALLEST.asymmetry) * force, "backward_force": (1.0 - SMALLEST.asymmetry) * force}


def _stop(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    stiffness, swing, _ = _link(c, m, e)
    return {"stroke": SMALLEST.stop * swing, "contact_stiffness": SMALLEST.stop_stiffness * stiffness}


def _relaxing(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    link = m.link(c.location)
    return {"relaxation_stiffness": SMALLEST.relaxation * link.stiffness, "relaxation_time": 1.0 / natural(m, link)}


def _crosstalk(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    path = c.free[0].path
    source = path.rpartition(".")[2]
    return {path: SMALLEST.crosstalk * e.peak[c.location] / max(e.peak[source], TINY)}


def _lock(c: Candidate, m: RigModel, e: Evidence) -> Mapping[str, float]:
    name = c.free[0].path.split(".")[1]
    return {"lock_stiffness": SMALLEST.lock * m.link(m.configurations[name].rigid[0]).stiffness}


#: Sizes by cause, as values by the last part of the candidate's paths; other causes are not assumed.
SIZED: Mapping[str, Sized] = {
    "coulomb_friction": lambda c, m, e: {},
    "stribeck_friction": _stribeck,
    "presliding_friction": _presliding,
    "asymmetric_friction": _asymmetric,
    "hardening_stiffness": _hardening,
    "softening_stiffness": _softening,
    "backlash": lambda c, m, e: {"clearance": SMALLEST.play * e.deflection[c.location]},
    "end_stop": _stop,
    "quadratic_damping": _drag,
    "stiffness_drift": lambda c, m, e: {"drift_rate": SMALLEST.drift / SESSION},
    "relaxation": _relaxing,
    "extra_mode": _resonator,
    "moment_coupling": lambda c, m, e: {"drive.pushes.rocking": SMALLEST.arm * m.drive.pushes[c.location]},
    "wrong_mass": lambda c, m, e: {c.free[0].path: (1.0 + SMALLEST.mass) * m.get(c.free[0].path)},
    "imperfect_lock": _lock,
    "channel_delay": lambda c, m, e: {"delay": SMALLEST.delay / e.sample_rate},
    "sensor_gain": lambda c, m, e: {"gain": 1.0 + SMALLEST.gain},
    "clipping": lambda c, m, e: {"limit": SMALLEST.clipping * e.peak[c.location]},
    "crosstalk": _crosstalk,
    "mains_hum": lambda c, m, e: {},
}
