"""What other programs read: samples, transfer functions and parameter tables as frames, .mat and universal files."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from analysis.measured import Campaign, FloatArray, Run
from rig.errors import PlanError
from rig.output import replaced
from rig.transfer import Transfer

#: Dataset 58: ordinate data types by SI unit (SDRC universal file; 8 displacement, 11 velocity, 12 acceleration, 13 force).
ORDINATES = {"m": 8, "m/s": 11, "m/s^2": 12, "N": 13}
TIME, FREQUENCY = 17, 18
#: Longest name of a field in MATLAB.
MATLAB_NAME = 63


def samples_frame(run: Run) -> pd.DataFrame:
    """The samples of a run in SI: time in s, and a column a channel, its unit in brackets."""
    columns = {f"{name} [{channel.unit}]": channel.read() for name, channel in run.channels.items()}
    return pd.DataFrame({"time [s]": np.arange(len(run)) / run.sample_rate, **columns})


def frf_frame(found: Sequence[Transfer]) -> pd.DataFrame:
    """Transfer functions, a row a line: what it is of, frequency in Hz, value, deviations, coherence."""
    return pd.concat(
        [
            pd.DataFrame(
                {
                    "response": item.frf.response, "reference": item.frf.reference, "configuration": item.configuration,
                    "gain": item.gain, "frequency_hz": item.frf.frequency, "real": item.frf.value.real,
                    "imag": item.frf.value.imag, "magnitude_std": item.frf.magnitude_std, "phase_std_rad": item.frf.phase_std,
                    "coherence": item.frf.coherence,
                }
            )
            for item in found
        ],
        ignore_index=True,
    )  # fmt: skip


def parameters_frame(path: Path) -> pd.DataFrame:
    """The table of a parameters.json, or the baseline's parameters of a findings.json.

    Raises
    ------
    PlanError
        Where the file is neither.
    """
    try:
        content = msgspec.json.decode(path.read_bytes())
    except OSError as error:
        raise PlanError(f"{path} cannot be read ({error.strerror}); give a parameters.json or a findings.json") from None
    except msgspec.DecodeError as error:
        raise PlanError(f"{path} is not JSON ({error}); give a parameters.json or a findings.json") from None
    kind = content.get("format") if isinstance(content, dict) else None
    try:
        table = content["parameters"] if kind == "rig-parameters" else content["baseline"]["parameters"]
        rows = [{"name": name, **row} for name, row in table.items()]
    except (KeyError, TypeError, AttributeError):
        rows = []
    if not rows:
        raise PlanError(f"{path} holds no parameter table (its format is {kind!r}); give a parameters.json or a findings.json")
    return pd.DataFrame(rows)


def write_frame(frame: pd.DataFrame, path: Path) -> None:
    """Write a frame as .csv or .parquet, whole or not at all."""
    with replaced(path) as temporary:
        if path.suffix.lower() == ".parquet":
            frame.to_parquet(temporary, index=False)
        else:
            frame.to_csv(temporary, index=False, lineterminator="\n")


def write_matlab(content: Mapping[str, Any], path: Path) -> None:
    """Write a tree of arrays, numbers and words as a version 5 .mat file, compressed, whole or not at all."""
    from scipy.io import savemat

    with replaced(path) as temporary:
        savemat(str(temporary), dict(content), appendmat=False, do_compression=True, long_field_names=True, oned_as="column")


def samples_tree(campaign: Campaign) -> dict[str, Any]:
    """The campaign as a tree: runs.<id> with sample_rate, gain, configuration and the channels in SI; rig; units."""
    taken: set[str] = set()
    runs = {
        _name(run.id, taken): {
            "id": run.id, "configuration": run.configuration, "gain": run.gain, "sample_rate": run.sample_rate,
            "excitation": run.excitation, **{name: channel.read() for name, channel in run.channels.items()},
        }
        for run in campaign.runs
    }  # fmt: skip
    units = {name: channel.unit for run in campaign.runs for name, channel in run.channels.items()}
    return {"runs": runs, "units": units, "rig": dict(campaign.known) or {"note": "nothing known beforehand"}}


def frf_tree(found: Sequence[Transfer]) -> dict[str, Any]:
    """Transfer functions as a tree: frf.<response>_<configuration>_<gain> with frequency, complex H, deviation, coherence."""
    taken: set[str] = set()
    return {
        "frf": {
            _name(f"{item.frf.response}_{item.configuration}_gain{item.gain:g}", taken): {
                "response": item.frf.response, "reference": item.frf.reference, "configuration": item.configuration,
                "gain": item.gain, "frequency": item.frf.frequency, "H": item.frf.value,
                "magnitude_std": item.frf.magnitude_std, "coherence": item.frf.coherence,
            }
            for item in found
        }
    }  # fmt: skip


def frame_tree(frame: pd.DataFrame) -> dict[str, Any]:
    """A parameter table as a tree: parameters.<name> with value, std, unit."""
    taken: set[str] = set()
    rows = frame.replace({None: np.nan}).to_dict("records")
    return {"parameters": {_name(str(row["name"]), taken): {str(k): v for k, v in row.items()} for row in rows}}


def _name(text: str, taken: set[str]) -> str:
    # A field of MATLAB begins with a letter, has letters, digits and underscores, and at most 63 of them.
    plain = re.sub(r"\W", "_", text, flags=re.ASCII)
    name = (plain if plain[:1].isalpha() else f"x{plain}")[: MATLAB_NAME - 3]
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def samples_sets(campaign: Campaign, *, binary: bool) -> list[dict[str, Any]]:
    """Time records as datasets 58: the channel is the response entity, the run stands in the first line."""
    return [
        _dataset(
            1, channel.name, "NONE", np.arange(len(run)) / run.sample_rate, channel.read(), (TIME, "s"), channel.unit, binary,
            f"{run.id}, {run.configuration}, gain {run.gain:g}",
        )
        for run in campaign.runs
        for channel in run.channels.values()
    ]  # fmt: skip


def frf_sets(found: Sequence[Transfer]) -> list[dict[str, Any]]:
    """Transfer functions (function type 4) and their coherences (type 6) as datasets 58.

    In text: the package counts half the bytes of complex values in the head of a binary dataset.
    """
    sets = []
    for item in found:
        frf, told = item.frf, f"{item.label}, {item.frf.estimator}, {item.frf.averages:.1f} averages"
        for kind, values in ((4, frf.value), (6, frf.coherence)):
            sets.append(_dataset(kind, frf.response, frf.reference, frf.frequency, values, (FREQUENCY, "Hz"), "1", False, told))
    return sets


def _dataset(
    kind: int, response: str, reference: str, x: FloatArray, values: Any, axis: tuple[int, str], unit: str, binary: bool,
    told: str,
) -> dict[str, Any]:  # fmt: skip
    import pyuff

    return dict(
        pyuff.prepare_58(
            binary=int(binary), id1=told[:80], func_type=kind, rsp_ent_name=response[:10], rsp_node=1, rsp_dir=0,
            ref_ent_name=reference[:10], ref_node=1, ref_dir=0, abscissa_spacing=1, data=values, x=x,
            abscissa_spec_data_type=axis[0], abscissa_axis_units_lab=axis[1], ordinate_spec_data_type=ORDINATES.get(unit, 0),
            ordinate_axis_units_lab=unit, abscissa_min=float(x[0]), abscissa_inc=float(x[1] - x[0]) if len(x) > 1 else 1.0,
            num_pts=len(x), ord_data_type=6 if np.iscomplexobj(values) else 4, orddenom_spec_data_type=0, z_axis_value=0.0,
        )
    )  # fmt: skip


def write_uff(sets: Sequence[dict[str, Any]], path: Path) -> None:
    """Write datasets, whole or not at all."""
    import pyuff

    with replaced(path) as temporary, contextlib.redirect_stdout(io.StringIO()):
        # The package chooses by the name's ending and appends to what is there.
        beside = temporary.with_name(temporary.name + ".uff")
        try:
            file = pyuff.UFF(str(beside))
            # Not "overwrite", which loses the head of a first binary dataset.
            file.write_sets(list(sets), "add")
            beside.replace(temporary)
        finally:
            beside.unlink(missing_ok=True)
