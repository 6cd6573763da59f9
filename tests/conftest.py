"""What tests share."""

import gc
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings

from isorig.analysis.errors import AnalysisError
from isorig.rig.errors import RigError
from isorig.rig.frf import drawing

#: The same examples on every machine and in every run.
settings.register_profile("fixed", derandomize=True)
settings.load_profile("fixed")

# A shell ignores SIGINT for what it starts in the background, and processes that tests start would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent


def pytest_collection_finish() -> None:
    """Leave what the modules have loaded out of all later searches for unused objects: of these there are many."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of measured campaigns and contracts beside the project."""
    folder = ROOT.parent / "shared"
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent: tests against campaigns made by another program are skipped")
    return folder


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], object]], Path]:
    """A folder of a name, filled by the test that asks first: all processes of a session share it, and none changes it."""
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "made-once"
    shared.mkdir(exist_ok=True)

    def made(name: str, make: Callable[[Path], object]) -> Path:
        folder, begun = shared / name, shared / f"{name}.begun"
        with FileLock(shared / f"{name}.lock"):
            if not folder.exists():
                # One that another process left unfinished is made anew.
                shutil.rmtree(begun, ignore_errors=True)
                begun.mkdir()
                make(begun)
                begun.rename(folder)
        return folder

    return made


@pytest.fixture(scope="session", autouse=True)
def _one_process_draws() -> Iterator[None]:
    """Let all commands of these tests send their figures to one process, instead of starting one each."""
    begun: list[drawing.FigureProcess] = []

    @contextmanager
    def kept() -> Iterator[drawing.FigureProcess]:
        if not begun:
            begun.append(drawing.FigureProcess())
        refused: Exception | None = None
        try:
            try:
                yield begun[0]
            except (AnalysisError, RigError) as error:
                refused = error
            begun[0].wait()
        except BaseException:
            begun.pop().end()
            raise
        if refused is not None:
            raise refused

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "drawn_elsewhere", kept)
        yield
    for each in begun:
        each.end()


#: Files whose tests take longest, begun first: a worker that begins one last keeps the other waiting.
LONGEST = (
    "tests/docs/test_pages.py", "tests/rig/test_demo.py", "tests/blind/", "tests/analysis/diagnose/",
    "tests/rig/test_displaced_damper.py",
    "tests/rig/fleet/", "tests/analysis/equations/", "tests/rig/test_moved_rigs.py", "tests/analysis/test_characterize.py",
    "tests/thesis/", "tests/analysis/test_wrong_scale.py", "tests/rig/test_slow_pulls.py", "tests/test_interface.py",
    "tests/rig/test_any_rig.py", "tests/rig/test_seed.py", "tests/rig/next/", "tests/docs/", "tests/rig/test_diagnose_options.py",
    "tests/analysis/test_accuracy.py", "tests/test_wrong_arguments.py", "tests/rig/test_hostile.py",
    "tests/analysis/laws/", "tests/rig/test_fuzz.py", "tests/rig/test_report.py", "tests/drivers/test_attacks.py",
    "tests/rig/acquire/test_host_clock.py", "tests/drivers/test_contract.py", "tests/rig/acquire/test_sessions_attacked.py",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order tests by file, the longest first; the order within a file stays."""

    def place(item: pytest.Item) -> int:
        path = item.path.relative_to(ROOT).as_posix()
        return next((k for k, start in enumerate(LONGEST) if path.startswith(start)), len(LONGEST))

    items.sort(key=place)
