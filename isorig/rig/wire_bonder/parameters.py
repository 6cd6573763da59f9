"""Simulator parameters from a parameter table, by the joint fit or by half-power, with uncertainties and assumptions."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import words
from isorig.rig.choices import Method
from isorig.rig.errors import PlanError
from isorig.rig.files.parameter_table import Level, ParameterFile, read_parameters
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

#: Name of a method in plots and sentences.
CALLED: Mapping[Method, str] = {"joint": "joint fit", "half-power": "half-power"}


@dataclass(frozen=True, kw_only=True)
class RigValues:
    """The wire bonder's values by the names of `THESIS`, SI, their standard uncertainties, and notes on their origin.

    An exact or assumed value has no standard uncertainty; `assumed` are names missing from the table, for which the thesis's
    value is used. `levels` are the measured drive levels, by gain and excitation.
    """

    values: Mapping[str, float]
    stds: Mapping[str, float] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    levels: tuple[Level, ...] = ()

    @property
    def model(self) -> RigModel:
        """The rig with these values."""
        return wire_bonder(self.values)

    def drawn(self, draws: int, seed: int) -> Iterator[RigModel]:
        """Rigs with values drawn independently from their standard uncertainties; none if there are no uncertainties."""
        generator = np.random.default_rng(seed)
        for _ in range(draws if any(self.stds.values()) else 0):
            # Masses, frequencies and friction forces are never negative; draws that far out are discarded.
            yield wire_bonder({k: max(generator.normal(v, self.stds.get(k, 0.0)), 0.01 * v) for k, v in self.values.items()})

    def level(self, gain: float, excitation: str) -> float | None:
        """Drive level at a gain, from the nearest gain at which that excitation was measured; None if there is none."""
        kind = [level for level in self.levels if level.excitation == excitation]
        near = min(kind, key=lambda level: abs(np.log(level.gain / gain)), default=None)
        return None if near is None else near.value * gain / near.gain

    @property
    def remarks(self) -> list[str]:
        """Notes to be printed before a simulation with these values."""
        said = list(self.notes)
        if self.assumed:
            names = ", ".join(f"{words(name)} {self.values[name]:g}" for name in self.assumed)
            said.append(f"Not in the parameter table, so the thesis's values are assumed: {names}.")
        return said


#: The thesis's table, used for simulations without a parameter table.
OF_THESIS = RigValues(values=THESIS)


def read_rig_values(path: Path | None, method: Method = "joint") -> RigValues:
    """The parameters in a parameters.json; the thesis's table if there is no file. Raises PlanError if the file is not a
    parameter table, or lacks what the method needs."""
    if path is None:
        return OF_THESIS
    file = read_parameters(path)
    if not file.values.keys() & THESIS.keys():
        raise PlanError(
            f"{path} is the parameter table of another rig than the wire bonder; give the model.json next to it with --model"
        )
    found = dict(file.values)
    notes: list[str] = []
    if method == "half-power":
        found |= _half_power(file, path, notes)
    known = {name: found.get(name, (assumed, 0.0)) for name, assumed in THESIS.items()}
    return RigValues(
        values={name: value for name, (value, _) in known.items()}, stds={name: std for name, (_, std) in known.items()},
        assumed=tuple(name for name in THESIS if name not in found), notes=tuple(notes), levels=file.levels,
    )  # fmt: skip


def _half_power(file: ParameterFile, path: Path, notes: list[str]) -> dict[str, tuple[float, float]]:
    # Half-power if it is applicable; otherwise the modal fit of the same peak, with a note.
    found: dict[str, tuple[float, float]] = {}
    for body in ("table", "heatblock", "motor"):
        read = file.read_off.get(body)
        if read is None:
            raise PlanError(
                f"{path} has no value for the {body}'s peak, which half-power needs; run rig characterize on a recording whose "
                "drive excites it, or use --method joint"
            )
        if not read.half_power:
            notes.append(f"Half-power is not applicable to the {body} ({read.refused}), so the modal fit is used instead.")
        found[f"{body}_frequency"], found[f"{body}_damping"] = read.frequency, read.damping
    if file.surface is not None:
        # As in the thesis: the table's effective mass and damping are at the minimum of the error surface.
        found["table_mass"], found["table_damping"] = file.surface
    return found
