"""What seeds the simulator: a parameter table, by the joint fit or by half-power, with deviations and with what is assumed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from isorig.analysis.model.built_in import THESIS, wire_bonder
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.errors import PlanError
from isorig.rig.files.parameter_table import Level, ParameterFile, read_parameters

Method = Literal["joint", "half-power"]
#: What a plot or a sentence calls a table by its method.
CALLED: Mapping[Method, str] = {"joint": "joint fit", "half-power": "half-power"}


@dataclass(frozen=True, kw_only=True)
class Seed:
    """The wire bonder's values by the names of `THESIS`, their deviations, and what is to be said of them.

    Parameters
    ----------
    values, stds
        SI; a value that is exact or assumed has no deviation.
    assumed
        Names that the table does not give, so that the thesis's value stands in.
    notes
        Sentences: how a value came about where that is not plain.
    levels
        The drive as it was measured, by gain and excitation.
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

    def with_value(self, name: str, value: float, std: float) -> Seed:
        """The same with another value, which is then not assumed."""
        return replace(
            self, values={**self.values, name: value}, stds={**self.stds, name: std},
            assumed=tuple(other for other in self.assumed if other != name),
        )  # fmt: skip

    def drawn(self, draws: int, seed: int) -> Iterator[RigModel]:
        """Rigs with the values drawn from their deviations, each by itself; none where nothing has a deviation."""
        generator = np.random.default_rng(seed)
        for _ in range(draws if any(self.stds.values()) else 0):
            # A mass, a frequency or a friction force is never below zero; far out there a draw is no guide.
            yield wire_bonder({k: max(generator.normal(v, self.stds.get(k, 0.0)), 0.01 * v) for k, v in self.values.items()})

    def level(self, gain: float, excitation: str) -> float | None:
        """Size of the drive at a gain, by the nearest gain at which that excitation was measured; None where none was."""
        kind = [level for level in self.levels if level.excitation == excitation]
        near = min(kind, key=lambda level: abs(np.log(level.gain / gain)), default=None)
        return None if near is None else near.value * gain / near.gain

    @property
    def told(self) -> list[str]:
        """What has to be said of the values before anything is simulated with them."""
        said = list(self.notes)
        if self.assumed:
            names = ", ".join(f"{name.replace('_', ' ')} {self.values[name]:g}" for name in self.assumed)
            said.append(f"Not in the parameter table, so the thesis's values are assumed: {names}.")
        return said


#: The thesis's table, which is what a simulation without a parameter table is of.
OF_THESIS = Seed(values=THESIS)


def read_seed(path: Path | None, method: Method = "joint") -> Seed:
    """The seed in a parameters.json; the thesis's own table where there is no file.

    Raises
    ------
    PlanError
        Where the file is not a parameter table, or does not have what the method needs.
    """
    return OF_THESIS if path is None else seed_of(read_parameters(path), method, str(path))


def seed_of(file: ParameterFile, method: Method, where: str) -> Seed:
    """The seed of a parameter table that was read."""
    values, stds = dict(THESIS), dict.fromkeys(THESIS, 0.0)
    found = dict(file.values)
    notes: list[str] = []
    if method == "half-power":
        found |= _half_power(file, where, notes)
    for name, (value, std) in found.items():
        if name in values:
            values[name], stds[name] = value, std
    assumed = tuple(name for name in THESIS if name not in found)
    return Seed(values=values, stds=stds, assumed=assumed, notes=tuple(notes), levels=file.levels)


def _half_power(file: ParameterFile, where: str, notes: list[str]) -> dict[str, tuple[float, float]]:
    # Half-power where it holds; where it is refused the fit of the mode, which sees the same peak, and that is said.
    found: dict[str, tuple[float, float]] = {}
    for body in ("table", "heatblock", "motor"):
        read = file.read_off.get(body)
        if read is None:
            raise PlanError(
                f"{where} has no reading of the {body}'s peak, which half-power needs; run rig characterize on a recording whose "
                "drive reaches it, or take --method joint"
            )
        if not read.half_power:
            notes.append(f"Half-power is refused for the {body} ({read.refused}), so the fit of its mode stands in.")
        found[f"{body}_frequency"], found[f"{body}_damping"] = read.frequency, read.damping
    if file.surface is not None:
        # As the thesis did: the table's effective mass and damping are where the error surface is least.
        found["table_mass"], found["table_damping"] = file.surface
    return found
