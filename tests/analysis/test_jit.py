"""Cached kernels: valid as long as their code, the kernels that they contain and their constants are unchanged, in any file."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from isorig import analysis
from isorig.analysis import jit
from isorig.analysis.jit import Kernel, inlined, kernel, load, separate_kernel

ROOT = Path(__file__).parents[2]
CALLEE = '''"""Two kernels, a constant and a named tuple."""

from typing import NamedTuple

from isorig.analysis.jit import kernel, separate_kernel

SCALE = 2.0


class Pair(NamedTuple):
    first: float
    second: float


@kernel
def contained(x):
    return SCALE * x


@separate_kernel("float64(float64)")
def separate(x):
    return 10.0 * x
'''
CALLER = '''"""A kernel that calls another file's."""

from isorig.analysis.callee import Pair, contained, separate
from isorig.analysis.jit import kernel

# A comment.
@kernel
def total(pair):
    """Sum."""
    return contained(pair.first) + separate(pair.first)
'''
#: For each line that it reads, a process that imports both anew; the compiler is imported once. Edits follow within the second
#: that compiled modules have as their date.
CALLS = """
import os, sys
import isorig.analysis.compiler

sys.dont_write_bytecode = True
for _ in sys.stdin:
    if os.fork() == 0:
        from isorig.analysis.callee import Pair, separate
        from isorig.analysis.caller import total
        from isorig.analysis.jit import load

        load(separate)
        value = total(Pair(first=1.0, second=100.0))
        print(value, *(sum(each.stats.cache_hits.values()) for each in (total, separate)), flush=True)
        os._exit(0)
    os.wait()
"""
#: Digests of all kernels, by name; laws' closures have several.
DIGESTS = """
import gc, json
import isorig.rig.virtual.compile_kernels
from isorig.analysis.jit import Kernel

found = {}
for each in gc.get_objects():
    if isinstance(each, Kernel):
        found.setdefault(f"{each._function.__module__}.{each._function.__qualname__}", []).append(each.digest)
print(json.dumps({name: sorted(digests) for name, digests in found.items()}))
"""


def copied(to: Path) -> Path:
    """A copy of the package without compiled kernels; its folder."""
    shutil.copytree(Path(analysis.__file__).parents[1], to / "isorig", ignore=shutil.ignore_patterns("__pycache__"))
    return to / "isorig" / "analysis"


def said(folder: Path, code: str) -> str:
    """What a program prints that uses the package in a folder."""
    return subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True).stdout


def edited(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1
    file.write_text(text.replace(old, new), encoding="utf-8")


@pytest.fixture
def calls(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """The copied package, called from its folder."""
    copied(tmp_path)
    call = [sys.executable, "-c", CALLS]
    with subprocess.Popen(call, cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="needs processes that continue as copies, which Windows has not")
def test_a_kernel_is_compiled_again_only_if_it_or_what_it_contains_changes(
    tmp_path: Path, calls: subprocess.Popen[str]
) -> None:  # fmt: skip
    assert calls.stdin is not None
    assert calls.stdout is not None
    ask, told = calls.stdin, calls.stdout
    folder = tmp_path / "isorig" / "analysis"
    callee, caller = folder / "callee.py", folder / "caller.py"
    callee.write_text(CALLEE, encoding="utf-8")
    caller.write_text(CALLER, encoding="utf-8")

    def answer() -> tuple[float, bool, bool]:
        # The result; whether the caller and the separate kernel come from the cache.
        print(file=ask, flush=True)
        value, hits, separate_hits = told.readline().split()
        return float(value), hits == "1", separate_hits == "1"

    assert answer() == (12.0, False, False)
    assert answer() == (12.0, True, True)
    # Words, and the place in the file.
    edited(caller, '    """Sum."""\n', '    """Sum of both.\n\n    With more lines."""\n')
    edited(caller, "# A comment.\n", "\n\nUNUSED = 5\n\n\n")
    edited(callee, "def contained(x):\n", 'def contained(x):\n    """The first docstring."""\n')
    assert answer() == (12.0, True, True)
    # The code of a contained kernel, and a constant of another file.
    edited(callee, "return SCALE * x", "return SCALE * x + 1.0")
    assert answer() == (13.0, False, True)
    edited(callee, "SCALE = 2.0", "SCALE = 3.0")
    assert answer() == (14.0, False, True)
    # The code of a separate kernel takes effect, but the caller does not contain it.
    edited(callee, "10.0 * x", "20.0 * x")
    assert answer() == (24.0, True, False)
    # The order of an argument's fields: the types are the same.
    edited(callee, "    first: float\n    second: float\n", "    second: float\n    first: float\n")
    assert answer()[:2] == (24.0, False)


def test_a_new_law_leaves_the_engine_and_the_other_laws_valid(tmp_path: Path) -> None:
    folder = copied(tmp_path)
    page = (ROOT / "docs" / "add-law.md").read_text(encoding="utf-8")
    law = re.search(r'^```python title="isorig/analysis/laws/(\w+\.py)"\n(.*?)^```$', page, re.MULTILINE | re.DOTALL)
    assert law is not None
    before = json.loads(said(tmp_path, DIGESTS))
    (folder / "laws" / law[1]).write_text(law[2], encoding="utf-8")
    after = json.loads(said(tmp_path, DIGESTS))
    assert set(after) - set(before) == {"isorig.analysis.laws.quintic.resist"}
    changed = {name.removeprefix("isorig.analysis.") for name, digests in before.items() if after[name] != digests}
    closures = {"simulate.curves._chosen.<locals>.either", "simulate.curves._at_two_points.<locals>.at_two_points"}
    assert changed == {"simulate.curves.plain", *closures}


def test_an_object_of_unknown_content_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "unknown", {"content": 1})

    @kernel
    def takes_the_size() -> int:
        return len(unknown)  # type: ignore[name-defined] # noqa: F821

    @kernel
    def takes_from_a_module() -> str:
        return jit.PACKAGE

    for each in (takes_the_size, takes_from_a_module):
        assert isinstance(each, Kernel)
        with pytest.raises(TypeError, match="content is unknown"):
            each.digest  # noqa: B018


def test_a_separate_kernel_is_compiled_when_it_is_loaded() -> None:
    @separate_kernel("float64(float64)")
    def doubled(x: float) -> float:
        return 2.0 * x

    @kernel
    def increased(x: float) -> float:
        return doubled(x) + 1.0 if x > 0.0 else x

    assert increased(-1.0) == -1.0
    assert not cast("Kernel", doubled).compiled.overloads
    with pytest.raises(SystemError):
        increased(1.0)
    load(doubled)
    assert increased(1.0) == 3.0


def test_digests_differ_by_the_type_of_a_constant() -> None:
    def scaled(by: object) -> str:
        @inlined
        def times(x: float) -> float:
            return by * x  # type: ignore[no-any-return, operator]

        assert isinstance(times, Kernel)
        return times.digest

    constants = (
        2,
        2.0,
        True,
        np.float32(2.0),
        np.float64(2.0),
        np.array([2.0]),
        np.array([[2.0]]),
        np.array([2]),
        (2.0,),
        None,
        "2.0",
    )
    assert len({scaled(each) for each in constants}) == len(constants)
    assert scaled(np.array([2.0])) == scaled(np.array([2.0]))


def test_a_separate_kernel_has_one_place_whichever_thread_asks_first(monkeypatch: pytest.MonkeyPatch) -> None:
    places: list[object] = []

    def called_by_name(symbol: str, signature: str) -> tuple[object, object]:
        time.sleep(0.05)
        places.append(object())
        return symbol, places[-1]

    monkeypatch.setattr(jit, "_compiler", lambda: SimpleNamespace(called_by_name=called_by_name))
    law = jit.SeparateKernel(abs, signature="float64(float64)", cached=True)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda _: law.type, range(2)))
    assert len(places) == 1
