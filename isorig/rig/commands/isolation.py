"""The isolation ratio, measured and simulated."""

from __future__ import annotations

from pathlib import Path

from isorig.rig.options import Method, Output


def isolation(
    campaign: Path,
    *,
    output: Output,
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
    import numpy as np

    from isorig.analysis.isolation.ratio import friction_bound
    from isorig.analysis.parameters.joint_fit import is_wire_bonder
    from isorig.rig.files.output import write_csv, write_json
    from isorig.rig.files.recording import read
    from isorig.rig.files.rigfile import rig_of
    from isorig.rig.frf.figures import save
    from isorig.rig.isolation.transmissibility import transmissibility, write_transmissibility
    from isorig.rig.wire_bonder.figures import isolation_figure
    from isorig.rig.wire_bonder.isolation import (
        about_isolated,
        about_offset,
        about_peaks,
        compared_isolation,
        given_models,
        isolation_sentences,
    )

    measured = read(campaign)
    models, notes = given_models(model, parameters, method)
    if not is_wire_bonder(rig_of(measured)) or reference or response or configurations:
        compared = transmissibility(
            measured, models, reference=reference, response=response, configurations=configurations, resolution=resolution
        )  # fmt: skip
        for sentence in [*notes, *write_transmissibility(output, compared)]:
            print(sentence)
        print(output)
        return
    found = compared_isolation(measured, models, stitch=stitch, resolution=resolution)
    columns = {"frequency_hz": found.measured.frequency, "gain": found.measured.gain}
    for name, ratio in found.ratios.items():
        plain = name.replace(" ", "_").replace("-", "_")
        columns |= {f"ratio_{plain}": ratio.ratio, f"ratio_{plain}_std": ratio.std}
    if found.stuck:
        columns["friction_bound"] = friction_bound(found.measured, found.stuck).astype(np.float64)
    write_csv(output / "isolation.csv", columns)
    save(isolation_figure(found.ratios, found.stuck), output / "isolation.png")
    sentences = [*notes, *isolation_sentences(found)]
    write_json(
        output / "isolation.json",
        {
            "format": "rig-isolation", "format_version": 1, "stitches_hz": found.measured.stitches,
            "steps": [{"ratio": s, "std": d} for s, d in found.measured.steps],
            "stuck_share": {f"{gain:g}": share for gain, share in found.stuck.items()},
            "isolated": {name: about_isolated(share) for name, share in found.isolated.items()},
            "peaks": {name: about_peaks(ratio.peaks) for name, ratio in found.ratios.items()},
            "peak_offset": {name: about_offset(offset) for name, offset in found.offsets.items()}, "text": sentences,
        },
    )  # fmt: skip
    for sentence in sentences:
        print(sentence)
    print(output)
