"""One mass on a spring, small enough to work everything out by other means."""

from __future__ import annotations

import numpy as np

from isorig.analysis import laws
from isorig.analysis.fitting.solve import positive
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.proposals.menu import CandidateRun
from isorig.analysis.proposals.prediction import Prospect, Variant
from isorig.analysis.simulate.excitation import random

MASS, FREQUENCY, DAMPING, RATE = 10.0, 5.0, 0.05, 256.0
STIFFNESS = MASS * (2 * np.pi * FREQUENCY) ** 2
DAMPER = 2 * DAMPING * MASS * 2 * np.pi * FREQUENCY


def one_mass(friction: float = 0.0, link_laws: tuple[laws.LinkLaw, ...] = ()) -> RigModel:
    """10 kg at 5 Hz on the ground, pushed by a force."""
    link = Link(name="spring", a="body", stiffness=STIFFNESS, damping=DAMPER, laws=link_laws)
    contacts = (Contact(name="spring", a="body", law=laws.Coulomb(friction_force=friction)),) if friction else ()
    return RigModel(
        name="one mass", bodies=(Body(name="body", mass=MASS),), links=(link,), contacts=contacts,
        drive=Drive(channel="force", factor=1.0, pushes={"body": 1.0}, quantity="force"),
        sensors=(Sensor(channel="body", body="body"),), free=("links.spring.stiffness", "links.spring.damping"),
    )  # fmt: skip


def variant(model: RigModel, cause: str = "", *more: str, std: float = 0.01) -> Variant:
    """A model whose stiffness and damping, and `more` paths, were fitted to so much."""
    paths = ("links.spring.stiffness", "links.spring.damping", *more)
    free = tuple(positive(path, model.get(path)) for path in paths)
    covariance = np.diag([(std * model.get(path)) ** 2 for path in paths])
    return Variant(cause=cause, location="spring" if cause else "", model=model, free=free, covariance=covariance)


def prospect(rms: float, band: tuple[float, float] = (0.5, 20.0), *, seconds: float = 8.0, seed: int = 1) -> Prospect:
    """A random force of so many N."""
    drive = random(samples=round(seconds * RATE), sample_rate=RATE, rms=rms, band=band, seed=seed)
    run = CandidateRun(configuration="unlocked", excitation="random", gain=rms, seconds=seconds, band=band, seed=seed)
    return Prospect(run=run, drive=drive, sample_rate=RATE, start_time=0.0)
