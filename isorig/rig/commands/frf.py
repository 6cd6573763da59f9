"""Transfer functions with coherence and error bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from isorig.rig.options import OutputFolder

if TYPE_CHECKING:
    from isorig.analysis.campaign import Campaign
    from isorig.rig.frf.drawing import FigureProcess
    from isorig.rig.frf.figures import View
    from isorig.rig.frf.transfer import Transfer

    #: Transfer functions, sentences on faulty records, and remarks.
    Found = tuple[list[Transfer], Sequence[str], Sequence[str]]

#: Seconds between two readings of a recording that is being made.
LOOK = 2.0
#: File name extensions of recordings; files of other programs have other ones.
HDF5 = (".h5", ".hdf5", ".hdf")
AS_THEY_ARE = "These are transfer functions of another program, written as they are: options of the estimate have no effect."


def frf(
    campaign: Path,
    *others: Path,
    output: OutputFolder,
    reference: tuple[str, ...] = (),
    response: tuple[str, ...] = (),
    resolution: float = 0.25,
    estimator: Literal["H1", "H2", "Hv"] = "H1",
    window: Literal["hann", "hamming", "blackman", "flattop", "rectangular"] = "hann",
    overlap: float = 0.5,
    view: tuple[Literal["bode", "parts", "nyquist"], ...] = ("bode",),
    band: tuple[float, float] | None = None,
    follow: bool = False,
) -> None:
    """Estimate transfer functions, averaged over the runs of each configuration and gain.

    Runs of unnamed excitation whose reference consists of hammer pulses are evaluated as a hammer test: each hit is cut out with
    a pre-trigger, checked, windowed and averaged with the others. Double hits, overloads, weak hits and hits on a rig that still
    vibrates are rejected; each rejection is printed.

    Example: rig frf campaign.h5 --reference table --response heatblock -o frf

    Example: rig frf before.h5 after.h5 -o compared

    Parameters
    ----------
    campaign
        A recording, or a file of another program (.uff, .mat, .csv ...) that contains transfer functions.
    others
        Further ones, overlaid in the figures and on the page; each gets a folder of its own for its tables.
    output
        The folder for a figure and a table of each transfer function, the page frf.html, and frf.json. For a periodic drive,
        also noise and distortion from its periods. Faulty records are reported, and left out if there are others. The tables
        have 95 % limits of the magnitude, corrected for leakage at narrow peaks; where there are none (nan), a sentence states
        the reason.
    reference
        The channel that drives, once for each channel if several drive at the same time (MIMO). The default are the drives of
        the rig's description, of the wire bonder the head.
    response
        The response channels; by default all others.
    resolution
        Frequency resolution, Hz.
    estimator
        H1 is unbiased by noise on the response, H2 by noise on the reference; Hv (total least squares) allows for noise on all
        channels.
    window
        The window of the segments. Hammer tests use a force window, and an exponential window if a response still rings.
    overlap
        Overlap of the segments, 0 to 0.95 of their length.
    view
        Figures: magnitude, phase and coherence (bode), real and imaginary part (parts), complex plane (nyquist). Repeatable.
    band
        Lowest and highest frequency of the figures, Hz; by default the band of the drive.
    follow
        For a recording that is being written: estimate repeatedly from the available data until it is finished.
    """
    from isorig.analysis.errors import DataError
    from isorig.rig.files.hdf import start_checks
    from isorig.rig.frf.drawing import drawn_elsewhere

    paths = (campaign, *others)
    if band is not None and not 0.0 <= band[0] < band[1]:
        raise DataError(f"the band {band[0]:g} to {band[1]:g} Hz has no width; give the lower frequency first")
    if follow and others:
        raise DataError("--follow reads one recording that is being written; give one")
    if len({path.stem for path in paths}) < len(paths):
        raise DataError("two recordings have the same name; rename one, because the curves and folders are named after them")
    start_checks()
    with drawn_elsewhere() as drawing:
        # Meanwhile this process imports what it needs until the figures are drawn.
        from isorig.rig.acquire.policy import COHERENT
        from isorig.rig.acquire.run_check import incoherences
        from isorig.rig.files.recording import open_recording
        from isorig.rig.files.rigfile import references_of
        from isorig.rig.frf.transfer import faults_in, transfer_functions, unnamed_excitation

        def found_in(measured: Campaign) -> Found:
            drives = reference or references_of(measured)
            wrong = faults_in(measured, drives[0])
            found = transfer_functions(
                measured, reference=drives, responses=response, resolution=resolution, estimator=estimator, window=window,
                overlap=overlap, found=wrong, jackknife=False,
            )  # fmt: skip
            # Responses with a low coherence at any level.
            low = dict.fromkeys(t.response for t in found if t.median_coherence < COHERENT)
            why = [reason.text for reason in incoherences(measured, drives, list(low))]
            return found, [*(fault.text for fault in wrong), *unnamed_excitation(found, measured)], why

        def foreign(path: Path) -> bool:
            if path.suffix.lower() in HDF5:
                return False
            from isorig.rig.exchange.formats import FORMATS

            return path.suffix.lower() in FORMATS

        def found_of(path: Path) -> Found:
            if foreign(path):
                from isorig.rig.exchange.responses import imported

                return imported(path, reference, response), (), (AS_THEY_ARE,)
            with open_recording(path) as measured:
                return found_in(measured)

        if not follow or foreign(campaign):
            found = {path.stem: found_of(path) for path in paths}
            _write(found, " and ".join(path.name for path in paths), output, drawing, view, band)
            print(output)
            return
        from isorig.rig.acquire.recover import follow as followed

        for measured, finished in followed(campaign, every=LOOK, shortest=2.0 / resolution):
            try:
                found = {campaign.stem: found_in(measured)}
            except DataError:
                if finished:
                    raise
                # There is no broad-band run yet.
                continue
            seconds = sum(run.duration for run in measured.runs)
            name = f"{campaign.name}, {seconds:.0f} s" + (" in all" if finished else " so far")
            _write(found, name, output, drawing, view, band)
        print(output)


def _write(
    found: Mapping[str, Found], name: str, output: Path, drawing: FigureProcess, view: Sequence[View],
    band: tuple[float, float] | None,
) -> None:  # fmt: skip
    from isorig.rig.frf.drawing import FrfPicture

    several = len(found) > 1
    shown = [
        (f"{stem}: {item.label}" if several else item.label, item) for stem, (items, _, _) in found.items() for item in items
    ]
    pairs: dict[str, dict[str, Transfer]] = {}
    for label, item in shown:
        pairs.setdefault(f"{item.response}-over-{item.reference}", {})[label] = item
    for pair, same in pairs.items():
        reached = min(item.band[0] for item in same.values()), max(item.band[1] for item in same.values())
        curves = {label: item.within_band() for label, item in same.items()}
        for each in dict.fromkeys(view):
            path = output / f"{pair}{'' if each == 'bode' else f'-{each}'}.png"
            drawing.draw(FrfPicture(path=path, curves=curves, band=band or reached, view=each))
        periods = {label: item.periods for label, item in same.items() if item.periods is not None}
        if periods:
            drawing.draw(FrfPicture(path=output / f"{pair}-periods.png", periods=periods))
    # Meanwhile this process does the rest.
    from isorig.rig.files.output import write_text
    from isorig.rig.frf.transfer import limits_in_words
    from isorig.rig.report.frequency import frf_page

    remarks = []
    for stem, (items, wrong, why) in found.items():
        said = [*why, *limits_in_words(items)]
        _write_tables(items, wrong, said, output / stem if several else output, f"{stem}.h5" if several else name)
        remarks += [f"{stem}: {text}" if several else text for text in (*wrong, *said)]
    write_text(output / "frf.html", frf_page(shown, name, remarks))
    drawing.wait()


def _write_tables(found: Sequence[Transfer], wrong: Sequence[str], remarks: Sequence[str], output: Path, name: str) -> None:
    import numpy as np

    from isorig.rig.files.output import write_csv, write_json
    from isorig.rig.frf.transfer import about
    from isorig.rig.process.terminal import show_table

    for item in found:
        columns = {
            "frequency_hz": item.frequency, "real": item.value.real, "imag": item.value.imag, "magnitude": np.abs(item.value),
            "magnitude_std": item.magnitude_std, "magnitude_low": item.limits.low, "magnitude_high": item.limits.high,
            "leakage": item.limits.leakage, "largest_reference_noise": item.limits.reference_noise,
            "phase_std_rad": item.phase_std, "coherence": item.coherence,
        }  # fmt: skip
        if item.multiple_coherence is not None:
            columns["multiple_coherence"] = item.multiple_coherence
        write_csv(output / f"{item.name}.csv", columns)
        if (by := item.periods) is not None:
            columns = {
                "frequency_hz": by.frequency, "real": by.value.real, "imag": by.value.imag, "magnitude": np.abs(by.value),
                "magnitude_std": by.magnitude_std, "phase_std_rad": by.phase_std, "noise": by.noise, "distortion": by.distortion,
            }  # fmt: skip
            write_csv(output / f"{item.name}-periods.csv", columns)
    rows = [about(item) for item in found]
    content = {"format": "rig-frf", "format_version": 1, "transfer_functions": rows, "faults": [*wrong], "remarks": [*remarks]}
    write_json(output / "frf.json", content)
    several = len({item.reference for item in found}) > 1
    hidden = {
        "response": several, "response over reference": not several, "set-up": all(item.alone for item in found),
        "rms of drive": not any(item.level for item in found),
    }  # fmt: skip
    shown = [{name: cell for name, cell in _row(row).items() if not hidden.get(name)} for row in rows]
    title = f"{name}: {found[0].frf.estimator} at {found[0].frf.resolution:g} Hz"
    show_table(title, list(shown[0]), [list(row.values()) for row in shown])
    hammers = dict.fromkeys(text for row in rows if "hammer" in row for text in row["hammer"]["text"])
    for sentence in [*wrong, *hammers, *(row["periods"]["text"] for row in rows if "periods" in row), *remarks]:
        print(sentence)


def _row(result: dict[str, Any]) -> dict[str, str]:
    from isorig.analysis.wording import unit_ratio

    band, peak, (over, by) = result["band_hz"], result["peak"], result["units"]
    # A unit if those of response and reference are known and not equal.
    unit = f" {unit_ratio(over, by)}" if over and by and over != by else ""
    return {
        "response": result["response"], "response over reference": f"{result['response']} / {result['reference']}",
        "set-up": result["configuration"], "gain": f"{result['gain']:g}", "rms of drive": result["level"] or "–",
        "avg": "–" if result["averages"] is None else f"{result['averages']:.0f}", "band, Hz": f"{band[0]:.3g}–{band[1]:.3g}",
        "peak, Hz": f"{peak['frequency_hz']:.2f}", "magnitude (95 %)": _magnitude(peak) + unit,
        "coh.": f"{result['median_coherence']:.3f}",
    }  # fmt: skip


def _magnitude(peak: dict[str, Any]) -> str:
    # Corrected for leakage as its limits are, to two or three digits of their width.
    if peak["magnitude_limits"] is None:
        return f"{peak['magnitude']:.3g} (none)"
    low, high = peak["magnitude_limits"]
    width = max(high - low, 1e-6 * high)
    digits = min(6, int(log10(high / width)) + 3) if width > 0.0 else 3
    return f"{peak['magnitude'] - peak['leakage']:.{digits}g} ({low:.{digits}g}–{high:.{digits}g})"
