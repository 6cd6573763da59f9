"""Transfer functions estimated by other programs, for fits and plots."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Spectrum
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.welch import Frf
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.files.inputs import import_first
from isorig.rig.frf.transfer import Transfer

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


def imported(path: Path, references: Sequence[str], responses: Sequence[str]) -> list[Transfer]:
    """The transfer functions of a file between these channels (all if none are named), under names that are valid in file names.

    Raises RecordingError if the file has none, DataError if none is between them.
    """
    frfs = read_responses(path)
    chosen = [f for f in frfs if (not references or f.reference in references) and (not responses or f.response in responses)]
    if not chosen:
        has = ", ".join(f"{frf.response} over {frf.reference}" for frf in frfs[:8])
        raise DataError(f"{path} has no transfer function of these channels but {has}; name those")
    names: dict[str, int] = {}
    found = []
    for frf in chosen:
        response, reference = (re.sub(r"[^\w.+-]+", "_", name).strip("._") or "unnamed" for name in (frf.response, frf.reference))
        count = names[f"{response} {reference}"] = names.get(f"{response} {reference}", 0) + 1
        named = replace(frf, response=response if count == 1 else f"{response}-{count}", reference=reference)
        found.append(
            Transfer.of(
                named, configuration=path.stem, gain=1.0, runs=(), band=(float(frf.frequency[0]), float(frf.frequency[-1])),
                reference_density=np.zeros(len(frf.frequency)), imported=True,
            )
        )  # fmt: skip
    return found
