"""Docstrings are true: they describe the parameters that there are, with shapes and units, and exceptions that exist."""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import keyword
import re
from collections.abc import Collection, Iterator
from functools import cache
from itertools import takewhile
from pathlib import Path

import griffe
import pytest
from sources import PACKAGE, sources

from isorig import names
from isorig.analysis import errors as analysis_errors
from isorig.drivers import errors as driver_errors
from isorig.rig import errors as rig_errors
from isorig.rig.acquire import locks
from isorig.rig.files import hdf_walk

#: Where a short name of an exception comes from; `hdf_walk`, which runs alone, and `locks` have their own.
EXCEPTIONS = (builtins, analysis_errors, driver_errors, rig_errors, hdf_walk, locks)
SECTION = griffe.DocstringSectionKind
Described = griffe.Function | griffe.Class


def described(item: griffe.Module | griffe.Class | griffe.Function) -> Iterator[Described]:
    """All functions and classes with a docstring within an object, and the object itself."""
    if not isinstance(item, griffe.Module) and item.docstring is not None:
        yield item
    for member in item.members.values():
        if not member.is_alias and isinstance(member, griffe.Module | griffe.Class | griffe.Function):
            yield from described(member)


@cache
def modules() -> griffe.Module:
    """The package and all its modules."""
    found = griffe.load("isorig", docstring_parser="numpy", docstring_options={"warnings": False})
    assert isinstance(found, griffe.Module)
    return found


@cache
def package() -> list[Described]:
    """All functions and classes of the package that have a docstring."""
    return list(described(modules()))


def field_comments(item: Described) -> list[griffe.DocstringParameter]:
    """The fields of a class that a comment (#:) describes, on their line or above it; a class with `__init__` has none."""
    found: list[griffe.DocstringParameter] = []
    if not isinstance(item, griffe.Class) or not isinstance(item.filepath, Path):
        return found
    # That of a dataclass is in no line.
    if "__init__" in item.members and item.members["__init__"].lineno:
        return found
    for name, member in item.members.items():
        if not isinstance(member, griffe.Attribute) or member.lineno is None or member.endlineno is None:
            continue
        lines = item.lines_collection[item.filepath]
        above = takewhile(lambda line: line.strip().startswith("#:"), reversed(lines[: member.lineno - 1]))
        here = lines[member.endlineno - 1].partition("  #: ")[2]
        text = " ".join(line.strip().removeprefix("#:").strip() for line in (*reversed([*above]), here)).strip()
        if text:
            found.append(griffe.DocstringParameter(name, description=text))
    return found


def entries(item: Described, kind: griffe.DocstringSectionKind) -> list[griffe.DocstringElement]:
    """The entries of a docstring's section, with those that comments at fields make; empty without any."""
    assert item.docstring is not None
    own = [entry for section in item.docstring.parsed if section.kind is kind for entry in section.value]
    return [*own, *(field_comments(item) if kind is SECTION.parameters else ())]


def text_of(item: Described) -> str:
    """The docstring, and the comments at fields."""
    assert item.docstring is not None
    return "\n".join([item.docstring.value, *(each.description for each in field_comments(item))])


def parameters_of(item: Described) -> list[str]:
    """The parameters of a function, or of a class."""
    if isinstance(item, griffe.Class) and "__init__" not in item.members:
        return [name for name, member in item.all_members.items() if member.is_attribute]
    function = item.members["__init__"] if isinstance(item, griffe.Class) else item
    assert isinstance(function, griffe.Function)
    own = function.parent is not None and function.parent.is_class and "staticmethod" not in function.labels
    return [parameter.name for parameter in function.parameters][1 if own else 0 :]


def untrue(item: Described) -> list[str]:
    """The entries of a docstring that its code contradicts."""
    told = [name.strip().lstrip("*") for entry in entries(item, SECTION.parameters) for name in entry.name.split(",")]
    names = parameters_of(item)
    found = [f"{item.path}: {name!r} is no parameter" for name in told if name not in names]
    if told and isinstance(item, griffe.Function) and not item.name.startswith("_"):
        found += [f"{item.path}: {name} is not described" for name in names if name not in told]
    raised = [name for entry in entries(item, SECTION.raises) for name in re.findall(r"[^\s(),]+", str(entry.annotation))]
    raised += re.findall(r"(?<![\w.])[A-Z]\w*Error\b", text_of(item))
    return found + [f"{item.path}: {name!r} is no exception" for name in raised if not is_exception(name)]


#: Annotations of arrays, and how a docstring gives a shape: in words, as a tuple of sizes, or as in another docstring.
ARRAY = re.compile(r"\b(?:Float|Complex|Int|Bool)Array\b|\bNDArray\b")
SHAPED = re.compile(r"[Ss]hape|\bas in \b|\(\w+, (?:\d ?)?\w*\)", re.IGNORECASE)
#: Units, and words for values that have none or that of something else.
UNIT = re.compile(r"\b(?:k?Hz|s|[mk]?g|m|N|V|[Ss]econds?|unit)\b|m/s|\b(?:[Ss]hare|[Rr]atio|[Rr]elative|[Gg]ain|raw|[Aa]s in)\b")


def annotations_of(item: Described) -> dict[str, str]:
    """The annotations of a function's parameters, or of a class's."""
    if isinstance(item, griffe.Class) and "__init__" not in item.members:
        return {name: str(member.annotation) for name, member in item.all_members.items() if member.is_attribute}
    function = item.members["__init__"] if isinstance(item, griffe.Class) else item
    assert isinstance(function, griffe.Function)
    return {parameter.name: str(parameter.annotation) for parameter in function.parameters}


def described_by_type(item: Described, kind: re.Pattern[str]) -> list[griffe.DocstringElement]:
    """The described parameters of a kind of annotation."""
    annotations = annotations_of(item)
    return [
        entry
        for entry in entries(item, SECTION.parameters)
        if any(
            kind.search(kinds) and "Callable" not in kinds
            for kinds in (annotations.get(name.strip().lstrip("*"), "") for name in entry.name.split(","))
        )
    ]


def incomplete(item: Described, interface: Collection[str]) -> list[str]:
    """Arrays without a shape; quantities of the interface without a unit."""
    if any(part.startswith("_") and part != "__init__" for part in item.path.split(".")):
        return []
    arrays = described_by_type(item, ARRAY)
    found = [f"{item.path}: {arrays[0].name} has no shape"] if arrays and not SHAPED.search(text_of(item)) else []
    if any(item.path == name or item.path.startswith(f"{name}.") for name in interface):
        numbers = described_by_type(item, re.compile(r"\bfloat\b|\bFloatArray\b"))
        found += [f"{item.path}: {entry.name} has no unit" for entry in numbers if not UNIT.search(str(entry.description))]
    return found


#: A name in a docstring, with those of the modules, classes or objects that contain it.
NAMED = re.compile(r"(?<!`)`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)`(?!`)")


@cache
def known() -> frozenset[str]:
    """All names in the code of the package, and of its files and folders."""
    found = {PACKAGE.name, *(part for file in sources() for part in Path(file).with_suffix("").parts)}
    for _, tree in sources().values():
        for node in ast.walk(tree):
            for field in ("name", "arg", "id", "attr"):
                if isinstance(named := getattr(node, field, None), str):
                    found.update(named.split("."))
            # Keys and columns of files.
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
                found.add(node.value)
    return frozenset(found)


def unknown(docstring: str) -> list[str]:
    """Names that a docstring mentions and that the code of the package does not have."""
    return [
        name
        for name in NAMED.findall(docstring)
        if name not in keyword.kwlist and name.removesuffix(".py").rpartition(".")[2] not in known()
    ]


def interface() -> list[str]:
    """The paths of the names of the interface."""
    made = [getattr(names, name) for name in names.__all__]
    return [f"{one.__module__}.{one.__qualname__}" for one in made if not inspect.ismodule(one)]


def is_exception(name: str) -> bool:
    """Whether a name is that of an exception: one of Python, of our own, or of a library with the library's name."""
    module, _, last = name.rpartition(".")
    if not last.isidentifier() or (module and not module.replace(".", "").isidentifier()):
        return False
    places = [importlib.import_module(module)] if module else EXCEPTIONS
    return any(isinstance(kind := getattr(place, last, None), type) and issubclass(kind, BaseException) for place in places)


def test_docstrings_describe_what_there_is() -> None:
    assert sum(bool(entries(item, SECTION.parameters)) for item in package()) > 250
    assert [line for item in package() for line in untrue(item)] == []


def test_docstrings_mention_names_that_exist() -> None:
    texts = [(item.path, text_of(item)) for item in package()]
    texts += [(module.path, module.docstring.value) for module in _modules(modules()) if module.docstring is not None]
    assert sum(bool(NAMED.search(text)) for _, text in texts) > 300
    assert [f"{path}: {name!r} does not exist" for path, text in texts for name in unknown(text)] == []


def _modules(module: griffe.Module) -> Iterator[griffe.Module]:
    yield module
    for member in module.modules.values():
        if not member.is_alias:
            yield from _modules(member)


def test_a_name_that_does_not_exist_is_found() -> None:
    text = (
        "See `RigModel.bodies`, `isorig.rig.files.hdf`, `RigModel.springiness` and `built_into`, ``not_code``; `a + b` is a sum."
    )
    assert unknown(text) == ["RigModel.springiness", "built_into"]


def test_arrays_have_shapes_and_quantities_of_the_interface_units() -> None:
    names_of_interface = interface()
    assert [line for item in package() for line in incomplete(item, names_of_interface)] == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("The records, shape (n,), m.", []),
        ("The records (channels, n), Hz.", []),
        ("The records, m.", ["x has no shape"]),
        ("The records, shape (n,).", ["x has no unit"]),
    ],
)
def test_a_missing_shape_or_unit_is_found(text: str, said: list[str]) -> None:
    code = f'def played(x: FloatArray):\n    """Play.\n\n    Parameters\n    ----------\n    x\n        {text}\n    """\n'
    module = griffe.visit("m", filepath=None, code=code, docstring_parser="numpy")  # type: ignore[arg-type]
    assert incomplete(module["played"], ["m.played"]) == [f"m.played: {line}" for line in said]


def test_comments_at_fields_are_checked(tmp_path: Path) -> None:
    code = (
        "class Played:\n"
        '    """What was played."""\n\n'
        "    #: The records of `nowhere_given`,\n"
        "    #: m.\n"
        "    x: FloatArray\n"
        "    rate: float  #: Hz.\n"
        "    ticks: int\n"
    )
    (tmp_path / "m.py").write_text(code)
    item = griffe.load("m", search_paths=[tmp_path], docstring_parser="numpy")["Played"]
    assert isinstance(item, griffe.Class)
    assert [(each.name, each.description) for each in field_comments(item)] == [
        ("x", "The records of `nowhere_given`, m."),
        ("rate", "Hz."),
    ]
    assert incomplete(item, []) == ["m.Played: x has no shape"]
    assert unknown(text_of(item)) == ["nowhere_given"]


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("Parameters\n----------\nrate, ticks\n    Both.", []),
        ("Parameters\n----------\nrate\n    The rate.", ["ticks is not described"]),
        ("Parameters\n----------\nrate, ticks\n    Both.\nThe rate, Hz.\n    Cut.", ["'The' is no parameter"]),
        ("Raises\n------\nRecordingError\n    A file.\nValueError\n    A value.", []),
        ("Raises\n------\nIn one sentence.\n    A file.", ["'In' is no", "'one' is no", "'sentence.' is no exception"]),
        ("Raises\n------\nmsgspec.ValidationError\n    A value.\nPath\n    None.", ["'Path' is no exception"]),
        ("Raises OSError if the disk is full; DiskFullError if it is not.", ["'DiskFullError' is no exception"]),
    ],
)
def test_an_untrue_docstring_is_found(section: str, said: list[str]) -> None:
    code = f'def played(rate, ticks):\n    """Play.\n\n    {section.replace(chr(10), chr(10) + "    ")}\n    """\n'
    module = griffe.visit("m", filepath=None, code=code, docstring_parser="numpy")  # type: ignore[arg-type]
    found = untrue(module["played"])
    assert len(found) == len(said)
    assert all(part in line for part, line in zip(said, found, strict=True))
