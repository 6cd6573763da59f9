"""rig frf: transfer functions with coherence and error bars."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from isorig.analysis.campaign import Campaign
    from isorig.analysis.spectra.quality import Fault
    from isorig.rig.transfer import Transfer

#: Seconds between two looks at a recording that is being made.
LOOK = 2.0


def frf(
    campaign: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    reference: str = "head",
    response: tuple[str, ...] = (),
    resolution: float = 0.25,
    estimator: Literal["H1", "H2", "Hv"] = "H1",
    follow: bool = False,
) -> None:
    """Estimate transfer functions, averaged over the runs of each configuration and gain.

    Example: rig frf campaign.h5 --reference table --response heatblock -o frf

    Parameters
    ----------
    campaign
        A recording.
    output
        The folder for a picture and a table of each transfer function, and frf.json about all. Where the drive repeats, also
        what its periods say of noise and distortion. Bad records are named, and left out where others remain.
    reference
        The channel that drives.
    response
        The channels that answer; all others where absent.
    resolution
        Distance of lines, Hz.
    estimator
        H1 has no bias from noise in the response, H2 none from noise in the reference, Hv shares it.
    follow
        The recording is being made: estimate from what is there, again and again until it is finished.
    """
    from isorig.analysis.errors import DataError
    from isorig.rig.acquire.follow import follow as followed
    from isorig.rig.files.recording import open_recording
    from isorig.rig.transfer import faults_in, transfer_functions

    def found_in(measured: Campaign) -> tuple[list[Transfer], Sequence[Fault]]:
        wrong = faults_in(measured, reference)
        return transfer_functions(
            measured, reference=reference, responses=response, resolution=resolution, estimator=estimator, found=wrong
        ), wrong

    if not follow:
        with open_recording(campaign) as measured:
            found = found_in(measured)
        _tell(*found, output, campaign.name)
        print(output)
        return
    for measured, finished in followed(campaign, every=LOOK, shortest=2.0 / resolution):
        try:
            found = found_in(measured)
        except DataError:
            if finished:
                raise
            # There is no broad-band run yet.
            continue
        seconds = sum(run.duration for run in measured.runs)
        _tell(*found, output, f"{campaign.name}, {seconds:.0f} s" + (" in all" if finished else " so far"))
    print(output)


def _tell(found: Sequence[Transfer], wrong: Sequence[Fault], output: Path, name: str) -> None:
    import numpy as np

    from isorig.rig.figures import frf_figure, periods_figure, save
    from isorig.rig.files.output import write_csv, write_json
    from isorig.rig.terminal import show_table
    from isorig.rig.transfer import about

    for item in found:
        value = item.frf
        columns = {
            "frequency_hz": value.frequency, "real": value.value.real, "imag": value.value.imag, "magnitude": np.abs(value.value),
            "magnitude_std": value.magnitude_std, "phase_std_rad": value.phase_std, "coherence": value.coherence,
        }  # fmt: skip
        write_csv(output / f"{item.name}.csv", columns)
        if (by := item.periods) is not None:
            columns = {
                "frequency_hz": by.frequency, "real": by.value.real, "imag": by.value.imag, "magnitude": np.abs(by.value),
                "magnitude_std": by.magnitude_std, "phase_std_rad": by.phase_std, "noise": by.noise, "distortion": by.distortion,
            }  # fmt: skip
            write_csv(output / f"{item.name}-periods.csv", columns)
    for response, reference in dict.fromkeys((item.frf.response, item.frf.reference) for item in found):
        same = [item for item in found if item.frf.response == response]
        band = min(item.band[0] for item in same), max(item.band[1] for item in same)
        figure = frf_figure({item.label: item.within_band() for item in same}, band)
        save(figure, output / f"{response}-over-{reference}.png")
        if any(item.periods is not None for item in same):
            periods = {item.label: item.periods for item in same if item.periods is not None}
            save(periods_figure(periods), output / f"{response}-over-{reference}-periods.png")
    rows = [about(item) for item in found]
    content = {"format": "rig-frf", "format_version": 1, "transfer_functions": rows, "faults": [f.text for f in wrong]}
    write_json(output / "frf.json", content)
    show_table(
        f"{name}: {found[0].frf.estimator} at {found[0].frf.resolution:g} Hz",
        ("response", "set-up", "gain", "avg", "band, Hz", "peak, Hz", "magnitude", "coherence"),
        [_row(row) for row in rows],
    )
    for sentence in [f.text for f in wrong] + [row["periods"]["text"] for row in rows if "periods" in row]:
        print(sentence)


def _row(told: dict[str, Any]) -> list[str]:
    band, peak = told["band_hz"], told["peak"]
    return [
        told["response"],
        told["configuration"],
        f"{told['gain']:g}", f"{told['averages']:.0f}", f"{band[0]:g}–{band[1]:g}", f"{peak['frequency_hz']:.2f}",
        f"{peak['magnitude']:.3g} ± {peak['magnitude_std']:.1g}", f"{told['median_coherence']:.3f}",
    ]  # fmt: skip
