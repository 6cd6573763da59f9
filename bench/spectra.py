"""CPU and memory of transfer functions with coherence, compared: 600 s at 25.6 kHz, 1 input, 4 outputs, 8192-point segments.

Run `python bench/spectra.py`; the peers come with the extra `bench`. Each method runs in a separate process, so that its peak
memory is measured separately; its CPU time is the shortest of its repetitions. Memory is the peak above the loaded record (for
the recording on disk: above the process before it opened the file).
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import scipy.signal
from table import Row, keep, options, within

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.spectra.welch import estimate
from isorig.analysis.spectra.windows import HANN
from isorig.rig.files.recording import open_recording

RATE, LENGTH, SECONDS, QUICK = 25600.0, 8192, 600, 120
NAMES = ("head", "a", "b", "c", "d")
LIMIT_CPU, LIMIT_MEMORY = 1.8, 32.0


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


METHODS: dict[str, tuple[Callable[[FloatArray], float], int]] = {
    "rfft alone": (transform_alone, 3),
    "isorig": (ours, 3),
    "pyFRF, no copy": (pyfrf, 1),
    "scipy csd + welch": (csd_and_welch, 1),
    "scipy welch, csd, coherence": (coherence_pairwise, 1),
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
    """CPU seconds and MB of a method, in this process."""
    if name.startswith("isorig from disk"):
        return from_disk(float(name.split()[-2]))
    method, repeats = METHODS[name]
    data = record(seconds)
    method(data[:, : 4 * LENGTH])  # what is imported and planned once is not counted
    before = peak()
    cpu = min(method(data) for _ in range(repeats))
    return {"cpu": cpu, "memory": peak() - before}


def main(seconds: int) -> list[Row]:
    """Print the table."""
    names = (*METHODS, f"isorig from disk, {seconds // 10} s", f"isorig from disk, {seconds} s")
    calls = {name: [sys.executable, __file__, name, str(seconds)] for name in names}
    done = {name: subprocess.run(call, check=True, stdout=subprocess.PIPE, text=True) for name, call in calls.items()}
    rows = {name: json.loads(each.stdout) for name, each in done.items()}
    alone = rows["rfft alone"]["cpu"]
    print(f"{seconds} s at {RATE:g} Hz, {len(NAMES)} channels, {LENGTH}-point Hann segments, half overlap, float64")
    print(f"{'method':30s} {'CPU s':>8s} {'/ rfft':>8s} {'MB above':>9s}")
    for name, row in rows.items():
        print(f"{name:30s} {row['cpu']:8.2f} {row['cpu'] / alone:8.2f} {row['memory']:9.1f}")
    ours = rows["isorig"]
    limit = within(ours["cpu"] / alone, LIMIT_CPU, "times the transform alone")
    kept = [Row(what="time", unit="s", ours=ours["cpu"], peer="the transform alone", theirs=alone, limit=limit)]
    for name in list(METHODS)[2:]:
        kept.append(Row(what="time", unit="s", ours=ours["cpu"], peer=name, theirs=rows[name]["cpu"]))
        kept.append(Row(what="memory above the record", unit="MB", ours=ours["memory"], peer=name, theirs=rows[name]["memory"]))
    for name in names[-2:]:
        memory = rows[name]["memory"]
        what = name.replace("isorig ", "memory, ")
        kept.append(Row(what=what, unit="MB", ours=memory, limit=within(memory, LIMIT_MEMORY, "MB")))
    print("\n".join(f"{row.what}: {row.limit}" for row in kept if row.limit))
    return kept


if __name__ == "__main__":
    if len(sys.argv) == 1 or sys.argv[1].startswith("-"):
        given = options(__doc__).parse_args()
        keep(main(QUICK if given.quick else SECONDS), given.rows)
    elif sys.argv[1] == "write":
        write(float(sys.argv[2]), sys.argv[3])
    else:
        print(json.dumps(measured(sys.argv[1], float(sys.argv[2]))))
