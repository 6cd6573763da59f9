"""The transfer functions of one set-up, from a recording or from another program's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from isorig.analysis.errors import DataError
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.spectra.welch import Frf
from isorig.rig.exchange.responses import read_responses
from isorig.rig.files.recording import open_recording
from isorig.rig.files.rigfile import rig_of
from isorig.rig.transfer import Transfer, faults_in, transfer_functions, unnamed_excitation

#: Quantities whose transfer functions have mode shapes: motions.
MOTIONS = (
    "acceleration", "velocity", "displacement", "angular_acceleration", "angular_velocity", "angle",
)  # fmt: skip
#: Endings of recordings.
RECORDINGS = (".h5", ".hdf5")


@dataclass(frozen=True, kw_only=True)
class Source:
    """Transfer functions with the band (Hz) that was driven, the rig they were measured on, and sentences about them."""

    frfs: tuple[Frf, ...]
    band: tuple[float, float]
    set_up: str
    rig: RigModel | None
    text: tuple[str, ...]


def transfer_functions_of(
    path: Path, *, references: Sequence[str] = (), responses: Sequence[str] = (), resolution: float = 0.25,
    configuration: str | None = None, gain: float | None = None,
) -> Source:  # fmt: skip
    """The transfer functions of a recording (estimated) or of another program's file (as they are).

    Parameters
    ----------
    path
        A recording, or a file with transfer functions.
    references, responses
        The channels that are used; the head, or all of a file, and all other motions where none is named.
    resolution
        Wanted frequency resolution of an estimate, Hz.
    configuration, gain
        The set-up of a recording that has several.

    Raises
    ------
    DataError
        Where the file holds several set-ups and none is chosen, or lacks what is named.
    """
    if path.suffix.lower() not in RECORDINGS:
        return _of_other_program(path, references, responses)
    with open_recording(path) as campaign:
        wrong = faults_in(campaign, references[0] if references else "head")
        drives = references or ("head",)
        sensors = campaign.runs[0].sensors if campaign.runs else {}
        moving = [name for name, channel in sensors.items() if channel.quantity in MOTIONS and name not in drives]
        found = transfer_functions(campaign, reference=drives, responses=responses or moving, resolution=resolution, found=wrong)
        said = (*(fault.text for fault in wrong), *unnamed_excitation(found, campaign))
        rig = rig_of(campaign)
    chosen = [
        item for item in found
        if (configuration is None or item.configuration == configuration) and (gain is None or item.gain == gain)
    ]  # fmt: skip
    labels = list(dict.fromkeys(item.label for item in (chosen or found)))
    if len({item.label for item in chosen}) != 1:
        problem = "has several set-ups" if chosen else "has no such set-up"
        raise DataError(f"{path} {problem} ({'; '.join(labels)}); choose one with --configuration and --gain")
    return _chosen(chosen, labels[0], rig, said)


def _chosen(chosen: Sequence[Transfer], label: str, rig: RigModel, said: Sequence[str]) -> Source:
    hammers = dict.fromkeys(text for item in chosen if item.hammer is not None for text in item.hammer.text)
    band = max(item.band[0] for item in chosen), min(item.band[1] for item in chosen)
    return Source(frfs=tuple(item.frf for item in chosen), band=band, set_up=label, rig=rig, text=(*said, *hammers))


def _of_other_program(path: Path, references: Sequence[str], responses: Sequence[str]) -> Source:
    found = read_responses(path)
    has = {name for frf in found for name in (frf.response, frf.reference)}
    absent = [name for name in (*references, *responses) if name not in has]
    if absent:
        names = ", ".join(sorted(name for name in has if name))
        raise DataError(f"{path} has no channel {absent[0]!r}; it has {names}, so name one of these")
    chosen = tuple(
        frf for frf in found
        if (not references or frf.reference in references) and (not responses or frf.response in responses)
    )  # fmt: skip
    spacing, top = chosen[0].resolution, float(chosen[0].frequency[-1])
    text = "The file does not state how its transfer functions were averaged and windowed: they are used as they are."
    return Source(frfs=chosen, band=(spacing, top), set_up="", rig=None, text=(text,))
