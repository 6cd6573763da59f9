"""Every argument of every function of the interface, and of the methods of its records, with values of other types and ranges."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import isorig as iso
from isorig.names import __all__ as names

TAKE = iso.VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=3.0, start=0.0, band=(0.5, 60.0))
CAMPAIGN = iso.virtual_campaign(iso.wire_bonder(), [TAKE, replace(TAKE, id="l70", configuration="locked")], seed=1)
RUN = CAMPAIGN.runs[0]
HEAD = RUN.channels["head"]
RIG = iso.wire_bonder()
DRIVE = iso.Excitation.prepare(np.sin(np.arange(300.0)), 1024.0)
FRFS = iso.frf(CAMPAIGN, resolution=1.0)
SPECTRA = iso.estimate([RUN], references=["head"], resolution=1.0)
RATIO = iso.isolation_ratio(CAMPAIGN, resolution=1.0)


def opened(path: Any) -> None:
    """Open a recording, and close it."""
    with iso.open_recording(path):
        pass


class Stranger:
    """An object that no function knows."""


#: What a notebook may give by mistake.
WRONG: tuple[object, ...] = (
    None, 3, -1, 0, 2.5, float("nan"), float("inf"), 10**30, 1j, True, "head", "", "a\0", b"x", [], ["a"], [1, 2], (1,),
    (5.0, 1.0), {}, {"a": 1}, {1: 2}, np.zeros(3), np.zeros((3, 2)), np.array([np.nan]), slice(0, 3), Stranger(), print,
    pd.DataFrame({"a": [1.0]}), RUN, HEAD, CAMPAIGN, RIG, DRIVE,
)  # fmt: skip
#: Parameters of laws that are no single numbers, and those of two laws that are none.
BEGUN: dict[str, object] = {
    **dict.fromkeys(("at", "values", "levels", "backward"), (0.0, 1.0)),
    **dict.fromkeys(("stiffnesses", "slip_forces"), (1.0, 2.0)),
}  # fmt: skip
OVER: dict[str, dict[str, object]] = {"Curve": {"over": "deflection"}, "FrictionCurve": {"over": "speed"}}
#: Calls that are right, by name, with the arguments that are replaced one by one; those with a default are added.
RIGHT: dict[str, tuple[Callable[..., object], dict[str, object]]] = {
    "Campaign": (iso.Campaign, {"runs": (RUN,)}),
    "Channel": (iso.Channel, {"name": "a", "samples": np.zeros(3)}),
    "Run": (iso.Run, {"id": "a", "configuration": "unlocked", "sample_rate": 1e3, "gain": 1.0, "channels": {"head": HEAD}}),
    "VirtualRun": (iso.VirtualRun, {"id": "a", "configuration": "unlocked", "gain": 1.0, "seconds": 1.0, "start": 0.0}),
    "characterize": (lambda progress: iso.characterize(CAMPAIGN, progress=progress), {"progress": print}),
    "diagnose": (iso.diagnose, {"campaign": CAMPAIGN, "seconds": 0.0}),
    "estimate": (iso.estimate, {"runs": [RUN], "references": ["head"], "resolution": 1.0}),
    "faults": (iso.faults, {"campaign": CAMPAIGN, "reference": "head"}),
    "fit_modes": (iso.fit_modes, {"frf": FRFS[0], "band": (5.0, 60.0)}),
    "frf": (iso.frf, {"campaign": CAMPAIGN, "resolution": 1.0}),
    "import_campaign": (iso.import_campaign, {"mapping_path": "mapping.toml", "output": "o.h5"}),
    "isolated_share": (iso.isolated_share, {"found": RATIO, "above": 5.0}),
    "isolation_ratio": (iso.isolation_ratio, {"campaign": CAMPAIGN, "resolution": 1.0}),
    "modes": (iso.modes, {"frfs": FRFS[:1], "band": (5.0, 60.0)}),
    "open_recording": (opened, {"path": "campaign.h5"}),
    "predict": (iso.predict, {"model": RIG, "campaign": CAMPAIGN}),
    "read": (iso.read, {"path": "campaign.h5"}),
    "read_rig": (iso.read_rig, {"given": "two-carts"}),
    "simulate": (iso.simulate, {"model": RIG, "excitation": DRIVE}),
    "trace": (iso.trace, {"model": RIG, "excitation": DRIVE}),
    "virtual_campaign": (iso.virtual_campaign, {"model": RIG, "takes": [TAKE]}),
    "wire_bonder": (iso.wire_bonder, {}),
    "write": (iso.write, {"path": "x.h5", "campaign": CAMPAIGN}),
    "Excitation": (iso.Excitation.prepare, {"drive": np.zeros(300), "sample_rate": 1024.0}),
    "Excitation.beginning": (DRIVE.beginning, {"samples": 3}),
    "Excitation.resampled": (DRIVE.resampled, {"oversample": 3}),
    "Campaign.select": (CAMPAIGN.select, {}),
    "Campaign.seconds_since_start": (CAMPAIGN.seconds_since_start, {"run": RUN}),
    "Channel.read": (HEAD.read, {}),
    "Run.channel": (RUN.channel, {"name": "head"}),
    "Run.read": (RUN.read, {"name": "head"}),
    "Rig.body": (RIG.body, {"name": "table"}),
    "Rig.contact": (RIG.contact, {"name": "isolation"}),
    "Rig.link": (RIG.link, {"name": "table"}),
    "Rig.sensor": (RIG.sensor, {"channel": "table"}),
    "Rig.state_space": (RIG.state_space, {}),
    "Spectra.density": (SPECTRA.density, {"channel": "head"}),
    "Spectra.extent": (SPECTRA.extent, {"channel": "head"}),
    "Spectra.frf": (SPECTRA.frf, {"response": "table", "reference": "head"}),
    "Spectra.frfs": (SPECTRA.frfs, {"response": "table", "references": ["head"]}),
    "Spectra.unit": (SPECTRA.unit, {"channel": "head"}),
} | {
    f"laws.{name}": (law, {k: BEGUN.get(k, 1.0) for k in law.parameters if k not in law.optional} | OVER.get(name, {}))
    for name, law in vars(iso.laws).items() if inspect.isclass(law) and getattr(law, "parameters", None)
}  # fmt: skip
#: Names that are no function, or whose functions are listed above.
OTHER = {"AnalysisError", "RigError", "Rig", "laws"}


def given_to(function: Callable[..., object], arguments: Mapping[str, object]) -> dict[str, object]:
    """All arguments of a call, those with a default too."""
    parameters = inspect.signature(function).parameters.values()
    return {p.name: p.default for p in parameters if p.default is not p.empty} | dict(arguments)


def test_every_name_is_tried() -> None:
    assert set(names) - OTHER == {name for name in RIGHT if "." not in name}


@pytest.mark.parametrize("name", RIGHT)
def test_no_argument_ends_in_an_error_of_the_language(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    iso.write("campaign.h5", CAMPAIGN)
    function, arguments = RIGHT[name]
    kinds = {p.name: p.kind for p in inspect.signature(function).parameters.values()}
    usual = given_to(function, arguments)
    raw = []
    for argument in usual:
        for wrong in WRONG:
            values: dict[str, Any] = usual | {argument: wrong}
            by_place = [value for key, value in values.items() if kinds[key] is inspect.Parameter.POSITIONAL_ONLY]
            try:
                function(*by_place, **{k: v for k, v in values.items() if kinds[k] is not inspect.Parameter.POSITIONAL_ONLY})
            except (iso.AnalysisError, iso.RigError) as refusal:
                if "\n" in str(refusal):
                    raw.append(f"{argument} = {wrong!r}: {refusal}")
            except Exception as error:
                raw.append(f"{argument} = {wrong!r}: {type(error).__name__}: {error}")
    assert not raw
