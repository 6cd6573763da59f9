"""The step of the installation that compiles: afterwards no command does."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

#: Prints the kernels without a file in the cache.
LEFT = """
import gc
import os

from isorig.analysis.jit import Kernel
from isorig.rig.virtual.compile_kernels import main

main()
cached = [each for each in gc.get_objects() if isinstance(each, Kernel) and each._cached]
assert len(cached) > 50
print(*(each.__name__ for each in cached if not os.path.exists(each.compiled._cache._cache_file._index_path)))
"""


@pytest.mark.study  # half a minute of compiling
def test_no_kernel_is_left_to_compile(tmp_path: Path) -> None:
    call = [sys.executable, "-c", LEFT]
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(call, env=env, capture_output=True, text=True, check=True, timeout=600)
    assert not done.stdout.split()
