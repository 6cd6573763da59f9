"""Foreign campaigns that several files of tests read."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from foreign_campaign import Setting, draw

#: A cause of each family of rigs, among them forms outside the catalogue.
CLEAR = {
    "wire_bonder": "moment_coupling", "chain": "coulomb_friction", "cart": "hardening_stiffness", "stage": "slow sensor",
    "torsion": "hardening_stiffness", "base": "mains_hum", "partial": "mains_hum",
}  # fmt: skip
#: Families of the short tests: a force with sensors at all bodies, position and acceleration, bodies without a sensor.
QUICK = ("chain", "stage", "partial")
FAMILIES = [family if family in QUICK else pytest.param(family, marks=pytest.mark.study) for family in CLEAR]

Made = tuple[Path, Path]


class CampaignOf(Protocol):
    """Gives recording and answer of a campaign of a family with an effect, or "none", and a seed; clean unless soiled."""

    def __call__(self, family: str, effect: str, seed: int, *, soiled: bool = False) -> Made: ...


@pytest.fixture(scope="session")
def campaign_of(made_once: Callable[[str, Callable[[Path], object]], Path]) -> CampaignOf:
    """Each campaign is drawn once."""

    def campaign(family: str, effect: str, seed: int, *, soiled: bool = False) -> Made:
        setting = Setting(severity=1.0, soiled=soiled, effects=(effect,))
        name = f"{family}-{effect.replace(' ', '-')}-{seed}{'-soiled' * soiled}"
        folder = made_once(name, lambda folder: draw(family, seed, setting, folder))
        return folder / f"{seed}.h5", folder / f"{seed}.json"

    return campaign


@pytest.fixture(params=FAMILIES)
def clear(request: pytest.FixtureRequest, campaign_of: CampaignOf) -> Made:
    """Recording and answer of a campaign with a clear cause."""
    return campaign_of(request.param, CLEAR[request.param], 5)
