"""Figures 6 to 13, which the page on friction shows, and the force gauge."""

from __future__ import annotations

import msgspec
import numpy as np

from analysis.model import Drive, Sensor
from analysis.rigs import wire_bonder
from analysis.simulate import Excitation, simulate
from rig.thesis.step import Row, Step

RATE, SECONDS, MOST = 2048.0, 2.0, 40.0
#: Faster than this the motor has broken away, m/s.
MOVING = 1e-5


def early() -> Step:
    """A slow pull on the motor until it breaks away."""
    rig = wire_bonder()
    gauge = msgspec.structs.replace(
        rig, drive=Drive(channel="pull", quantity="force", factor=1.0, pushes={"motor": 1.0}), free=(),
        sensors=(Sensor(channel="motor", body="motor", relative_to="table", quantity="velocity"),),
    )  # fmt: skip
    pull = np.linspace(0.0, MOST, round(SECONDS * RATE))
    seen = simulate(gauge, Excitation.prepare(pull, RATE)).channels["motor"]
    broke = float(pull[int(np.flatnonzero(np.abs(seen) > MOVING)[0])])
    row = Row(
        what="breakaway under a slow pull, N", thesis="about 20", here=f"{broke:.1f}",
        remark="agrees: 20 N were put in, and the contact holds until then",
    )  # fmt: skip
    text = (
        "One, two and three masses under a half sine of 500 N (Fig. 6-13), with the chatter of the thesis's integration and "
        "why it "
        "comes, are on the page about [friction](friction.md)."
    )
    return Step(title="Fig. 6-13 and the force gauge", rows=[row], text=[text])
