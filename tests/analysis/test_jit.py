"""Cached kernels: what is cached counts only as long as no kernel's source has changed, in this or another file."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from isorig import analysis
from isorig.analysis.jit import sources

CALLER = '''"""A kernel that calls another file's."""

from isorig.analysis.jit import kernel
from isorig.analysis.simulate.step import polynomial


@kernel
def where(p):
    return polynomial(p, 1.0)
'''


def test_editing_one_kernels_file_renews_the_kernels_of_others(tmp_path: Path) -> None:
    copy = tmp_path / "isorig" / "analysis"
    shutil.copytree(Path(analysis.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "isorig" / "__init__.py").touch()
    (copy / "simulate" / "caller.py").write_text(CALLER, encoding="utf-8")

    def answer() -> float:
        code = "import numpy as np; from isorig.analysis.simulate.caller import where; print(where(np.array([1.0, -2.0])))"
        ran = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
        return float(ran.stdout)

    assert answer() == -1.0
    assert list((copy / "simulate" / "__pycache__").glob("caller.where*.nbi"))
    step = copy / "simulate" / "step.py"
    text = step.read_text(encoding="utf-8")
    step.write_text(re.sub(r"acc = acc \* x \+ p\[k\]", "acc = acc * x + 3.0 * p[k]", text, count=1), encoding="utf-8")
    assert answer() == -3.0


def test_numbers_that_kernels_use_stand_in_their_files() -> None:
    """A constant in a file that is none of the sources could change without the kernels knowing."""
    root = Path(analysis.__file__).parent
    known = {".".join(("isorig", "analysis", *file.relative_to(root).with_suffix("").parts)) for file in sources()}
    for file in sources():
        for module, names in re.findall(r"^from (isorig[\w.]*) import (.+)$", file.read_text(encoding="utf-8"), re.MULTILINE):
            constants = [name for name in re.findall(r"\w+", names) if re.fullmatch(r"[A-Z][A-Z_]+", name)]
            # Names, tables of names and objects, which no kernel can use.
            if constants and constants not in (["GROUND"], ["FORMULAS"], ["MOTION"], ["NO_LINK"]):
                assert module in known, f"{file.name} takes {constants} from {module}"
