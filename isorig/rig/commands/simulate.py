"""A rig's responses to a recorded or synthetic drive."""

from pathlib import Path

from isorig.analysis.excitations import SyntheticExcitation
from isorig.rig.choices import Method
from isorig.rig.options import Output


def simulate(
    *,
    output: Output,
    model: str | None = None,
    parameters: Path | None = None,
    method: Method = "joint",
    drive: Path | None = None,
    excitation: SyntheticExcitation | None = None,
    configuration: str | None = None,
    gain: float = 70.0,
    level: float | None = None,
    band: tuple[float, float] | None = None,
    seconds: float | None = None,
    sample_rate: float | None = None,
    seed: int = 0,
    events: Path | None = None,
) -> None:
    """Simulate a rig, driven by a recording's drive channel or by a synthetic drive.

    In addition to the responses, the recording contains quantities without a sensor: the friction force of every contact
    (<contact>_friction, N), the force transmitted by every link with its contacts (<link>_force, N), and the share of each
    sample's time in which a contact sticks (<contact>_held).

    Example: rig simulate --excitation moves --seconds 10 -o moves.h5

    Example: rig simulate --parameters parameters/parameters.json --gain 35 -o again.h5

    Example: rig simulate --model one-mass --excitation half-sine --seconds 2 --events stops.csv -o pulse.h5

    Parameters
    ----------
    output
        The recording to write.
    model
        A description in .toml, a model.json, the name of a description that rig describe lists, or one-mass, two-mass,
        three-mass; by default the wire bonder as in the thesis.
    parameters
        The parameters.json of rig characterize: the wire bonder with these values, with the drive level measured at that gain.
    method
        The values to use: those of the joint fit, or those by half-power.
    drive
        A recording whose drive channel is used; the options of the synthetic drive are then ignored.
    excitation
        The synthetic drive: band-limited noise, odd random-phase multisine, logarithmic sweep, one half sine of 0.1 s, hits of
        a hammer, consecutive moves, or free (no drive: a mass that is released). The default is the description's entry usual,
        also for level, band, seconds and sample_rate.
    configuration
        Configuration of the rig; by default its first one.
    gain
        Drive gain. With parameters it has the level measured at that gain; otherwise 70 is an rms of 3.8 m/s^2 at the head and
        moves of 12.5 m/s^2.
    level
        rms of noise or multisine, peak of all others, in the drive's unit; by default from the gain (500 N for a rig driven by a
        force).
    band
        Lowest and highest frequency of noise, multisine or sweep, Hz.
    seconds
        Duration of the synthetic drive.
    sample_rate
        Hz.
    seed
        Random seed.
    events
        An additional table to write: the time of every stick and slip.
    """
    from dataclasses import replace

    from isorig.rig.errors import PlanError
    from isorig.rig.files.output import write_text
    from isorig.rig.files.recording import read, write
    from isorig.rig.files.rigfile import GivenRig, read_rig
    from isorig.rig.virtual.simulated_recording import events_table, synthetic_drive, usual_run, with_forces
    from isorig.rig.wire_bonder.parameters import read_rig_values

    if model is not None and parameters is not None:
        raise PlanError("--model and --parameters both give a rig; give one of them")
    if parameters is None:
        given = read_rig(model or "wire-bonder")
    else:
        table = read_rig_values(parameters, method)
        given = GivenRig(model=table.model)
        if level is None and drive is None:
            level = table.level(gain, excitation or given.model.usual.excitation)
        for sentence in table.remarks:
            print(sentence)
    usual = usual_run(given.model, configuration or next(iter(given.model.configurations)))
    plan = replace(
        usual, gain=gain, seed=seed, excitation=excitation or usual.excitation, level=usual.level if level is None else level,
        band=band or usual.band, seconds=usual.seconds if seconds is None else seconds,
        sample_rate=usual.sample_rate if sample_rate is None else sample_rate,
    )  # fmt: skip
    simulated, changes = with_forces(given, synthetic_drive(given.model, plan) if drive is None else read(drive))
    write(output, simulated)
    if events is not None:
        write_text(events, events_table(changes))
    print(output)
