"""The sensor signals that a model predicts."""

from pathlib import Path

from isorig.rig.options import Output


def predict(model: Path, runs: Path, *, output: Output, as_recorded: bool = False) -> None:
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
    from isorig.analysis.model.rig_model import Chain
    from isorig.analysis.wording import in_per_cent
    from isorig.rig.files.recording import read, write
    from isorig.rig.files.rigfile import read_model
    from isorig.rig.model.prediction import errors, predicted
    from isorig.rig.process.terminal import show_table

    rig, origin, _ = read_model(model)
    measured = read(runs)
    found = predicted(rig, measured, origin=origin, as_recorded=as_recorded)
    write(output, found)
    # Records contain the faults of their chain, so they are compared with records.
    faulty = [] if as_recorded else [sensor.channel for sensor in rig.sensors if sensor.chain != Chain()]
    compared = predicted(rig, measured, origin=origin, as_recorded=True) if faulty else found
    by_run = errors(measured, compared)
    channels = list(dict.fromkeys(name for row in by_run.values() for name in row))
    if channels:
        rows = [(run, *(in_per_cent(row[name]) if name in row else "–" for name in channels)) for run, row in by_run.items()]
        show_table("Prediction error, rms relative to measured", ("run", *channels), rows)
    if faulty:
        print(
            f"The file has the true response of {', '.join(faulty)}, without the faults of the measurement chain; the table "
            "compares with them, as --as-recorded writes it."
        )
    print(output)
