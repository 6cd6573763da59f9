"""A diagnosis that several files of tests read."""

from collections.abc import Callable
from pathlib import Path

import pytest
from small_rigs import HARDENING, with_law

from isorig.analysis.laws import Cubic
from isorig.rig.diagnose.many import diagnose_file
from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_rig
from isorig.rig.virtual.simulated_recording import described_campaign


@pytest.fixture(scope="session")
def hardened(made_once: Callable[[str, Callable[[Path], object]], Path]) -> Path:
    """A folder with the recording c.h5 of two carts with a hidden hardening spring between them, and its diagnosis d."""

    def make(folder: Path) -> None:
        given = read_rig("two-carts")
        truth = with_law(given.model, "between", Cubic(cubic_stiffness=HARDENING))
        write(folder / "c.h5", described_campaign(given, seed=3, seconds=10.0, truth=truth))
        diagnose_file(folder / "c.h5", folder / "d", "coulomb")

    return made_once("hardened-carts", make)
