"""A virtual campaign of any rig, with the usual drive of its description."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.files.rigfile import GivenRig, description_text
from isorig.rig.model.prediction import predicted
from isorig.rig.virtual.levels import BEGIN
from isorig.rig.virtual.simulated_recording import synthetic_drive, usual_run

#: Drive levels of a session relative to the usual one, which are its gains; one is measured twice, with another wave.
LEVELS = (1.0, 1.0, 0.5)
#: Noise of a drive's channel relative to that of sensors: what drives is measured better than what answers.
DRIVE_NOISE = 0.1
#: Seconds between two runs.
PAUSE = 10.0


def described_campaign(
    given: GivenRig, *, seed: int = 0, noise: float = 1e-3, seconds: float | None = None, truth: RigModel | None = None
) -> Campaign:
    """A session on a rig: in every configuration three runs, at the usual level twice and at half of it.

    It carries the rig's description. Every sensor's noise has the standard deviation `noise` as a share of the channel's rms in
    the first run; a run has its usual length if no seconds are given. `truth` is the simulated rig, if the description has
    starting values. Raises PlanError if the description's usual drive cannot be made.
    """
    model = given.model if truth is None else truth
    generator = np.random.default_rng(seed)
    runs = []
    sizes: dict[str, float] = {}
    start = 0.0
    for name in model.configurations:
        for k, level in enumerate(LEVELS):
            plan = usual_run(model, name)
            plan = replace(plan, seed=int(generator.integers(2**31)), seconds=seconds or plan.seconds)
            drive = synthetic_drive(model, plan).runs[0]
            scaled = {key: replace(channel, scale=level * channel.scale) for key, channel in drive.channels.items()}
            drive = replace(drive, id=f"{name}_{k + 1}", gain=level, channels=scaled, started=BEGIN + timedelta(seconds=start))
            start += drive.duration + PAUSE
            run = predicted(model, Campaign(runs=(drive,)), as_recorded=True).runs[0]
            channels = {}
            for key, channel in run.channels.items():
                values = channel.read()
                share = noise * (DRIVE_NOISE if key in model.drive_channels else 1.0)
                size = sizes.setdefault(key, share * float(np.std(values)))
                channels[key] = replace(channel, samples=values + generator.normal(0.0, size, len(values)), scale=1.0)
            runs.append(replace(run, channels=channels))
    return Campaign(runs=tuple(runs), description=given.description or description_text(given.model), source="a virtual rig")
