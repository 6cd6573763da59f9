"""rig predict: the sensor signals that a model predicts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def predict(
    model: Path,
    runs: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    as_recorded: bool = False,
) -> None:
    """Predict the responses of a model to the drive of a recording.

    Example: rig predict diagnosis/model.json later.h5 -o predicted.h5

    Parameters
    ----------
    model
        A model.json or baseline.json of rig diagnose.
    runs
        A recording; its runs need the drive channel only.
    output
        The recording to write: the same runs with the predicted responses, starting from rest.
    as_recorded
        Include the faults of the measurement chain that the model contains.
    """
    from isorig.rig.files.models import read_model
    from isorig.rig.files.recording import read, write
    from isorig.rig.prediction import predicted

    rig, origin = read_model(model)
    write(output, predicted(rig, read(runs), origin=origin, as_recorded=as_recorded))
    print(output)
