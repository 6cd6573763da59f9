"""The catalogue of causes, one file per family.

Adding a cause means one class with the duties of `base.Mechanism` and one line here.
"""

from __future__ import annotations

from analysis.diagnose.mechanisms.base import Candidate, Evidence, Mechanism
from analysis.diagnose.mechanisms.chain import ChannelDelay, Clipping, Crosstalk, MainsHum, SensorGain
from analysis.diagnose.mechanisms.friction import (
    AsymmetricFriction,
    CoulombFriction,
    PreslidingFriction,
    StribeckFriction,
)
from analysis.diagnose.mechanisms.lock import ImperfectLock
from analysis.diagnose.mechanisms.modes import ExtraMode, MomentCoupling, WrongMass
from analysis.diagnose.mechanisms.springs import (
    Backlash,
    EndStop,
    HardeningStiffness,
    QuadraticDamping,
    SofteningStiffness,
    StiffnessDrift,
)

CATALOGUE: tuple[Mechanism, ...] = (
    CoulombFriction(),
    StribeckFriction(),
    PreslidingFriction(),
    AsymmetricFriction(),
    HardeningStiffness(),
    SofteningStiffness(),
    Backlash(),
    EndStop(),
    QuadraticDamping(),
    StiffnessDrift(),
    ExtraMode(),
    MomentCoupling(),
    WrongMass(),
    ImperfectLock(),
    ChannelDelay(),
    SensorGain(),
    Clipping(),
    Crosstalk(),
    MainsHum(),
)

__all__ = ["CATALOGUE", "Candidate", "Evidence", "Mechanism"]
