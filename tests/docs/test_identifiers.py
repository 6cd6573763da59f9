"""Names in the code: a public class of one name is one thing."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2] / "isorig"
#: Rooms whose class names nothing else in the package has. A cause may have the name of its law: it is that law at a place.
ROOMS = (
    "analysis/diagnose/causes", "analysis/proposals", "analysis/trends", "drivers", "rig/acquire", "rig/commands", "rig/describe",
    "rig/design", "rig/diagnose", "rig/exchange", "rig/files", "rig/fleet", "rig/frf", "rig/isolation", "rig/next",
    "rig/notebook", "rig/report", "rig/view", "rig/virtual", "rig/wire_bonder",
)  # fmt: skip


def public_classes() -> dict[str, list[str]]:
    """The files of each public class's name, relative to the package."""
    found = defaultdict(list)
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(path.relative_to(ROOT).as_posix())
    return found


def repeated(classes: dict[str, list[str]]) -> dict[str, list[str]]:
    """Names of several classes of which one is in a listed room."""
    alike = {name: [file for file in files if not file.startswith("analysis/laws/")] for name, files in classes.items()}
    return {name: files for name, files in alike.items() if len(files) > 1 and any(file.startswith(ROOMS) for file in files)}


def test_a_class_name_means_one_thing() -> None:
    classes = public_classes()
    assert len(classes) > 400
    assert repeated(classes) == {}


def test_a_repeated_name_is_found() -> None:
    assert repeated({"Change": ["analysis/trends/change.py", "analysis/simulate/simulation.py"]})
    assert not repeated({"Backlash": ["analysis/laws/backlash.py", "analysis/diagnose/causes/backlash.py"]})
