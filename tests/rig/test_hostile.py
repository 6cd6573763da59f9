"""Recordings from others: links out, sizes that are not stored, bombs, pipes, and bits that flipped where no sample is."""

from __future__ import annotations

import os
import resource
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from test_recording import example

from isorig.analysis.campaign import Campaign
from isorig.rig.cli import main
from isorig.rig.errors import RecordingError
from isorig.rig.exchange import exporting
from isorig.rig.files import hdf
from isorig.rig.files.recording import read, write

Change = Callable[[h5py.File, Path], None]


def replace_motor(file: h5py.File) -> None:
    del file["runs/u70/motor"]


def link_to_file(file: h5py.File, folder: Path) -> None:
    write(folder / "other.h5", example())
    replace_motor(file)
    file["runs/u70/motor"] = h5py.ExternalLink(str(folder / "other.h5"), "/runs/u70/motor")


def link_to_pipe(file: h5py.File, folder: Path) -> None:
    os.mkfifo(folder / "pipe")
    replace_motor(file)
    file["runs/u70/motor"] = h5py.ExternalLink(str(folder / "pipe"), "/runs/u70/motor")


def soft_link_out(file: h5py.File, folder: Path) -> None:
    link_to_file(file, folder)
    file["runs/u70/way"] = h5py.ExternalLink(str(folder / "other.h5"), "/runs")
    del file["runs/u70/motor"]
    file["runs/u70/motor"] = h5py.SoftLink("/runs/u70/way/u70/motor")


def stored_outside(file: h5py.File, folder: Path) -> None:
    (folder / "secret").write_bytes(b"a secret that nobody is to read" * 100)
    replace_motor(file)
    file["runs/u70"].create_dataset("motor", (300,), "i4", external=[(str(folder / "secret"), 0, 1200)])


def put_together(file: h5py.File, folder: Path) -> None:
    write(folder / "other.h5", example())
    replace_motor(file)
    layout = h5py.VirtualLayout((300,), "i4")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "/runs/u70/motor", (300,))
    file["runs/u70"].create_virtual_dataset("motor", layout)


def nothing_stored(file: h5py.File, folder: Path) -> None:
    for name in ("head", "motor", "table", "heatblock"):
        del file[f"runs/u70/{name}"]
        file["runs/u70"].create_dataset(name, (400_000_000,), "i4")


def chunks_missing(file: h5py.File, folder: Path) -> None:
    replace_motor(file)
    dataset = file["runs/u70"].create_dataset("motor", (300,), "i4", chunks=(100,))
    dataset[:100] = 1


def bomb(file: h5py.File, folder: Path) -> None:
    for name in ("head", "motor", "table", "heatblock"):
        del file[f"runs/u70/{name}"]
        dataset = file["runs/u70"].create_dataset(name, (5_500_000,), "i4", chunks=(1 << 22,), compression="gzip")
        dataset[:4] = 1
        for start in range(0, 5_500_000, 1 << 22):
            dataset[start : start + 1] = 0


def big_chunk(file: h5py.File, folder: Path) -> None:
    replace_motor(file)
    file["runs/u70"].create_dataset("motor", (300,), "i4", maxshape=(None,), chunks=(20_000_000,), compression="gzip")[:] = 1


def many_runs(file: h5py.File, folder: Path) -> None:
    for k in range(20_000):
        file[f"runs/r{k}"] = file["runs/u70"]


def same_runs(file: h5py.File, folder: Path) -> None:
    for k in range(20):
        file[f"runs/r{k}"] = file["runs/u70"]


def runs_upon_runs(file: h5py.File, folder: Path) -> None:
    for k in range(2001):
        file.create_group(f"runs/r{k}")


def many_channels(file: h5py.File, folder: Path) -> None:
    for k in range(300):
        file[f"runs/u70/c{k}"] = np.zeros(300)


def soft_channels(file: h5py.File, folder: Path) -> None:
    for k in range(30):
        for j in range(200):
            file[f"runs/r{k}/c{j}"] = h5py.SoftLink("/runs/u70/motor")


def soft_runs(file: h5py.File, folder: Path) -> None:
    for k in range(1000):
        file[f"runs/r{k}"] = h5py.SoftLink("/runs/u70")


def soft_upon_soft(file: h5py.File, folder: Path) -> None:
    file["first"] = h5py.SoftLink("/runs/u70/motor")
    for k in range(20):
        file[f"runs/u70/c{k}"] = h5py.SoftLink("/first")


def gap_beyond(file: h5py.File, folder: Path) -> None:
    gaps(file, (400, 3))


def gap_without_end(file: h5py.File, folder: Path) -> None:
    gaps(file, (100, 1 << 62))


def gap_on_gap(file: h5py.File, folder: Path) -> None:
    gaps(file, (100, 10), (105, 3))


def gaps(file: h5py.File, *rows: tuple[int, int]) -> None:
    del file["runs/u70/gaps"]
    file["runs/u70/gaps"] = np.array(list(rows), [("first_tick", "i8"), ("count", "i8")])


def more_gaps_than_samples(file: h5py.File, folder: Path) -> None:
    gaps(file, *((2 * k, 1) for k in range(400)))


def long_attribute(file: h5py.File, folder: Path) -> None:
    replace_motor(file)
    with h5py.File(folder / "x.h5", "w", libver="latest") as other:
        other["motor"] = np.zeros(300)
        other["motor"].attrs["unit"] = np.zeros(1 << 18)
        other.copy("motor", file["runs/u70"])


def group_as_channel(file: h5py.File, folder: Path) -> None:
    replace_motor(file)
    file.create_group("runs/u70/motor")


def name_for_a_terminal(file: h5py.File, folder: Path) -> None:
    file.move("runs/u70/motor", "runs/u70/\x1b[31mmotor")


def a_circle(file: h5py.File, folder: Path) -> None:
    file["runs/u70/again"] = file["runs"]
    file["runs/root"] = file["/"]


HOSTILE: dict[str, tuple[Change, str]] = {
    "link to another file": (link_to_file, "is a link to another file"),
    "link to a pipe": (link_to_pipe, "is a link to another file"),
    "soft link out": (soft_link_out, "is a link to another file"),
    "values of any file": (stored_outside, "is stored in another file"),
    "values of other files": (put_together, "is a virtual dataset"),
    "1.6 GB that are not there": (nothing_stored, "MiB that are declared in"),
    "chunks that are not there": (chunks_missing, "declares 3 chunks but 1 are stored"),
    "bomb": (bomb, "MiB that are declared in"),
    "chunk of 80 MB": (big_chunk, "chunks of 76 MiB"),
    "20000 times one run": (many_runs, "20001 objects; at most"),
    "20 times one run": (same_runs, "is linked more than 16 times"),
    "6000 soft links to a channel": (soft_channels, "is linked more than 16 times"),
    "1000 soft links to a run": (soft_runs, "is linked more than 16 times"),
    "20 soft links to a soft link": (soft_upon_soft, "is linked more than 16 times"),
    "2001 runs": (runs_upon_runs, "2002 runs; at most 2000"),
    "300 channels": (many_channels, "channels; at most 256"),
    "gap beyond the end": (gap_beyond, "beyond the end at 300 ticks"),
    "gap without end": (gap_without_end, "a gap of 4611686018427387904 ticks"),
    "gap on a gap": (gap_on_gap, "inside another gap"),
    "more gaps than samples": (more_gaps_than_samples, "400 gaps but 300 samples"),
    "attribute of 2 MB": (long_attribute, "has an attribute 'unit' of 2097152 bytes"),
    "group as channel": (group_as_channel, "'motor' is a group"),
    "name that turns a terminal red": (name_for_a_terminal, "a name that cannot be displayed"),
    "circle": (a_circle, "lacks the attribute"),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_what_leads_out_or_is_not_stored_is_refused(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    change, says = HOSTILE[kind]
    path = tmp_path / "hostile.h5"
    write(path, example())
    with h5py.File(path, "a") as file:
        change(file, tmp_path)
    assert exporting.ENDINGS  # what it imports is in memory by now
    before, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    for call in (["check", str(path)], ["export", str(path), "-o", str(tmp_path / "out.csv")]):
        assert main(call) == 2
        told = capsys.readouterr().err
        assert says in told
        assert told.count("\n") == 1
    assert time.monotonic() - begun < 5.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50 << 10
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(("kind", "elements"), [("<i8", 1 << 29), ("<i4", 1 << 29), ("<i8", 1 << 20)])
def test_a_filter_that_declares_more_elements_than_a_chunk_is_refused(tmp_path: Path, kind: str, elements: int) -> None:
    path, rows = tmp_path / "a.h5", 7000
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["format_version"] = "rig-recording", 1
        group = file.create_group("runs/a")
        group.attrs.update(configuration="unlocked", sample_rate=512.0, gain=70.0)
        top = 1 << (8 * np.dtype(kind).itemsize - 2)
        values = np.random.default_rng(0).integers(-top, top, rows).astype(kind)
        group.create_dataset("head", data=values, chunks=(rows,), scaleoffset=0)
    content = bytearray(path.read_bytes())
    # The filter's own copy of the size, after the kind and the factor of its scale.
    at = content.index(struct.pack("<III", 2, 0, rows)) + 8
    content[at : at + 4] = struct.pack("<I", elements)
    path.write_bytes(content)
    # In a process of its own: it would crash.
    call = [sys.executable, "-m", "isorig", "check", str(path)]
    ended = subprocess.run(call, capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 2, ended
    assert ended.stderr.startswith(f"rig: {path}")
    assert ended.stderr.count("\n") == 1


def test_a_matlab_file_that_grows_without_end_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"a": np.arange(4.0)})
    # A variable of 1 GiB, after MathWorks's description: array of doubles, 1 x 2^27, called a.
    tag = struct.Struct("<II").pack
    matrix = tag(6, 8) + tag(6, 0) + tag(5, 8) + tag(1, 1 << 27) + tag(1, 1) + b"a".ljust(8, b"\0") + tag(9, 1 << 30)
    packer = zlib.compressobj(9)
    packed = packer.compress(tag(14, len(matrix) + (1 << 30)) + matrix)
    packed += b"".join(packer.compress(bytes(1 << 22)) for _ in range(8)) + packer.flush()
    path.write_bytes(path.read_bytes()[:128] + tag(15, len(packed)) + packed)
    assert main(["import", "--draft", str(path), "-o", str(tmp_path / "m.toml")]) == 2
    assert "declares 1024 MiB in" in capsys.readouterr().err


def test_a_matlab_file_that_crashes_its_reader_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"t": np.arange(300.0)})
    content = bytearray(path.read_bytes())
    # The type of the values: no type at all in place of doubles.
    content[content.index(struct.pack("<II", 9, 2400))] = 0
    path.write_bytes(content)
    assert main(["import", "--draft", str(path), "-o", str(tmp_path / "m.toml")]) == 2
    told = capsys.readouterr().err
    assert "is damaged" in told
    assert told.count("\n") == 1


def test_what_a_run_lacks_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.h5"
    write(path, example())
    with h5py.File(path, "a") as file:
        file["runs/u70"].attrs["configuration"] = "lokced"
        del file["runs/u70/head"]
    assert main(["check", str(path)]) == 0
    told = capsys.readouterr().out
    assert "Run 'u70' has the configuration 'lokced'; the rig has unlocked, locked" in told
    assert "Run 'u70' has no drive channel 'head'" in told
    with h5py.File(path, "a") as file:
        file["rig"].attrs["description"] = "name = 3"
    assert main(["check", str(path)]) == 0
    assert "The rig's description cannot be used: it: " in capsys.readouterr().out


def test_links_inside_a_file_are_followed(tmp_path: Path) -> None:
    write(tmp_path / "a.h5", example())
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file.move("runs/u70/motor", "motor as it was stored")
        file["runs/u70/motor"] = h5py.SoftLink("/motor as it was stored")
        del file["runs/u70/table"]
        file["runs/u70/table"] = file["runs/u70/head"]
    run = read(tmp_path / "a.h5").runs[0]
    np.testing.assert_array_equal(run.read("table"), run.read("head"))
    np.testing.assert_array_equal(run.read("motor"), run.read("heatblock"))


#: Each command with a pipe in the place of a file.
PIPES = (
    "check PIPE.h5", "recover PIPE.partial -o OUT", "frf PIPE.h5 -o OUT", "acquire PIPE.toml -o OUT", "import PIPE.toml -o OUT",
    "import --draft PIPE.mat -o OUT", "import --draft PIPE.csv -o OUT", "import --draft PIPE.uff -o OUT",
    "import --draft PIPE.tdms -o OUT", "export PIPE.h5 -o OUT.mat", "export PIPE.json -o OUT.csv",
    "predict PIPE.json PIPE.h5 -o OUT",
    "design PIPE.toml -o OUT", "simulate --model PIPE.json -o OUT", "simulate --model PIPE.toml -o OUT", "report PIPE.h5 -o OUT",
    "characterize PIPE.h5 -o OUT", "isolation PIPE.h5 -o OUT", "diagnose PIPE.h5 -o OUT",
)  # fmt: skip


@pytest.mark.parametrize("call", PIPES)
def test_a_pipe_is_never_opened(tmp_path: Path, call: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = []
    for word in call.split():
        if word.startswith("PIPE"):
            pipe = tmp_path / word
            if not pipe.exists():
                os.mkfifo(pipe)
            words.append(str(pipe))
        else:
            words.append(word.replace("OUT", str(tmp_path / "out")))
    signal.alarm(10)
    try:
        assert main(words) == 2
    finally:
        signal.alarm(0)
    told = capsys.readouterr().err
    assert told.startswith("rig: ")
    assert told.count("\n") == 1, told


def same(a: Campaign, b: Campaign) -> bool:
    def told(campaign: Campaign) -> object:
        return campaign.known, campaign.description, [
            (
                run.id, run.configuration, run.sample_rate, run.gain, run.excitation, run.started, run.band, run.period, run.use,
                run.gaps, [(s.name, s.kind, s.response, s.values.tolist(), s.frequency.tolist(), s.unit) for s in run.spectra],
                {n: (c.quantity, c.unit, c.scale, c.offset, c.full_scale, c.read().tolist()) for n, c in run.channels.items()},
            )
            for run in campaign.runs
        ]  # fmt: skip

    return told(a) == told(b)


@pytest.mark.parametrize("step", [61, pytest.param(1, marks=pytest.mark.study)])
def test_a_bit_that_flipped_anywhere_is_refused_or_changes_nothing(tmp_path: Path, step: int) -> None:
    path, random = tmp_path / "a.h5", np.random.default_rng(step)
    write(path, example())
    whole, content = read(path), path.read_bytes()
    refused = 0
    for place in range(0, len(content), step):
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(random.integers(8))
        path.write_bytes(flipped)
        hdf._walk.cache_clear()
        with suppress(RecordingError):
            assert same(read(path), whole), place
            continue
        refused += 1
    print(f"{len(range(0, len(content), step))} bytes flipped one at a time, {refused} refused")
    assert refused > 0


def without_checksums(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["format_version"] = "rig-recording", 1
        for k, run in enumerate("abc"):
            group = file.create_group(f"runs/{run}")
            group.attrs.update(configuration="unlocked", sample_rate=512.0, gain=70.0)
            how = [{}, {"compression": "gzip", "shuffle": True}, {"chunks": (100,), "fletcher32": True}][k]
            for name in ("head", "motor", "table"):
                group.create_dataset(name, data=np.arange(300, dtype=np.int32), **how).attrs["scale"] = 1e-3


@pytest.mark.parametrize("flips", [60, pytest.param(5000, marks=[pytest.mark.study, pytest.mark.timeout(3600)])])
def test_a_bit_that_flipped_in_another_programs_file_crashes_nothing(tmp_path: Path, flips: int) -> None:
    # Nothing in such a file tells that a scale has changed; that the library crashes or does not return is found out elsewhere.
    path, random = tmp_path / "a.h5", np.random.default_rng(flips)
    without_checksums(path)
    content, seen = path.read_bytes(), Counter[str]()
    for _ in range(flips):
        flipped = bytearray(content)
        flipped[int(random.integers(len(content)))] ^= 1 << int(random.integers(8))
        path.write_bytes(flipped)
        hdf._walk.cache_clear()
        try:
            read(path)
            seen["accepted"] += 1
        except RecordingError as refusal:
            seen["crash or hang" if "reading it never ends" in str(refusal) else "refused"] += 1
    print(dict(seen))
    assert seen.total() == flips


def test_what_kills_the_library_kills_no_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.h5"
    write(path, example())
    killer = tmp_path / "walk.py"
    real = Path(hdf.__file__).with_name("hdf_walk.py")
    for body in (
        "import os; print('{}', flush=True); input(); os.abort()",
        "import time; print('{}', flush=True); time.sleep(60)",
        # The check itself, in which the library never returns.
        f"import runpy; walk = runpy.run_path({str(real)!r})\ndef spin(path):\n while True: pass\n"
        "main = walk['main']; main.__globals__['answer'] = spin; main()",
    ):
        killer.write_text(body)
        monkeypatch.setattr(hdf, "STILL", 0.5)
        monkeypatch.setattr(hdf, "WAITS", 60.0 if "spin" in body else 0.5)
        monkeypatch.setattr(Path, "with_name", lambda self, name: killer)
        monkeypatch.setattr(hdf, "has_one_thread", lambda: False)
        hdf._walk.cache_clear()
        hdf._walker.cache_clear()
        with pytest.raises(RecordingError, match="reading it never ends"):
            read(path)
        monkeypatch.undo()
    assert len(read(path).runs) == 1


def test_what_kills_the_library_kills_no_command_that_forked_its_check(tmp_path: Path) -> None:
    program = """
import os, sys, time
from isorig.rig.errors import RecordingError
from isorig.rig.files import hdf, hdf_walk
from isorig.rig.files.forked import has_one_thread
from isorig.rig.files.recording import read

def abort(path):
    os.abort()

def stop(path):
    time.sleep(60.0)

def spin(path):
    while True:
        pass

sound = hdf_walk.answer
for answer in (abort, stop, spin):
    hdf.STILL, hdf.WAITS, hdf_walk.answer = 0.5, 60.0 if answer is spin else 0.5, answer
    for _ in range(1000):
        # The system lists a thread for a moment after it was joined; until then, the next check is started and not forked.
        if has_one_thread():
            break
        time.sleep(0.01)
    try:
        read(sys.argv[1])
    except RecordingError as refusal:
        print("reading it never ends" in str(refusal))
hdf_walk.answer = sound
print(len(read(sys.argv[1]).runs))
"""
    write(tmp_path / "a.h5", example())
    call = [sys.executable, "-c", program, str(tmp_path / "a.h5")]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    printed = subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout
    assert printed.split() == ["True", "True", "True", "1"]


def test_a_process_forks_its_check_only_with_one_thread(tmp_path: Path) -> None:
    program = """
import os, sys, threading
from isorig.rig.files import hdf
from isorig.rig.files.recording import read

wait = threading.Event()
if sys.argv[2] == "2":
    threading.Thread(target=wait.wait).start()
read(sys.argv[1])
print(type(hdf._walker(os.getpid())._process).__name__)
wait.set()
"""
    write(tmp_path / "a.h5", example())
    alone = "ForkedProcess" if Path("/proc/self/task").is_dir() else "Popen"
    for threads, kind in (("1", alone), ("2", "Popen")):
        call = [sys.executable, "-c", program, str(tmp_path / "a.h5"), threads]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        assert subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout == f"{kind}\n"


def test_a_check_that_waits_for_a_busy_host_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "a.h5", example())
    (tmp_path / "walk.py").write_text("import time; print('{}', flush=True); input(); time.sleep(1.5); print('{}', flush=True)")
    with monkeypatch.context() as changed:
        changed.setattr(hdf, "STILL", 0.5)
        changed.setattr(Path, "with_name", lambda self, name: tmp_path / "walk.py")
        changed.setattr(hdf, "has_one_thread", lambda: False)
        hdf._walk.cache_clear()
        hdf._walker.cache_clear()
        assert len(read(tmp_path / "a.h5").runs) == len(example().runs)
    hdf._walker.cache_clear()
