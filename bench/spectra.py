"""CPU and memory of transfer functions with coherence, compared: 600 s at 25.6 kHz, 1 input, 4 outputs, 8192-point segments.

Run `python bench/spectra.py [--quick]`; the peers come with the extra `bench`, and are omitted if they are not installed. Each
method runs in a separate process, so that its peak memory is measured separately; all take turns in each repetition, and medians
count. Memory is the peak above the loaded record (for the recording on disk: above the process before it opened the file).

An hour of 64 channels at 51.2 kHz, whose recording has 47 GB, is extrapolated from two shorter ones: what the longer one takes
more is the time of each further second. Before each call the system drops the file from its cache.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import scipy.signal
from table import Row, alternated, cost_of, keep, options, within

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.spectra.welch import estimate
from isorig.analysis.spectra.windows import HANN
from isorig.rig.files.recording import open_recording

RATE, LENGTH, SECONDS, QUICK = 25600.0, 8192, 600, 120
NAMES = ("head", "a", "b", "c", "d")
LIMIT_CPU, LIMIT_MEMORY = 1.8, 32.0
#: Repetitions of each method, and those with `--quick`.
REPEATS, FEW = 3, 1
#: The recording of many channels: their number, sample rate in Hz, counts per unit, lengths in s, and the length that is
#: extrapolated to. The shorter ones are longer than what the checks of the records read.
MANY, FAST, SCALE, LENGTHS, HOUR = 64, 51200.0, 1e-6, (30.0, 60.0), 3600.0
#: Limits of the time of `rig frf` in times of reading the file, and of the memory in MB that each further second of it needs.
LIMIT_READING, LIMIT_GROWTH = 2.0, 1.0


def record(seconds: float) -> FloatArray:
    """Noise in all channels, shape (5, n)."""
    return np.random.default_rng(0).standard_normal((len(NAMES), round(seconds * RATE)))


def run_of(data: FloatArray) -> Run:
    """A run in memory."""
    channels = {name: Channel(name=name, samples=row) for name, row in zip(NAMES, data, strict=True)}
    return Run(id="bench", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels)


def ours(data: FloatArray) -> float:
    """Our estimate from memory."""
    run = run_of(data)
    start = time.process_time()
    spectra = estimate([run], references=["head"], resolution=RATE / LENGTH)
    for name in NAMES[1:]:
        spectra.frf(name, "head")
    return time.process_time() - start


def transform_alone(data: FloatArray) -> float:
    """rfft of the windowed segments alone: the lower limit of any method."""
    window, block, lines, spent = HANN.samples(LENGTH), np.empty((8, LENGTH)), np.empty((8, LENGTH // 2 + 1), complex), 0.0
    for row in data:
        segments = np.lib.stride_tricks.sliding_window_view(row, LENGTH)[:: LENGTH // 2]
        for first in range(0, len(segments), len(block)):
            part = block[: len(segments[first : first + len(block)])]
            np.multiply(segments[first : first + len(block)], window, out=part)
            start = time.process_time()
            np.fft.rfft(part, axis=1, out=lines[: len(part)])
            spent += time.process_time() - start
    return spent


def pyfrf(data: FloatArray) -> float:
    """pyFRF, without copies."""
    import pyFRF

    start = time.process_time()
    frf = pyFRF.FRF(
        sampling_freq=int(RATE), exc=data[None, :1], resp=data[None, 1:], window="hann", nperseg=LENGTH, fft_len=LENGTH,
        noverlap=LENGTH // 2, copy=False,
    )  # fmt: skip
    frf.get_H1()
    frf.get_coherence()
    return time.process_time() - start


def pydvma(data: FloatArray) -> float:
    """pydvma's transfer functions with coherence."""
    # Its windows are not used.
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from pydvma.analysis import calculate_tf
    from pydvma.datastructure import TimeData
    from pydvma.options import MySettings

    settings = MySettings(channels=len(data), fs=RATE)
    record = TimeData(np.arange(data.shape[1]) / RATE, data.T, settings)
    frames = 2 * data.shape[1] // LENGTH - 1
    start = time.process_time()
    calculate_tf(record, window="hann", N_frames=frames, overlap=0.5)
    return time.process_time() - start


def csd_and_welch(data: FloatArray) -> float:
    """scipy.signal's csd of all channels at once, and welch of all."""
    start = time.process_time()
    _, cross = scipy.signal.csd(data[:1], data[1:], RATE, nperseg=LENGTH)
    _, auto = scipy.signal.welch(data, RATE, nperseg=LENGTH)
    _ = cross / auto[0], np.abs(cross) ** 2 / (auto[0] * auto[1:])
    return time.process_time() - start


def coherence_pairwise(data: FloatArray) -> float:
    """scipy.signal's welch, csd and coherence, pair by pair."""
    start = time.process_time()
    for row in data[1:]:
        _, auto = scipy.signal.welch(data[0], RATE, nperseg=LENGTH)
        _, cross = scipy.signal.csd(data[0], row, RATE, nperseg=LENGTH)
        scipy.signal.coherence(data[0], row, RATE, nperseg=LENGTH)
        _ = cross / auto
    return time.process_time() - start


METHODS: dict[str, Callable[[FloatArray], float]] = {
    "rfft alone": transform_alone,
    "isorig": ours,
    "pyFRF, no copy": pyfrf,
    "pydvma": pydvma,
    "scipy csd + welch": csd_and_welch,
    "scipy welch, csd, coherence": coherence_pairwise,
}


def peak() -> float:
    """Peak memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def from_disk(seconds: float) -> dict[str, float]:
    """Our estimate from a recording on disk that this process did not write."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.h5"
        subprocess.run([sys.executable, __file__, "write", str(seconds), str(path)], check=True)
        ours(record(1.0))  # what is imported and planned once is not counted
        before, start = peak(), time.process_time()
        with open_recording(path) as campaign:
            estimate(campaign.runs, references=["head"], resolution=RATE / LENGTH)
        return {"cpu": time.process_time() - start, "memory": peak() - before}


def write(seconds: float, path: str) -> None:
    """A recording of that length."""
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["format_version"] = "rig-recording", 1
        run = file.create_group("runs/long")
        run.attrs.update(configuration="unlocked", sample_rate=RATE, gain=1.0)
        for name, row in zip(NAMES, record(seconds), strict=True):
            run.create_dataset(name, data=row, chunks=(LENGTH,))


def measured(name: str, seconds: float) -> dict[str, float]:
    """CPU seconds and MB of a method, in this process; nothing if it is not installed."""
    if name.startswith("isorig from disk"):
        return from_disk(float(name.split()[-2]))
    method, data = METHODS[name], record(seconds)
    try:
        method(data[:, : 4 * LENGTH])  # what is imported and planned once is not counted
    except ImportError:
        return {}
    before = peak()
    return {"cpu": method(data), "memory": peak() - before}


def written_many(path: Path, seconds: float) -> None:
    """A recording of many channels in counts."""
    generator, n = np.random.default_rng(0), round(seconds * FAST)
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["format_version"] = "rig-recording", 1
        run = file.create_group("runs/long")
        run.attrs.update(configuration="unlocked", sample_rate=FAST, gain=1.0)
        for k in range(MANY):
            counts = generator.integers(-(2**20), 2**20, n, dtype=np.int32)
            run.create_dataset(f"c{k}", data=counts, chunks=(LENGTH,)).attrs["scale"] = SCALE


def forget(path: Path) -> None:
    """Drop a file from the system's cache, where the system can."""
    if hasattr(os, "posix_fadvise"):
        with path.open("rb") as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def read_many(path: Path) -> float:
    """Seconds to read a recording by h5py, a second of a channel at a time."""
    forget(path)
    began = time.perf_counter()
    with h5py.File(path) as file:
        for channel in file["runs/long"].values():
            for first in range(0, len(channel), round(FAST)):
                channel[first : first + round(FAST)]
    return time.perf_counter() - began


def hour(repeats: int) -> list[Row]:
    """`rig frf` of many channels, and reading their recording, extrapolated to an hour."""
    with tempfile.TemporaryDirectory() as name:
        paths = {seconds: Path(name) / f"{seconds:g}.h5" for seconds in LENGTHS}
        memory: dict[float, list[float]] = {seconds: [] for seconds in LENGTHS}
        for seconds, path in paths.items():
            written_many(path, seconds)

        def estimated(seconds: float) -> float:
            forget(paths[seconds])
            call = ["frf", str(paths[seconds]), "--reference", "c0", "--resolution", f"{FAST / LENGTH}", "-o", f"{name}/frf"]
            cost = cost_of([sys.executable, "-m", "isorig", *call])
            memory[seconds].append(cost.memory)
            return cost.clock

        ways = {("frf", seconds): lambda s=seconds: estimated(s) for seconds in LENGTHS}
        ways |= {("read", seconds): lambda s=seconds: read_many(paths[s]) for seconds in LENGTHS}
        spent = alternated(ways, repeats)
    short, long = LENGTHS

    def extrapolated(way: str) -> list[float]:
        pairs = zip(spent[way, short], spent[way, long], strict=True)
        return [last + (last - first) * (HOUR - long) / (long - short) for first, last in pairs]

    whole, reading = extrapolated("frf"), extrapolated("read")
    ratio = statistics.median(whole) / statistics.median(reading)
    more = (statistics.median(memory[long]) - statistics.median(memory[short])) / (long - short)
    print(f"{MANY} channels at {FAST:g} Hz: `rig frf` of {long:g} s {statistics.median(spent['frf', long]):.1f} s, ", end="")
    print(
        f"of an hour {statistics.median(whole):.0f} s, {ratio:.1f} times reading the file; {more:.2f} MB for each further second"
    )
    what = f"`rig frf` of an hour of {MANY} channels at {FAST / 1e3:g} kHz, extrapolated from {short:g} and {long:g} s"
    return [
        Row.of(what, "s", whole, "reading the file", reading, within(ratio, LIMIT_READING, "times reading the file")),
        Row.of(f"memory of `rig frf` of {long:g} s of them", "MB", memory[long], f"isorig, {short:g} s", memory[short],
               within(more, LIMIT_GROWTH, "MB for each further second")),
    ]  # fmt: skip


def main(seconds: int, repeats: int) -> list[Row]:
    """Print the table."""
    names = (*METHODS, f"isorig from disk, {seconds // 10} s", f"isorig from disk, {seconds} s")
    memory: dict[str, list[float]] = {name: [] for name in names}

    def separate(name: str) -> float:
        call = [sys.executable, __file__, name, str(seconds)]
        found = json.loads(subprocess.run(call, check=True, stdout=subprocess.PIPE, text=True).stdout)
        memory[name].append(found.get("memory", np.nan))
        return float(found.get("cpu", np.nan))

    spent = alternated({name: lambda name=name: separate(name) for name in names}, repeats)
    middle = {name: statistics.median(times) for name, times in spent.items()}
    alone = middle["rfft alone"]
    print(f"{seconds} s at {RATE:g} Hz, {len(NAMES)} channels, {LENGTH}-point Hann segments, half overlap, float64")
    print(f"{'method':30s} {'CPU s':>8s} {'/ rfft':>8s} {'MB above':>9s}")
    for name, cpu in middle.items():
        if np.isnan(cpu):
            print(f"{name:30s} is not installed: left out")
        else:
            print(f"{name:30s} {cpu:8.2f} {cpu / alone:8.2f} {statistics.median(memory[name]):9.1f}")
    own = spent["isorig"]
    limit = within(middle["isorig"] / alone, LIMIT_CPU, "times the transform alone")
    kept = [Row.of("time", "s", own, "the transform alone", spent["rfft alone"], limit)]
    for name in list(METHODS)[2:]:
        if not np.isnan(middle[name]):
            kept.append(Row.of("time", "s", own, name, spent[name]))
            kept.append(Row.of("memory above the record", "MB", memory["isorig"], name, memory[name]))
    for name in names[-2:]:
        within_memory = within(statistics.median(memory[name]), LIMIT_MEMORY, "MB")
        kept.append(Row.of(name.replace("isorig ", "memory, "), "MB", memory[name], limit=within_memory))
    kept += hour(repeats)
    print("\n".join(f"{row.what}: {row.limit}" for row in kept if row.limit))
    return kept


if __name__ == "__main__":
    if len(sys.argv) == 1 or sys.argv[1].startswith("-"):
        given = options(__doc__).parse_args()
        keep(main(QUICK, FEW) if given.quick else main(SECONDS, REPEATS), given.rows)
    elif sys.argv[1] == "write":
        write(float(sys.argv[2]), sys.argv[3])
    else:
        print(json.dumps(measured(sys.argv[1], float(sys.argv[2]))))
