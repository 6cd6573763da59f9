"""rig simulate: the responses of a rig to a recorded or made-up drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter


def simulate(
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    model: Path | None = None,
    drive: Path | None = None,
    excitation: Literal["random", "moves"] = "random",
    configuration: str = "unlocked",
    gain: float = 70.0,
    seconds: float = 30.0,
    sample_rate: float = 1024.0,
    seed: int = 0,
) -> None:
    """Simulate a rig, driven by a recording's drive channel or by a made-up one.

    Example: rig simulate --excitation moves --seconds 10 -o moves.h5

    Parameters
    ----------
    output
        The recording to write.
    model
        A model.json; the thesis's wire bonder where absent.
    drive
        A recording whose drive channel is used; then the options of the made-up drive do not count.
    excitation
        What is made up: band-limited noise, or consecutive moves.
    configuration
        How the rig is set up.
    gain
        Drive gain; 70 is an rms of 3.8 m/s^2 at the head.
    seconds
        Length of the made-up drive.
    sample_rate
        Hz.
    seed
        Seed of the made-up noise.
    """
    from analysis.rigs import wire_bonder
    from rig.models import read_model
    from rig.prediction import predicted
    from rig.recording import read, write
    from rig.virtual import Take, drive_campaign

    rig, origin = read_model(model) if model is not None else (wire_bonder(), None)
    if drive is not None:
        given = read(drive)
    else:
        band = (0.5, 20.0) if gain > 10.0 else (0.5, 0.39 * sample_rate)
        take = Take(
            id="made_up", configuration=configuration, gain=gain, seconds=seconds, start=0.0, excitation=excitation,
            band=band,
        )  # fmt: skip
        given = drive_campaign(rig, [take], sample_rate=sample_rate, seed=seed)
    write(output, predicted(rig, given, origin=origin))
    print(output)
