"""Transfer functions estimated by other programs, for fits and plots."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Spectrum
from isorig.analysis.spectra.welch import Frf
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.files.inputs import import_first

#: Tolerance for equal frequency steps, as a share of a step.
EVEN = 1e-3


def read_responses(path: Path) -> list[Frf]:
    """The transfer functions of a file in another program's format (.uff, .mat, .csv, .npz ...), with even frequency steps.

    Their coherence is the file's if it has one, otherwise 1. The number of averages is unknown, so `averages` is 1 and the
    standard deviations are meaningless. Raises RecordingError, with what the file has and what to do, if it has none.
    """
    table = read_foreign(path)
    responses = [spectrum for spectrum in table.spectra if spectrum.kind == "transfer_function"]
    coherences = {(s.response, s.reference): s for s in table.spectra if s.kind == "coherence"}
    found = [
        _frf(spectrum, coherences.get((spectrum.response, spectrum.reference)))
        for spectrum in responses
        if np.ptp(np.diff(spectrum.frequency)) <= EVEN * _spacing(spectrum)
    ]
    if not found:
        if responses:
            raise RecordingError(f"{path} contains transfer functions with uneven frequency steps; export them with even ones")
        has = f"time records; {import_first(path)}" if table.columns else "spectra without a phase; export the transfer functions"
        raise RecordingError(f"{path} contains no transfer function but {has}")
    return found


def _frf(spectrum: Spectrum, coherence: Spectrum | None) -> Frf:
    value = np.asarray(spectrum.values, dtype=np.complex128)
    share = np.ones(len(value)) if coherence is None or coherence.values.shape != value.shape else np.real(coherence.values)
    share = np.clip(share, np.finfo(float).eps, 1.0)
    relative = np.sqrt((1.0 - share) / (2.0 * share))
    return Frf(
        response=spectrum.response, reference=spectrum.reference, frequency=spectrum.frequency, value=value, coherence=share,
        magnitude_std=np.abs(value) * relative, phase_std=np.minimum(relative, np.pi), averages=1.0,
        resolution=_spacing(spectrum), estimator="H1",
    )  # fmt: skip


def _spacing(spectrum: Spectrum) -> float:
    return float(spectrum.frequency[-1] - spectrum.frequency[0]) / max(len(spectrum.frequency) - 1, 1)
