"""Exports samples, transfer functions and parameter tables for other programs, in the format of the output's extension."""

import contextlib
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import pandas as pd

from isorig.analysis.campaign import Campaign, FloatArray, Run
from isorig.rig.errors import PlanError
from isorig.rig.exchange.formats.uff import FREQUENCY, REFERENCE, RESPONSE, TIME, TIME_RESPONSE
from isorig.rig.exchange.table import STREAMED
from isorig.rig.files.findings import Findings
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import cell, replaced
from isorig.rig.files.recording import GAIN, open_recording
from isorig.rig.files.rigfile import references_of
from isorig.rig.frf.transfer import Transfer, transfer_functions

ENDINGS = (".mat", ".uff", ".csv", ".parquet")
#: Dataset 58: ordinate data types by SI unit (SDRC universal file; 8 displacement, 11 velocity, 12 acceleration, 13 force).
ORDINATES = {"m": 8, "m/s": 11, "m/s^2": 12, "N": 13}
#: Function type of a coherence; maximum length of a line, and of an entity's name.
COHERENCE, LINE, UFF_NAME = 6, 80, 10
#: Directions of dataset 58 as written in mappings and recordings.
DIRECTIONS = {f"{sign}{axis}": (-k if sign == "-" else k) for k, axis in enumerate("xyz", 1) for sign in ("", "+", "-")}
#: Maximum length of a field name in MATLAB.
MATLAB_NAME = 63


def export_campaign(
    source: Path, output: Path, *, what: Literal["samples", "frf"], runs: Sequence[str], reference: str | None, resolution: float,
    binary: bool,
) -> list[Path]:  # fmt: skip
    """Export a recording; returns the paths written. Raises PlanError if the output's extension or a run's name is unknown."""
    ending = _ending(output, ENDINGS)
    with open_recording(source) as whole:
        campaign = _chosen(whole, runs)
        if what == "frf":
            found = transfer_functions(campaign, reference=reference or references_of(campaign), resolution=resolution)
        if ending == ".mat":
            write_matlab(samples_tree(campaign) if what == "samples" else frf_tree(found), output)
        elif ending == ".uff":
            write_uff(samples_sets(campaign, binary=binary) if what == "samples" else frf_sets(found, campaign), output)
        elif what == "frf":
            write_frame(frf_frame(found), output)
        else:
            several = len(campaign.runs) > 1
            paths = [output.with_name(f"{output.stem}-{run.id}{output.suffix}") if several else output for run in campaign.runs]
            for run, path in zip(campaign.runs, paths, strict=True):
                write_frame(samples_frame(run), path)
            return paths
    return [output]


def export_parameters(source: Path, output: Path) -> list[Path]:
    """Export the parameter table of a parameters.json or findings.json; returns the paths written."""
    ending = _ending(output, (".mat", ".csv", ".parquet"))
    frame = parameters_frame(source)
    if ending == ".mat":
        rows = frame.replace({None: np.nan}).to_dict("records")
        write_matlab({"parameters": _fields((row["name"], _fields(row.items())) for row in rows)}, output)
    else:
        write_frame(frame, output)
    return [output]


def _ending(output: Path, allowed: Sequence[str]) -> str:
    ending = output.suffix.lower()
    if ending not in allowed:
        raise PlanError(f"{output} ends in {ending or 'nothing'}; allowed are {', '.join(allowed)}")
    return ending


def _chosen(campaign: Campaign, runs: Sequence[str]) -> Campaign:
    known = [run.id for run in campaign.runs]
    unknown = next((name for name in runs if name not in known), None)
    if unknown is not None:
        raise PlanError(f"{campaign.source} has no run {unknown!r}; it has {', '.join(known)}")
    return replace(campaign, runs=tuple(run for run in campaign.runs if not runs or run.id in runs))


def samples_frame(run: Run) -> pd.DataFrame:
    """The samples of a run in SI: time in s, and a column for each channel, its unit in brackets."""
    columns = {f"{name} [{channel.unit}]": channel.read() for name, channel in run.channels.items()}
    return pd.DataFrame({"time [s]": np.arange(len(run)) / run.sample_rate, **columns})


def frf_frame(found: Sequence[Transfer]) -> pd.DataFrame:
    """Transfer functions, a row for each frequency: identification, frequency in Hz, value, standard deviations, coherence."""
    tables = [
        {
            **_identified(item), "frequency_hz": item.frequency, "real": item.value.real, "imag": item.value.imag,
            "magnitude_std": item.magnitude_std, "phase_std_rad": item.phase_std, "coherence": item.coherence,
        }
        for item in found
    ]  # fmt: skip
    return pd.concat(map(pd.DataFrame, tables), ignore_index=True)


def _identified(item: Transfer) -> dict[str, Any]:
    return {key: getattr(item, key) for key in ("response", "reference", "configuration", "gain")}


class ParameterRows(msgspec.Struct, frozen=True, kw_only=True, tag_field="format", tag="rig-parameters"):
    """The rows of a parameters.json by name, with all their columns."""

    parameters: dict[str, dict[str, str | int | float | None]]


def parameters_frame(path: Path) -> pd.DataFrame:
    """The table of a parameters.json, or the baseline's parameters of a findings.json. Raises PlanError if the file is
    neither."""
    try:
        found = msgspec.json.decode(content_of(path), type=Findings | ParameterRows)
    except OSError as error:
        raise PlanError(f"{path} cannot be read ({error.strerror}); give a parameters.json or a findings.json") from None
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise PlanError(f"{path} contains no parameter table ({error}); give a parameters.json or a findings.json") from None
    rows: list[dict[str, Any]] = (
        [{"name": name, **msgspec.structs.asdict(row)} for name, row in found.baseline.parameters.items()]
        if isinstance(found, Findings)
        else [{"name": name, **row} for name, row in found.parameters.items()]
    )
    if not rows:
        raise PlanError(f"{path} contains no parameter table (it is empty); give a parameters.json or a findings.json")
    return pd.DataFrame(rows)


def write_frame(frame: pd.DataFrame, path: Path) -> None:
    """Write a frame as .csv or .parquet, atomically."""
    with replaced(path) as temporary:
        if path.suffix.lower() == ".parquet":
            frame.to_parquet(temporary, index=False)
        else:
            texts = {str(name): column.map(cell) for name, column in frame.select_dtypes(exclude="number").items()}
            frame.assign(**texts).rename(columns=cell).to_csv(temporary, index=False, lineterminator="\n")


def write_matlab(content: Mapping[str, Any], path: Path) -> None:
    """Write a tree of arrays, numbers and text as a version 5 .mat file, compressed, atomically."""
    from scipy.io import savemat

    with replaced(path) as temporary:
        savemat(str(temporary), dict(content), appendmat=False, do_compression=True, long_field_names=True, oned_as="column")


def samples_tree(campaign: Campaign) -> dict[str, Any]:
    """The campaign as a tree: runs.<id> with sample_rate, gain, configuration and the channels in SI; rig; units."""
    runs = _fields(
        (run.id, {
            "id": run.id, "configuration": run.configuration, "gain": run.gain, "sample_rate": run.sample_rate,
            "excitation": run.excitation,
            **_fields((STREAMED if name == GAIN else name, channel.read()) for name, channel in run.channels.items()),
        })
        for run in campaign.runs
    )  # fmt: skip
    units = {name: channel.unit for run in campaign.runs for name, channel in run.channels.items()}
    return {"runs": runs, "units": _fields(units.items()), "rig": dict(campaign.known) or {"note": "no known values"}}


def frf_tree(found: Sequence[Transfer]) -> dict[str, Any]:
    """Transfer functions as a tree: frf.<response>_<configuration>_<gain> with frequency, complex H, std, coherence."""
    trees = _fields(
        (f"{item.response}_{'' if item.alone else f'{item.configuration}_'}gain{item.gain:g}", {
            **_identified(item), "frequency": item.frequency, "H": item.value,
            "magnitude_std": item.magnitude_std, "coherence": item.coherence,
        })
        for item in found
    )  # fmt: skip
    return {"frf": trees}


def _fields(items: Iterable[tuple[Any, Any]]) -> dict[str, Any]:
    # A field name in MATLAB starts with a letter, has letters, digits and underscores, and at most 63 of them.
    found: dict[str, Any] = {}
    for key, value in items:
        plain = re.sub(r"\W", "_", str(key), flags=re.ASCII)
        name = (plain if plain[:1].isalpha() else f"x{plain}")[: MATLAB_NAME - 3]
        while name in found:
            name += "_"
        found[name] = value
    return found


def samples_sets(campaign: Campaign, *, binary: bool) -> list[dict[str, Any]]:
    """Time records as datasets 58; a channel has one node in all runs, the first line has the run."""
    short = next((run.id for run in campaign.runs if len(run) < 2), None)
    if short is not None:
        raise PlanError(f"run {short!r} has one sample but a universal file needs two; choose others with --run, or export .mat")
    points = _points(campaign)
    return [
        _dataset(
            points, TIME_RESPONSE, channel.name, "", np.arange(len(run)) / run.sample_rate, channel.read(),
            f"{run.id}, {run.set_up}", binary=binary,
        )
        for run in campaign.runs
        for channel in run.channels.values()
    ]  # fmt: skip


def frf_sets(found: Sequence[Transfer], campaign: Campaign) -> list[dict[str, Any]]:
    """Transfer functions (function type 4) and their coherences (type 6) as datasets 58.

    In text: the package writes half the size of complex values to the header of a binary dataset.
    """
    points = _points(campaign)
    return [
        _dataset(
            points, kind, item.response, item.reference, item.frequency, values,
            f"{item.label}, {item.estimator}, {item.averages:.1f} averages",
        )
        for item in found
        for kind, values in ((4, item.value), (COHERENCE, item.coherence))
    ]  # fmt: skip


#: A channel in a universal file: its unit, and its name of at most ten characters, its node and its direction.
_Point = tuple[str, dict[str, Any]]


def _points(campaign: Campaign) -> dict[str, _Point]:
    # By name; the reference of a time record has none.
    points: dict[str, _Point] = {"": ("", {"ent_name": "NONE", "node": 0, "dir": 0})}
    channels = {name: channel for run in campaign.runs for name, channel in run.channels.items()}
    for node, (name, channel) in enumerate(channels.items(), 1):
        short = name[:UFF_NAME]
        if any(short == other["ent_name"] for _, other in points.values()):
            short = name[: UFF_NAME - len(f"~{node}")] + f"~{node}"
        direction = DIRECTIONS.get(channel.about.get("direction", "").strip().lower(), 0)
        points[name] = channel.unit, {"ent_name": short, "node": node, "dir": direction}
    return points


def _dataset(
    points: Mapping[str, _Point], kind: int, response: str, reference: str, x: FloatArray, values: Any, description: str, *,
    binary: bool = False,
) -> dict[str, Any]:  # fmt: skip
    # A dataset 58; `reference` is empty for a time record, and a coherence has no unit.
    import pyuff

    (above, sensor), (below, source) = points[response], points[reference]
    if kind == COHERENCE:
        above, below = "1", ""
    axis, unit = (TIME, "s") if kind == TIME_RESPONSE else (FREQUENCY, "Hz")
    return dict(
        pyuff.prepare_58(
            binary=int(binary), id1=description[:LINE], id4=(RESPONSE + response)[:LINE],
            id5=(REFERENCE + reference)[:LINE] if reference else "NONE", func_type=kind,
            **{f"rsp_{key}": value for key, value in sensor.items()}, **{f"ref_{key}": value for key, value in source.items()},
            abscissa_spacing=1, data=values, x=x, abscissa_spec_data_type=axis, abscissa_axis_units_lab=unit,
            ordinate_spec_data_type=ORDINATES.get(above, 0), ordinate_axis_units_lab=above,
            orddenom_spec_data_type=ORDINATES.get(below, 0), orddenom_axis_units_lab=below or "NONE",
            abscissa_min=float(x[0]), abscissa_inc=float(x[1] - x[0]) if len(x) > 1 else 1.0, num_pts=len(x),
            ord_data_type=6 if np.iscomplexobj(values) else 4, z_axis_value=0.0,
        )
    )  # fmt: skip


def write_uff(sets: Sequence[dict[str, Any]], path: Path) -> None:
    """Write datasets atomically, after the units (164): SI."""
    import pyuff

    units = pyuff.prepare_164(units_code=1, units_description="SI", temp_mode=1, length=1.0, force=1.0, temp=1.0, temp_offset=0.0)
    with replaced(path) as temporary, contextlib.redirect_stdout(io.StringIO()):
        # The package uses the name's extension, and appends to existing files.
        universal = temporary.with_name(temporary.name + ".uff")
        try:
            file = pyuff.UFF(str(universal))
            # Not "overwrite", which loses the header of a first binary dataset.
            file.write_sets([units, *sets], "add")
            universal.replace(temporary)
        finally:
            universal.unlink(missing_ok=True)
