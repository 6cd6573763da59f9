"""rig virtual: play a whole session on a virtual rig, with a hidden effect where one is given."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def virtual(
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    model: Path | None = None,
    noise: float = 1e-3,
    seed: int = 0,
    later: bool = False,
) -> None:
    """Record a session of the virtual rig: unlocked at gains 70, 70, 35 and 7, locked at 70 and 7, moves.

    Example: rig virtual -o session.h5 --seed 3

    Parameters
    ----------
    output
        The recording to write.
    model
        A model.json; the thesis's wire bonder where absent.
    noise
        Standard deviation of the sensors' noise, m/s^2.
    seed
        Seed of drives and noise.
    later
        Play the runs measured afterwards, for scoring predictions.
    """
    from analysis.rigs import wire_bonder
    from rig.models import read_model
    from rig.recording import write
    from rig.virtual import LATER, SESSION, virtual_campaign

    rig = read_model(model)[0] if model is not None else wire_bonder()
    write(output, virtual_campaign(rig, LATER if later else SESSION, noise=noise, seed=seed))
    print(output)
