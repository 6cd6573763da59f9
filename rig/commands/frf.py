"""rig frf: transfer functions with coherence and error bars."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter


def frf(
    campaign: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    reference: str = "head",
    response: tuple[str, ...] = (),
    resolution: float = 0.25,
    estimator: Literal["H1", "H2", "Hv"] = "H1",
) -> None:
    """Estimate transfer functions, averaged over the runs of each configuration and gain.

    Example: rig frf campaign.h5 --reference table --response heatblock -o frf

    Parameters
    ----------
    campaign
        A recording.
    output
        The folder for a picture and a table of each transfer function, and frf.json about all.
    reference
        The channel that drives.
    response
        The channels that answer; all others where absent.
    resolution
        Distance of lines, Hz.
    estimator
        H1 has no bias from noise in the response, H2 none from noise in the reference, Hv shares it.
    """
    import numpy as np

    from rig.figures import frf_figure, save
    from rig.output import write_csv, write_json
    from rig.recording import open_recording
    from rig.terminal import show_table
    from rig.transfer import about, transfer_functions

    with open_recording(campaign) as measured:
        found = transfer_functions(measured, reference=reference, responses=response, resolution=resolution, estimator=estimator)
    for item in found:
        value = item.frf
        columns = {
            "frequency_hz": value.frequency, "real": value.value.real, "imag": value.value.imag, "magnitude": np.abs(value.value),
            "magnitude_std": value.magnitude_std, "phase_std_rad": value.phase_std, "coherence": value.coherence,
        }  # fmt: skip
        write_csv(output / f"{item.name}.csv", columns)
    for name in dict.fromkeys(item.frf.response for item in found):
        same = [item for item in found if item.frf.response == name]
        band = min(item.band[0] for item in same), max(item.band[1] for item in same)
        figure = frf_figure({item.label: item.within_band() for item in same}, band)
        save(figure, output / f"{name}-over-{reference}.png")
    write_json(output / "frf.json", {"format": "rig-frf", "format_version": 1, "transfer_functions": [about(i) for i in found]})
    show_table(
        f"{campaign.name}: {estimator} at {found[0].frf.resolution:g} Hz",
        ("response", "set-up", "gain", "band, Hz", "peak, Hz", "magnitude", "coherence"),
        [_row(about(item)) for item in found],
    )
    print(output)


def _row(told: dict[str, Any]) -> list[str]:
    band, peak = told["band_hz"], told["peak"]
    return [
        told["response"],
        told["configuration"],
        f"{told['gain']:g}", f"{told['averages']:.0f}", f"{band[0]:g}–{band[1]:g}", f"{peak['frequency_hz']:.2f}",
        f"{peak['magnitude']:.3g} ± {peak['magnitude_std']:.1g}", f"{told['median_coherence']:.3f}",
    ]  # fmt: skip
