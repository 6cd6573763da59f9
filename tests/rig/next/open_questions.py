"""Diagnoses that leave something open, made up: what `rig diagnose` would have written, without its minutes."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from isorig.analysis import laws
from isorig.analysis.diagnose.causes.at_link import added
from isorig.analysis.fitting.solve import base_parameters, positive
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.files.rivals import NAME, ExistingRun, FittedModel, OpenSet, Rivals, fitted_model
from isorig.rig.wire_bonder.description import wire_bonder

#: Stiffening of the hidden spring at 4 mm, and a stop that does about the same to small swings.
STIFFENS, STOP = 0.15, 0.003


def fitted(model: RigModel, cause: str = "", *paths: str, std: float = 1e-5) -> FittedModel:
    """A model whose parameters, and `paths` of the cause, are known to a hundred-thousandth."""
    free = (*base_parameters(wire_bonder()), *(positive(path, model.get(path)) for path in paths))
    covariance = np.diag([(std * model.get(f.path)) ** 2 for f in free])
    return fitted_model(cause, "isolation" if cause else "", model, free, covariance)


def hardening() -> FittedModel:
    """The rig with a hardening spring."""
    rig = wire_bonder()
    link = rig.link("isolation")
    law = laws.Cubic(cubic_stiffness=STIFFENS * link.stiffness / 0.004**2)
    path = "links.isolation.laws.0.cubic_stiffness"
    return fitted(added(rig, link, law), "hardening_stiffness", path)


def end_stop() -> FittedModel:
    """The rig with a soft stop."""
    rig = wire_bonder()
    link = rig.link("isolation")
    law = laws.EndStop(stroke=STOP, contact_stiffness=0.5 * link.stiffness, contact_damping=1.0)
    paths = ("links.isolation.laws.0.stroke", "links.isolation.laws.0.contact_stiffness")
    return fitted(added(rig, link, law), "end_stop", *paths)


def rivals(*open_sets: OpenSet, verdict: str = "explained", explains: FittedModel | None = None, **changes: object) -> Rivals:
    """A diagnosis of two runs."""
    runs = [
        ExistingRun(
            id=f"u{gain:g}", configuration="unlocked", excitation="random", gain=gain, seconds=20.0, start_time=start,
            drive_rms=3.8 * gain / 70.0, drive_peak=4.0 * 3.8 * gain / 70.0, band=(0.5, 20.0),
        )
        for gain, start in ((35.0, 0.0), (20.0, 50.0))
    ]  # fmt: skip
    found = Rivals(
        campaign="lab.h5", verdict=verdict, baseline="coulomb", sample_rate=1024.0,
        noise=dict.fromkeys(("head", "motor", "table", "heatblock"), 1e-3),
        known={"head_mass": 6.5, "motor_mass": 16.4, "heatblock_mass": 6.0, "table_mass": 250.0}, runs=runs,
        explains=explains or fitted(wire_bonder()), open=list(open_sets), named=[], ruled_out=[],
    )  # fmt: skip
    return msgspec.structs.replace(found, **changes)


def two_springs() -> OpenSet:
    """A hardening spring and a soft stop that stand together."""
    return OpenSet(why="indistinguishable", models=[hardening(), end_stop()])


def written(folder: Path, found: Rivals) -> Path:
    """The folder of a diagnosis."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NAME).write_bytes(msgspec.json.encode(found))
    return folder
