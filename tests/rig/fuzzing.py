"""Damaged and forged inputs for each command, each tried in a process of its own.

    python tests/rig/fuzzing.py KIND=COUNT[,KIND=COUNT...] SEED FOLDER

A process imports what the commands need and forks for every input, so that none costs a start of Python; what a command imports
late is imported here for those that follow. The process that checks HDF5 files first is a fork, too, with its own limits. A line
of JSON tells of each input that ended otherwise than with a result or a refusal of one line; another of how many of each kind
were accepted and refused.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import io
import json
import os
import re
import resource
import signal
import sys
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat, wavfile

from isorig.analysis.campaign import Campaign, Channel, Gap, Run, Spectrum
from isorig.drivers.block import Block, Input
from isorig.rig import cli
from isorig.rig.acquire import plan_check as sound
from isorig.rig.acquire import session
from isorig.rig.acquire import store as keep
from isorig.rig.acquire.plan import plan_of
from isorig.rig.acquire.recorder import RunWriter, recording_into
from isorig.rig.commands import check, design, export, frf, import_, isolation, predict, recover, report, simulate
from isorig.rig.exchange import draft, exporting, importing
from isorig.rig.exchange.formats import matlab, tdms, text, uff, wav
from isorig.rig.files import rigfile
from isorig.rig.files.recording import read, write
from isorig.rig.files.rigfile import write_model
from isorig.rig.frf import figures, transfer
from isorig.rig.model import prediction
from isorig.rig.wire_bonder.description import wire_bonder

#: Imported for the processes that are forked, not used here.
READY = (
    plt, pd, pyuff, figures, prediction, rigfile, transfer, keep, session, sound, check, design, export, frf, import_, isolation,
    predict, recover, report, simulate, draft, exporting, importing, matlab, tdms, text, uff, wav,
)  # fmt: skip
ROOT = Path(__file__).resolve().parents[2]
#: Seconds of a processor that a command may need, and of a clock: on a busy machine they come apart. A design study of a sound
#: profile takes ten seconds by itself.
USUAL, LONGER, CLOCK = 10, {"moves": 60}, 120.0
#: Bytes that it may need in addition to those of the process that is forked, which are another GiB.
MEMORY = 5 << 30
#: Files that belong to a try, not to the command: what it said, what it printed, which modules it imported.
OWN = (".said", ".told", ".loaded")
RATE, LENGTH = 512.0, 1024

Words = list[str]
#: Set by SIGTERM: what was tried so far is counted, and the rest is not tried.
over = threading.Event()


def campaign() -> Campaign:
    """Three runs, one of them locked, with a gap, a spectrum and a streamed gain."""
    random = np.random.default_rng(7)
    runs = []
    for name, configuration, gain in (("u70", "unlocked", 70.0), ("u7", "unlocked", 7.0), ("l70", "locked", 70.0)):
        head = random.integers(-20000, 20000, LENGTH).astype(np.int32)
        raw = {"head": head, "motor": head // 2 + 5, "table": np.roll(head, 3) // 3, "heatblock": -head // 4}
        channels = {key: Channel(name=key, samples=values, scale=1e-3, full_scale=50.0) for key, values in raw.items()}
        spectrum = Spectrum(
            name="a", kind="transfer_function", response="motor", reference="head", frequency=np.arange(9.0),
            values=np.arange(9.0) * (1.0 + 1.0j),
        )  # fmt: skip
        runs.append(
            Run(
                id=name, configuration=configuration, sample_rate=RATE, gain=gain, channels=channels, excitation="random",
                band=(0.5, 200.0), gaps=(Gap(first_tick=100, count=5),), spectra=(spectrum,),
            )
        )  # fmt: skip
    return Campaign(runs=tuple(runs), known={"head_mass": 6.5, "motor_mass": 16.4, "heatblock_mass": 6.0, "table_mass": 250.0})


def recording(folder: Path) -> tuple[Path, list[Words]]:
    """As this program writes it."""
    write(folder / "a.h5", campaign())
    return folder / "a.h5", ON_RECORDINGS


ON_RECORDINGS = [
    ["check", "FILE"], ["frf", "FILE", "-o", "out"], ["export", "FILE", "-o", "out.mat"], ["report", "FILE", "-o", "out.html"],
    ["isolation", "FILE", "-o", "out"], ["export", "FILE", "--what", "frf", "-o", "out.uff"],
]  # fmt: skip


def foreign_recording(folder: Path) -> tuple[Path, list[Words]]:
    """As another program may write it: without checksums, text of variable length, compressed or in one piece."""
    with h5py.File(folder / "a.h5", "w") as file:
        file.attrs["format"], file.attrs["format_version"] = "rig-recording", 1
        file.create_group("rig").attrs["head_mass"] = 6.5
        for k, run in enumerate(campaign().runs):
            group = file.create_group(f"runs/{run.id}")
            group.attrs.update(configuration=run.configuration, sample_rate=run.sample_rate, gain=run.gain, excitation="random")
            group.attrs["band"] = run.band
            for name, channel in run.channels.items():
                how: dict[str, Any] = [{}, {"compression": "gzip", "shuffle": True}, {"chunks": (100,), "fletcher32": True}][k]
                dataset = group.create_dataset(name, data=channel.samples[:], **how)
                dataset.attrs.update(quantity="acceleration", unit="m/s^2", scale=1e-3)
            group["gaps"] = np.array([(100, 5)], [("first_tick", "i8"), ("count", "i8")])
    return folder / "a.h5", ON_RECORDINGS


def check(folder: Path) -> tuple[Path, list[Words]]:
    """`rig check` alone."""
    return foreign_recording(folder)[0], [["check", "FILE"]]


def frf(folder: Path) -> tuple[Path, list[Words]]:
    """`rig frf` alone."""
    return foreign_recording(folder)[0], [["frf", "FILE", "-o", "out", "--resolution", "8"]]


def diagnose(folder: Path) -> tuple[Path, list[Words]]:
    """`rig diagnose`; what is sound is refused as too short."""
    return foreign_recording(folder)[0], [["diagnose", "FILE", "-o", "out", "--seconds", "1"]]


def fleet(folder: Path) -> tuple[Path, list[Words]]:
    """`rig fleet watch` on the folder of the recording."""
    call = ["fleet", "watch", ".", "-c", "out", "--every", "0.05", "--stop-after", "0.2", "--seconds", "1"]
    return foreign_recording(folder)[0], [call]


def describe(folder: Path) -> tuple[Path, list[Words]]:
    """`rig describe`."""
    return description(folder)[0], [["describe", "FILE"]]


def working(folder: Path) -> tuple[Path, list[Words]]:
    """A session's working file, whose samples tell their own ticks."""
    tree = {
        "instrument": {"kind": "framed", "port": "x", "sample_rate": RATE},
        "channels": {name: {"input": k, "sensitivity": 1.0} for k, name in enumerate("abcd")},
        "runs": [{"id": n, "configuration": "unlocked", "gain": 1.0, "excitation": "moves", "seconds": 2.0} for n in "uv"],
    }
    plan, inputs = plan_of(tree), [Input(unit="V", per_count=1.0, full_scale=None, dtype="int32")] * 4
    path = folder / "a.h5.partial"
    with recording_into(path, plan, inputs) as file:
        for name in "uv":
            writer = RunWriter(file, name, period=None)
            for tick in range(0, 1024, 32):
                values = np.arange(tick, tick + 32, dtype=np.int32)[:, None] * 4 + np.arange(4, dtype=np.int32)
                writer._store([Block(first_tick=tick, samples=values, host_time=tick / RATE, gain=1.0)])
            writer.finish(1024)
    return path, [["recover", "FILE", "-o", "out.h5"]]


def plan(folder: Path) -> tuple[Path, list[Words]]:
    """A plan; nothing listens where its instrument is looked for."""
    path = folder / "plan.toml"
    path.write_text((ROOT / "isorig" / "rig" / "acquire" / "demo.toml").read_text())
    return path, [["acquire", "FILE", "--port", "socket://127.0.0.1:1", "--yes", "-o", "out.h5"]]


def mapping(folder: Path) -> tuple[Path, list[Words]]:
    """A mapping with the file that it maps."""
    savemat(folder / "a.mat", {"t": np.arange(64) / RATE, "h": np.arange(64.0)})
    path = folder / "mapping.toml"
    path.write_text(
        'rig = {head_mass = 6.5}\n[channels.head]\nsource = "h"\nunit = "g"\nsensitivity = 2.0\nrange = 50.0\n'
        '[[runs]]\nid = "u"\n'
        'file = "a.mat"\nconfiguration = "unlocked"\ngain = 70.0\ntime = "t"\nband = [0.5, 20.0]\nsamples = [0, 60]\n'
        'started = 2026-01-02T03:04:05+00:00\nexcitation = "random"\n'
    )
    return path, [["import", "FILE", "-o", "out.h5"]]


def model(folder: Path) -> tuple[Path, list[Words]]:
    """A model, and a recording to predict."""
    write(folder / "b.h5", campaign())
    write_model(folder / "model.json", wire_bonder())
    return folder / "model.json", [["predict", "FILE", "b.h5", "-o", "out.h5"]]


def description(folder: Path) -> tuple[Path, list[Words]]:
    """A rig's description in its own format."""
    path = folder / "rig.toml"
    path.write_text((ROOT / "fixtures_data" / "mappings" / "emps-rig.toml").read_text())
    call = [
        "simulate",
        "--model",
        "FILE",
        "--excitation",
        "half-sine",
        "--seconds",
        "0.5",
        "--sample-rate",
        "256",
        "-o",
        "out.h5",
    ]
    return path, [call]


def moves(folder: Path) -> tuple[Path, list[Words]]:
    """A profile of moves."""
    path = folder / "moves.toml"
    path.write_text((ROOT / "fixtures_data" / "moves.toml").read_text())
    return path, [["design", "FILE", "--points", "5", "--draws", "5", "-o", "out"]]


def parameters(folder: Path) -> tuple[Path, list[Words]]:
    """A parameter table."""
    path = folder / "parameters.json"
    table = {name: {"value": 6.5 + k, "std": 0.1, "unit": "kg"} for k, name in enumerate(("motor_mass", "table_mass"))}
    path.write_text(json.dumps({"format": "rig-parameters", "format_version": 1, "parameters": table}))
    return path, [["export", "FILE", "-o", "out.csv"], ["export", "FILE", "-o", "out.mat"]]


def _import(folder: Path, name: str) -> tuple[Path, list[Words]]:
    # The mapping is the draft of the sound file, its rate and units filled in.
    with contextlib.redirect_stdout(io.StringIO()):
        assert cli.main(["import", "--draft", str(folder / name), "-o", str(folder / "mapping.toml")]) == 0
    return folder / name, [["import", "--draft", "FILE", "-o", "out.toml"], ["import", "mapping.toml", "-o", "out.h5"]]


def mat5(folder: Path, *, compressed: bool = True) -> tuple[Path, list[Words]]:
    """MATLAB version 5, compressed."""
    tree = {"t": np.arange(300) / RATE, "h": np.arange(300.0), "more": {"table": np.arange(300.0)}, "note": "text", "k": 3.0}
    savemat(folder / "a.mat", tree, do_compression=compressed)
    return _import(folder, "a.mat")


def mat5_plain(folder: Path) -> tuple[Path, list[Words]]:
    """MATLAB version 5 as it stands, without a checksum."""
    return mat5(folder, compressed=False)


def mat73(folder: Path) -> tuple[Path, list[Words]]:
    """MATLAB version 7.3."""
    with h5py.File(folder / "a.mat", "w", userblock_size=512) as file:
        for name, values in (("t", np.arange(300) / RATE), ("h", np.arange(300.0)), ("more/table", np.arange(300.0))):
            file.create_dataset(name, data=values[None, :], **({"compression": "gzip"} if name == "h" else {}))
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    return _import(folder, "a.mat")


def universal(folder: Path) -> tuple[Path, list[Words]]:
    """A universal file in text."""
    write(folder / "b.h5", campaign())
    assert cli.main(["export", str(folder / "b.h5"), "--text", "--run", "u70", "-o", str(folder / "a.uff")]) == 0
    return _import(folder, "a.uff")


def universal_binary(folder: Path) -> tuple[Path, list[Words]]:
    """A universal file in its binary form, with transfer functions."""
    write(folder / "b.h5", campaign())
    assert cli.main(["export", str(folder / "b.h5"), "--run", "u70", "-o", str(folder / "a.uff")]) == 0
    return _import(folder, "a.uff")


def tdms(folder: Path) -> tuple[Path, list[Words]]:
    """TDMS."""
    with TdmsWriter(folder / "a.tdms") as writer:
        about = {"wf_increment": 1.0 / RATE, "unit_string": "V"}
        for _ in range(3):
            writer.write_segment([ChannelObject("daq", name, np.arange(100.0), about) for name in ("h", "table")])
    return _import(folder, "a.tdms")


def csv(folder: Path) -> tuple[Path, list[Words]]:
    """Text."""
    rows = [f"{k / RATE!r},{k},{2 * k}" for k in range(200)]
    (folder / "a.csv").write_text("# by hand\nt [s],h [g],table [m/s²]\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return _import(folder, "a.csv")


def wav(folder: Path) -> tuple[Path, list[Words]]:
    """Sound."""
    wavfile.write(folder / "a.wav", int(RATE), np.arange(400, dtype=np.int16).reshape(-1, 2))
    return _import(folder, "a.wav")


def arrays(folder: Path) -> dict[str, np.ndarray]:
    """What the formats of arrays have in common."""
    return {"t": np.arange(300) / RATE, "h": np.arange(300.0), "table": np.arange(300.0)}


def npz(folder: Path) -> tuple[Path, list[Words]]:
    """Arrays of numpy."""
    np.savez_compressed(folder / "a.npz", **arrays(folder))
    return _import(folder, "a.npz")


def npy(folder: Path) -> tuple[Path, list[Words]]:
    """One structured array of numpy."""
    values = arrays(folder)
    np.save(folder / "a.npy", np.rec.fromarrays(list(values.values()), names=list(values)))
    return _import(folder, "a.npy")


def as_json(folder: Path) -> tuple[Path, list[Words]]:
    """JSON."""
    (folder / "a.json").write_text(json.dumps({name: values.tolist() for name, values in arrays(folder).items()}))
    return _import(folder, "a.json")


def hdf5(folder: Path) -> tuple[Path, list[Words]]:
    """HDF5 that is no recording."""
    with h5py.File(folder / "a.hdf5", "w") as file:
        for name, values in arrays(folder).items():
            file.create_dataset(name, data=values, **({"compression": "gzip"} if name == "h" else {}))
    return _import(folder, "a.hdf5")


def lvm(folder: Path) -> tuple[Path, list[Words]]:
    """LVM of LabVIEW."""
    head = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t,", "Multi_Headings\tYes", "X_Columns\tNo"]
    channels = ["Channels\t2", "Samples\t300\t300", "Y_Unit_Label\tN\tm/s^2", "X_Dimension\tTime\tTime", "X0\t0,0\t0,0"]
    rows = [f"\t{k},5\t{2 * k},25" for k in range(300)]
    end = "***End_of_Header***"
    lines = [*head, end, "", *channels, "Delta_X\t0,001953125\t0,001953125", end, "X_Value\tforce\ttable\tComment", *rows]
    (folder / "a.lvm").write_text("\n".join(lines) + "\n")
    return _import(folder, "a.lvm")


KINDS: dict[str, Callable[[Path], tuple[Path, list[Words]]]] = {
    made.__name__: made
    for made in (
        recording, foreign_recording, working, plan, mapping, model, description, moves, parameters, mat5, mat5_plain, mat73,
        universal, universal_binary, tdms, csv, wav, check, frf, diagnose, fleet, describe, npz, npy, as_json, hdf5, lvm,
    )
}  # fmt: skip
#: Those that people write: they are also changed word by word.
WRITTEN = {"plan", "mapping", "model", "description", "moves", "parameters", "universal", "csv", "describe", "as_json", "lvm"}
#: Those whose sound input is refused: nothing listens at the port, or the runs are too short.
UNSOUND = {"plan", "diagnose"}
TOKENS = (
    "nan", "inf", "-1", "0", "1e308", "-1e308", "1e-320", "99999999999999999999", '""', '"../../x"', "[]", "{}", "true", "null",
    '"\\u0000"', "[[[[[[[[[[1]]]]]]]]]]", "1979-05-27T07:32:00Z", "'", '"', "=", "\x00", "é", "-", "1_000", "0x10", "1e400",
)  # fmt: skip


def damaged(content: bytes, random: np.random.Generator, *, written: bool) -> bytes:
    """The content with something changed."""
    if written and random.random() < 0.7:
        return reworded(content, random)
    data = bytearray(content)
    n = len(data)
    for _ in range(1 if random.random() < 0.6 else int(random.integers(2, 4))):
        at, size = int(random.integers(0, max(len(data), 1))), int(2 ** random.uniform(0, np.log2(max(n // 4, 2))))
        match int(random.integers(9)):
            case 0 | 1:
                for _ in range(int(random.integers(1, 9))):
                    place = int(random.integers(0, max(len(data), 1)))
                    data[place : place + 1] = bytes([random.integers(256)])
            case 2:
                del data[at:]
            case 3:
                del data[at : at + size]
            case 4:
                data[at:at] = data[at : at + size]
            case 5:
                data[at : at + size] = bytes(size)
            case 6:
                data[at : at + size] = random.bytes(size)
            case 7:
                # A size or a place, as large as it gets or moved a little.
                width = (1, 2, 4, 8)[int(random.integers(4))]
                value = (0, 1, 2 ** (8 * width) - 1, 2 ** (8 * width - 1) - 1, 2 ** (4 * width))[int(random.integers(5))]
                data[at : at + width] = value.to_bytes(width, "little")
            case _:
                other = int(random.integers(0, max(len(data), 1)))
                data[at : at + size] = data[other : other + size]
    return bytes(data)


def reworded(content: bytes, random: np.random.Generator) -> bytes:
    """A text with words, numbers or lines exchanged."""
    words = re.split(r"(\s+|[=,:\[\]{}\"])", content.decode("utf-8", "replace"))
    places = [k for k, word in enumerate(words) if word.strip()]
    for _ in range(1 if random.random() < 0.6 else int(random.integers(2, 4))):
        at = places[int(random.integers(len(places)))]
        match int(random.integers(5)):
            case 0 | 1:
                words[at] = TOKENS[int(random.integers(len(TOKENS)))]
            case 2:
                words[at] = ""
            case 3:
                words[at] = words[places[int(random.integers(len(places)))]]
            case _:
                words[at] *= int(random.choice([2, 50, 2000]))
    return "".join(words).encode("utf-8", "replace")


def allocated() -> int:
    """Bytes of address space of this process."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def tried(words: Words, folder: Path, patience: int) -> tuple[int, str, float]:
    """Run a command in a forked process: its exit status (None's stand-in -99 where it did not end), what it said, seconds."""
    begun = time.monotonic()
    ready = set(sys.modules)
    limit = allocated() + MEMORY
    child = os.fork()
    if child == 0:
        status = 70
        try:
            os.chdir(folder)
            said = os.open(folder / ".said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(os.open(folder / ".told", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
            os.dup2(said, 2)
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (patience, patience))
            warnings.simplefilter("ignore")
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            status = cli.main(words)
            (folder / ".loaded").write_text("\n".join(name for name in sys.modules if name not in ready))
        except BaseException:
            os.write(2, traceback.format_exc().encode())
            status = 70
        finally:
            sys.stderr.flush()
            os._exit(status)
    while time.monotonic() - begun < CLOCK:
        pid, how = os.waitpid(child, os.WNOHANG)
        if pid:
            said = (folder / ".said").read_text(errors="replace")
            return os.waitstatus_to_exitcode(how), said, time.monotonic() - begun
        time.sleep(0.002)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -99, "it did not end", time.monotonic() - begun


def imported(folder: Path) -> None:
    """Import what the last command imported, for those that follow."""
    with contextlib.suppress(FileNotFoundError):
        for name in (folder / ".loaded").read_text().split():
            with contextlib.suppress(Exception):
                importlib.import_module(name)
    # Pages that no collection touches are shared by all forks.
    gc.freeze()


def wrong(kind: str, status: int, said: str, folder: Path, before: dict[str, bytes]) -> str | None:  # noqa: PLR0911
    """What is wrong with how a command ended; None where nothing is."""
    if status not in (0, 2):
        return "hang" if status in (-99, -signal.SIGXCPU, -signal.SIGKILL) else f"status {status}"
    if "the program failed" in (folder / ".told").read_text(errors="replace"):
        return "a failure that was reported as an answer"
    if "Traceback" in said or (status == 2 and (not said.startswith("rig: ") or said.count("\n") != 1)):
        return "not one line"
    after = {path.name for path in folder.iterdir()} - set(OWN)
    if extra := [name for name in after - set(before) if not name.startswith("out")]:
        return f"files outside of the output: {extra}"
    if status == 2 and (left := [name for name in after if name.startswith("out")]):
        return f"half a result: {left}"
    if any((folder / name).read_bytes() != content for name, content in before.items()):
        return "an input was changed"
    if kind == "working" and status == 0:
        for run in read(folder / "out.h5").runs:
            ticks = np.arange(len(run))
            for gap in run.gaps:
                ticks[ticks >= gap.first_tick] += gap.count
            if any(not np.array_equal(run.channels[name].samples[:], ticks * 4 + k) for k, name in enumerate("abcd")):
                return "wrong values"
    return None


def fuzz(kind: str, count: int, seed: int, folder: Path) -> Counter[str]:
    """Try so many inputs of a kind; how they ended."""
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.redirect_stdout(io.StringIO()):
        path, calls = KINDS[kind](folder)
    content = path.read_bytes()
    before = {item.name: item.read_bytes() for item in folder.iterdir()}
    if kind not in UNSOUND:
        # What is sound is accepted.
        status, said, _ = tried([word.replace("FILE", path.name) for word in calls[0]], folder, 60)
        assert status == 0, said
        imported(folder)
        clean(folder, before)
    ended: Counter[str] = Counter()
    for k in range(count):
        if over.is_set():
            break
        random = np.random.default_rng([seed, k])
        bad = damaged(content, random, written=kind in WRITTEN)
        path.write_bytes(bad)
        words = [word.replace("FILE", path.name) for word in calls[k % len(calls)]]
        status, said, seconds = tried(words, folder, LONGER.get(kind, USUAL))
        told = wrong(kind, status, said, folder, before | {path.name: bad})
        if told is not None:
            print(json.dumps({"kind": kind, "case": k, "call": words, "wrong": told, "said": said[-1500:], "seconds": seconds}))
            (folder.parent / f"{kind}-{seed}-{k}{path.suffix}").write_bytes(bad)
        ended["wrong" if told is not None else "accepted" if status == 0 else "refused"] += 1
        imported(folder)
        clean(folder, before)
    return ended


def clean(folder: Path, kept: Iterable[str]) -> None:
    """Remove what a command left."""
    for item in folder.iterdir():
        if item.name not in kept:
            remove(item)


def remove(item: Path) -> None:
    """Remove a file or a folder of files."""
    if item.is_dir():
        for inner in item.iterdir():
            remove(inner)
        item.rmdir()
    else:
        item.unlink()


if __name__ == "__main__":
    ASKED, SEED, FOLDER = sys.argv[1:]
    signal.signal(signal.SIGTERM, lambda number, frame: over.set())
    for WORD in ASKED.split(","):
        KIND, COUNT = WORD.split("=")
        print(json.dumps({"kind": KIND, **fuzz(KIND, int(COUNT), int(SEED), Path(FOLDER).resolve() / KIND)}), flush=True)
