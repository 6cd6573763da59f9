"""The isolation ratio, measured and simulated."""

from pathlib import Path

from isorig.rig.choices import Method
from isorig.rig.options import OutputFolder


def isolation(
    campaign: Path,
    *,
    output: OutputFolder,
    model: Path | None = None,
    parameters: Path | None = None,
    method: Method | None = None,
    stitch: float = 15.0,
    resolution: float = 0.25,
    reference: str | None = None,
    response: str | None = None,
    configurations: tuple[str, str] | None = None,
) -> None:
    """Compute the response of a channel to the drive in one configuration relative to another, measured and simulated.

    For the wire bonder: the response of the heatblock, unlocked over locked. For another rig, or with a given reference, response
    or configurations: the magnitude of response over reference, relative to the second configuration if there is one.

    Example: rig isolation campaign.h5 --parameters parameters/parameters.json -o isolation

    Example: rig isolation campaign.h5 --model diagnosis/model.json -o isolation

    Example: rig isolation absorber.h5 --response absorber --configurations unlocked wedged -o isolation

    Parameters
    ----------
    campaign
        A recording with broad-band runs; for the wire bonder unlocked and locked.
    output
        The folder for isolation.csv, isolation.json and isolation.png.
    model
        A model.json that is simulated and evaluated in the same way; by default none.
    parameters
        The parameters.json of rig characterize: the wire bonder with these values is simulated, by the joint fit and by
        half-power, and both are plotted with the measured ratio.
    method
        Use only one of these two methods.
    stitch
        Upper frequency limit of the highest gain, where the next gain takes over, Hz.
    resolution
        Frequency resolution, Hz.
    reference
        The channel in the denominator; by default the first drive of the rig's description.
    response
        The channel in the numerator; by default the last sensor of the description.
    configurations
        Numerator and denominator; by default the first two measured ones of the description.
    """
    from isorig.analysis.parameters.joint_fit import is_wire_bonder
    from isorig.rig.files.recording import read
    from isorig.rig.files.rigfile import rig_of
    from isorig.rig.isolation.transmissibility import transmissibility, write_transmissibility
    from isorig.rig.wire_bonder.isolation import compared_isolation, given_models, write_isolation

    measured = read(campaign)
    models, notes = given_models(model, parameters, method)
    if is_wire_bonder(rig_of(measured)) and not (reference or response or configurations):
        sentences = write_isolation(output, compared_isolation(measured, models, stitch=stitch, resolution=resolution), notes)
    else:
        compared = transmissibility(
            measured, models, reference=reference, response=response, configurations=configurations, resolution=resolution
        )
        sentences = [*notes, *write_transmissibility(output, compared)]
    print(*sentences, output, sep="\n")
