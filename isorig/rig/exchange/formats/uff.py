"""Universal file format: type 58 and its binary form 58b (SDRC universal file, dataset 58, function at nodal DOF; 164, units)."""

import contextlib
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray, Spectrum
from isorig.rig.errors import RecordingError
from isorig.rig.exchange.clock import even_rate, seconds_per
from isorig.rig.exchange.table import Column, ForeignTable, Format
from isorig.rig.exchange.units import UNITS, known_unit
from isorig.rig.files.output import reason
from isorig.rig.files.recording import VALUE_MOST

#: Function types of dataset 58 over frequency, and their names in the recording format.
KINDS = {
    2: "auto_spectrum", 3: "cross_spectrum", 4: "transfer_function", 5: "transfer_function", 6: "coherence",
    9: "power_spectral_density", 12: "spectrum",
}  # fmt: skip
GENERAL, TIME_RESPONSE = 0, 1
#: Specific data types of dataset 58: SI unit, and the exponents of length and force for conversion from its unit system.
TYPES = {8: ("m", 1, 0), 9: ("N", 0, 1), 11: ("m/s", 1, 0), 12: ("m/s^2", 1, 0), 13: ("N", 0, 1)}
#: Data types of the abscissa: time and frequency.
TIME, FREQUENCY = 17, 18
#: Directions of dataset 58.
AXES = {0: ""} | {
    int(f"{sign}{k}"): f"{sign}{axis}" for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz"), 1) for sign in "+-"
}
#: Lines of text at the start of a dataset.
ID_LINES = ("id1", "id2", "id3", "id4", "id5")
#: Number of characters of an entity name in data set 58.
ENTITY_LONGEST = 10
#: Text before a channel's full name in the fourth and fifth line of a dataset written by this program.
RESPONSE, REFERENCE = "response ", "reference "
#: Hz per unit of frequency, in lower case.
FREQUENCY_UNITS = {"hz": 1.0, "khz": 1e3, "rad/s": 0.5 / np.pi, "rpm": 1.0 / 60.0}
#: The line that begins and ends every dataset; after binary values it may have no line break before it.
MARK = re.compile(rb" {4}-1(?=[\r\n]| {74}|\Z)")
#: Lines of dataset 58 up to its values, and the one that states their number.
HEADER, FORM = 13, 8
#: A unit system as given by dataset 164: file units per m and per N.
System = tuple[float, float]
SI: System = (1.0, 1.0)


class _LeftOutError(Exception):
    """Why a function is neither a time record nor a spectrum."""


def read_uff(path: Path) -> ForeignTable:
    """Time records as columns, functions of frequency as spectra; others are left out with a remark. Raises RecordingError, with
    the reason, if the file is damaged or nothing in it can be used."""
    columns: dict[str, Column] = {}
    spectra: list[Spectrum] = []
    remarks: list[str] = []
    system, stated = SI, False
    sets = _sets(path)
    functions = [item for item in sets if item["type"] == 58]
    responses = _by_quantity(functions, _names(functions, "rsp"))
    named = zip(responses, _names(functions, "ref"), _labels(functions, responses), strict=True)
    for place, item in enumerate(sets, 1):
        if item["type"] == 164:
            length, force = float(item.get("length") or 1.0), float(item.get("force") or 1.0)
            system, stated = ((length, force) if 0.0 < length < np.inf and 0.0 < force < np.inf else SI), True
            continue
        response, reference, label = next(named)
        here = f"function {place} ({response})"
        x, values = np.asarray(item["x"], dtype=np.float64), np.asarray(item["data"])
        count = int(item["num_pts"])
        if len(values) < count:
            raise RecordingError(
                f"{path}, {here} has {len(values)} of {count} values: the file was truncated; copy it again from its source"
            )
        x, values = x[:count], values[:count]
        try:
            found = _function(item, (response, reference), x, values, system)
        except _LeftOutError as why:
            remarks.append(f"{here} {why}; it is left out")
            continue
        if isinstance(found, Column):
            key, number = response, 2
            while key in columns:
                key, number = f"{response}#{number}", number + 1
            columns[key] = replace(found, label=label)
            si, long, strong = TYPES.get(int(item.get("ordinate_spec_data_type", 0)), ("", 0, 0))
            known = known_unit(found.unit)
            size = system[0] ** long * system[1] ** strong / found.sensitivity
            if stated and si and known is not None and not np.isclose(UNITS[known].factor * size, 1.0, rtol=1e-2):
                remarks.append(
                    f"{here} has the label {found.unit!r}, but the file's unit system (dataset 164) has {size:g} of its units in "
                    f"one {si}: if its values are in the unit system, write sensitivity = {size * UNITS[known].factor:.6g}"
                )
        else:
            spectra.append(replace(found, name=f"{len(spectra):03d}"))
    if not columns and not spectra and remarks:
        raise RecordingError(f"{path} contains nothing usable: {remarks[0]}")
    return ForeignTable(path=path, columns=columns, spectra=tuple(spectra), remarks=tuple(remarks))


def _sets(path: Path) -> list[dict[str, Any]]:
    import pyuff

    _refuse_truncated(path)
    # The package prints its progress.
    with contextlib.redirect_stdout(io.StringIO()):
        file = pyuff.UFF(str(path))
        places = [k for k, kind in enumerate(file.get_set_types()) if int(kind) in (58, 164)]
        found = []
        for k in places:
            try:
                found.append(file.read_sets(k))
            except Exception as error:
                # The package raises bare exceptions.
                raise RecordingError(
                    f"{path}, dataset {k + 1} cannot be read ({reason(error)}): its header or its values are incomplete or not "
                    f"of the stated form; {UFF.advice}"
                ) from None
        return found


def _refuse_truncated(path: Path) -> None:
    # Raise RecordingError if the last dataset has no end: the package ignores it.
    data = path.read_bytes()
    marks = [mark.start() for mark in MARK.finditer(data)]
    lines = data[marks[-1] :].splitlines() if len(marks) % 2 else []
    if not any(line.strip() for line in lines[1:]):
        return
    has = "has no line -1 at its end"
    if lines[1].strip() == b"58":  # the values of 58b are no lines
        stated = lines[FORM][10:20].decode(errors="replace").strip() if len(lines) >= HEADER else ""
        has = f"ends after {len(lines) - HEADER} lines of its {stated} values" if stated else "ends in its header"
    raise RecordingError(f"{path}, dataset {len(marks) // 2 + 1} {has}: the file was truncated; copy it again from its source")


def _function(item: Mapping[str, Any], names: tuple[str, str], x: FloatArray, values: Any, system: System) -> Column | Spectrum:
    kind, axis_unit, over = int(item.get("func_type", 0)), _label(item, "abscissa_axis_units_lab"), _over(item)
    if over == FREQUENCY and kind in (GENERAL, *KINDS):
        return _spectrum(item, names, x * FREQUENCY_UNITS.get(axis_unit.lower(), 1.0), values, system)
    if over != TIME or kind not in (GENERAL, TIME_RESPONSE) or np.iscomplexobj(values) or len(x) < 2:
        text = f"function type {kind} with {len(x)} {'complex' if np.iscomplexobj(values) else 'real'} values"
        along = {TIME: "time", FREQUENCY: "frequency"}.get(over, f"an abscissa of type {over} in {axis_unit or 'no unit'}")
        raise _LeftOutError(f"is of {text} over {along}, neither a time record nor a function of frequency")
    unit, sensitivity = _unit(item, "ordinate", system)
    rate = _rate(item, x, seconds_per(axis_unit or "s") or 1.0)
    return Column(values=values, sample_rate=rate, unit=unit, sensitivity=sensitivity)


def _over(item: Mapping[str, Any]) -> int:
    # Type of the abscissa: its data type if given, otherwise by its unit, otherwise as required by the function type.
    kind, axis = int(item.get("func_type", 0)), int(item.get("abscissa_spec_data_type", 0))
    unit = _label(item, "abscissa_axis_units_lab")
    if axis not in (0, 1):
        return axis
    if unit:
        return TIME if seconds_per(unit) is not None else FREQUENCY if unit.lower() in FREQUENCY_UNITS else axis
    return TIME if kind == TIME_RESPONSE else FREQUENCY if kind in KINDS else axis


def _rate(item: Mapping[str, Any], x: FloatArray, factor: float) -> float:
    if int(item.get("abscissa_spacing", 1)) == 0:
        try:
            return even_rate(x, "its abscissa", factor)
        except RecordingError as error:
            raise _LeftOutError(f"has an uneven abscissa ({error})") from None
    step = (float(item.get("abscissa_inc") or 0.0) or float(x[-1] - x[0]) / (len(x) - 1)) * factor
    if not 1.0 / VALUE_MOST < step < VALUE_MOST:
        raise _LeftOutError(f"has the sample interval {step:g} s")
    # The increment has six digits: an integer rate within its rounding is used.
    whole = round(1.0 / step)
    return float(whole) if abs(1.0 / step - whole) <= 5e-6 * whole else 1.0 / step


def _names(functions: Sequence[Mapping[str, Any]], end: str) -> list[str]:
    # A name with several nodes or directions gets them appended.
    dofs = [f"{int(item.get(f'{end}_node', 0))}{AXES.get(int(item.get(f'{end}_dir', 0)), '')}" for item in functions]
    named = [(_name(item, end) or dof, dof) for item, dof in zip(functions, dofs, strict=True)]
    several = Counter(name for name, _ in set(named))
    return [f"{name} {dof}" if several[name] > 1 else name for name, dof in named]


def _by_quantity(functions: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[str]:
    # Where time records of several quantities have one name, as force and acceleration at a driving point, the quantity follows.
    kinds = [int(item.get("ordinate_spec_data_type", 0)) if _over(item) == TIME else 0 for item in functions]
    several = Counter(name for name, kind in {*zip(names, kinds, strict=True)} if kind)
    return [
        f"{name} {UNITS[TYPES[kind][0]].quantity}" if several[name] > 1 and kind in TYPES else name
        for name, kind in zip(names, kinds, strict=True)
    ]


def _labels(functions: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[str]:
    # The first ID line that differs between the channels names them; the same line for all is the title of the measurement, and
    # several lines for one channel are those of runs.
    for line in ID_LINES:
        texts = [_label(item, line) for item in functions]
        one_each = len({*zip(names, texts, strict=True)}) == len({*names})
        if one_each and len(set(texts)) > 1 and all(texts) and not any(text.startswith((RESPONSE, REFERENCE)) for text in texts):
            return texts
    return [""] * len(functions)


def _name(item: Mapping[str, Any], end: str) -> str:
    lines = (str(item.get(line, "")).strip() for line in ("id4", "id5"))
    mark = RESPONSE if end == "rsp" else REFERENCE
    whole = next((line[len(mark) :] for line in lines if line.startswith(mark)), "")
    entity = _label(item, f"{end}_ent_name")
    # The field has room for few characters: an ID line may have the whole name.
    texts = (
        [text for line in ID_LINES if (text := _label(item, line)).startswith(entity)] if len(entity) == ENTITY_LONGEST else []
    )
    return whole or next(iter(texts), entity)


def _label(item: Mapping[str, Any], key: str) -> str:
    text = str(item.get(key, "")).strip()
    return "" if text.upper() == "NONE" else text


def _unit(item: Mapping[str, Any], part: str, system: System) -> tuple[str, float]:
    # Unit and sensitivity: the axis label gives the unit of the values, otherwise the unit system (164) and the data type do.
    label, kind = _label(item, f"{part}_axis_units_lab"), int(item.get(f"{part}_spec_data_type", 0))
    si, length, force = TYPES.get(kind, ("", 0, 0))
    factor = system[0] ** length * system[1] ** force
    known = known_unit(label)
    if known is not None and (factor == 1.0 or known != si):
        return known, 1.0
    # If the label is the SI unit but the unit system is not SI, the values are in the unit system: labels are for display.
    return (si or label), factor


def _spectrum(item: Mapping[str, Any], names: tuple[str, str], frequency: FloatArray, values: Any, system: System) -> Spectrum:
    if len(frequency) < 2 or not (np.isfinite(frequency).all() and (np.diff(frequency) > 0.0).all()):
        raise _LeftOutError("has frequencies that are not ascending")
    kind = KINDS.get(int(item.get("func_type", 0)), "transfer_function" if np.iscomplexobj(values) else "spectrum")
    above, below = _unit(item, "ordinate", system), _unit(item, "orddenom", system)
    scale = below[1] / above[1] if kind == "transfer_function" else 1.0
    numbers = values.astype(np.complex128) if np.iscomplexobj(values) else values.astype(np.float64)
    unit = (
        "1" if above[0] == below[0] or not above[0] else f"{above[0]}/({below[0]})" if below[0] and below[0] != "1" else above[0]
    )
    return Spectrum(
        name="", kind=kind, response=names[0], reference=names[1], frequency=frequency, values=numbers * scale, unit=unit
    )


UFF = Format(
    extensions=(".uff", ".unv"), name="a universal file", read=read_uff, advice="export it again as dataset 58",
    begins=re.compile(rb"    -1 *\r?\n +\d{2,4}b?\s"),
)  # fmt: skip
