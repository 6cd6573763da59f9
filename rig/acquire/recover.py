"""A working file read back: what was measured of each planned run, whether the session ended well or was killed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.measured import Campaign, Channel, Gap, Run
from drivers.block import Status
from rig.acquire.recorder import DONE, RUNNING
from rig.errors import RecordingError

#: Datasets of a run that are no channel.
LEDGERS = frozenset({"gaps", "timing", "progress"})
#: A streamed gain that moves by more than this share of itself is kept beside the samples.
GAIN_MOVED = 1e-5


@dataclass(frozen=True, kw_only=True)
class Drift:
    """How much faster the instrument's clock runs than this machine's, and the standard deviation, parts per million."""

    ppm: float
    std: float

    @property
    def sure(self) -> bool:
        """Whether it is more than the arrival times scatter."""
        return abs(self.ppm) > 3.0 * self.std


class Saved:
    """The first `stored` samples of a channel that may be growing; read from disk by slice."""

    def __init__(self, dataset: h5py.Dataset, stored: int) -> None:
        self._dataset = dataset
        self.shape = (stored,)

    def __getitem__(self, key: slice, /) -> NDArray[Any]:
        return np.asarray(self._dataset[slice(*key.indices(self.shape[0]))])


@dataclass(frozen=True, kw_only=True)
class Recovered:
    """One planned run as far as it got.

    Parameters
    ----------
    id
        Its name.
    finished, begun
        Whether it was taken to its end, whether at all.
    run
        Its samples, read from the open file as they are asked for; None where there are none.
    stored, lost, planned
        Ticks that are in the file, that were lost on the way, that the plan asks for.
    overloads
        Blocks that came with an overload.
    planned_gain
        The gain that the plan says; the run has the one that the instrument streamed.
    drift
        Of the instrument's clock against this machine's; None where it cannot be told.
    ledger
        The run's group, with what a recording keeps beside the samples.
    """

    id: str
    finished: bool
    begun: bool
    run: Run | None
    stored: int
    lost: int
    planned: int
    overloads: int
    planned_gain: float
    drift: Drift | None
    ledger: h5py.Group | None = None

    @property
    def text(self) -> str:
        """What was saved and lost, in a sentence."""
        if not self.begun:
            return f"{self.id}: not begun."
        lost = f", {self.lost} lost on the way" if self.lost else ", none lost"
        if self.finished:
            return f"{self.id}: whole, {self.stored} samples saved{lost}."
        return f"{self.id}: broken off, {self.stored} of {self.planned} samples saved{lost}."


@contextmanager
def working(path: Path) -> Iterator[tuple[dict[str, float | str], list[Recovered]]]:
    """What is known of the rig, and every planned run, from a working file that is finished, being written, or was left behind.

    Raises
    ------
    RecordingError
        Where the file is no working file.
    """
    try:
        # This mode needs no clean end of the writer.
        file = h5py.File(path, "r", libver="latest", swmr=True)
    except FileNotFoundError:
        raise RecordingError(f"{path} does not exist; give the working file of a session (its name ends in .partial)") from None
    except OSError as error:
        raise RecordingError(
            f"{path} is no working file ({str(error).splitlines()[0]}); give one that ends in .partial, or remove it where its "
            "session was killed before the first sample"
        ) from None
    with file:
        if "runs" not in file or any("progress" not in group for group in file["runs"].values()):
            raise RecordingError(f"{path} is no working file; a finished recording needs no recovery, use rig check")
        known = {key: value if isinstance(value, str) else float(value) for key, value in file["rig"].attrs.items()}
        yield known, [recovered(group, name) for name, group in file["runs"].items()]


def recovered(group: h5py.Group, name: str) -> Recovered:
    """What a working file holds of one run."""
    progress = group["progress"][0]
    names = [key for key in group if key not in LEDGERS]
    # A writer that was killed may have stored one channel's block and not the next's.
    stored = min(len(group[key]) for key in names)
    gaps = tuple(Gap(first_tick=int(row["first_tick"]), count=int(row["count"])) for row in group["gaps"][:])
    timing = group["timing"][:]
    run = None
    if stored > 0:
        attrs = group.attrs
        channels = {}
        for key in names:
            about = group[key].attrs
            channels[key] = Channel(
                name=key, samples=Saved(group[key], stored), quantity=about["quantity"], unit=about["unit"],
                scale=float(about["scale"]), offset=float(about["offset"]),
                full_scale=float(about["range"]) if "range" in about else None,
            )  # fmt: skip
        gain, streamed = float(attrs["gain"]), timing["gain"][np.isfinite(timing["gain"])]
        if len(streamed):
            gain = float(np.median(streamed))
            if np.ptp(streamed) > GAIN_MOVED * abs(gain):
                gains = _gains(timing, stored, gaps)
                gain = float(np.median(gains))
                channels["gain"] = Channel(name="gain", samples=gains, quantity="gain", unit="1")
        run = Run(
            id=name, configuration=attrs["configuration"], sample_rate=float(progress["sample_rate"]), gain=gain,
            channels=channels, excitation=attrs["excitation"], use=attrs["use"],
            started=datetime.fromtimestamp(int(progress["started_ns"]) / 1e9, UTC),
            band=tuple(float(f) for f in attrs["band"]) if "band" in attrs else None,  # type: ignore[arg-type]
            period=int(progress["period"]) or None, gaps=gaps,
        )  # fmt: skip
    return Recovered(
        id=name, finished=bool(progress["state"] == DONE), begun=bool(progress["state"] >= RUNNING), run=run, stored=stored,
        lost=sum(gap.count for gap in gaps), planned=int(group.attrs["planned"]), planned_gain=float(group.attrs["gain"]),
        ledger=group, overloads=int((timing["status"] & Status.OVERLOAD).astype(bool).sum()),
        drift=_drift(timing, float(progress["sample_rate"])),
    )  # fmt: skip


def _gains(timing: np.ndarray, stored: int, gaps: Sequence[Gap]) -> NDArray[np.float64]:
    # The streamed gain of each stored sample.
    timing = timing[np.isfinite(timing["gain"])]
    # Gaps are in the order of their ticks: behind each, a sample is that much later than its index says.
    late = np.cumsum([0, *(gap.count for gap in gaps)], dtype=np.int64)
    behind = np.array([gap.first_tick for gap in gaps], np.int64) - late[:-1]
    index = np.arange(stored, dtype=np.int64)
    ticks = index + late[np.searchsorted(behind, index, side="right")]
    block = np.clip(np.searchsorted(timing["tick"], ticks, side="right") - 1, 0, None)
    return np.asarray(timing["gain"][block])


def _drift(timing: np.ndarray, rate: float) -> Drift | None:
    # Blocks come late, never early: in each sixteenth of the run the earliest is taken, and a line laid through these. Ticks that
    # were lost are counted, so that loss is no drift.
    if len(timing) < 64 or rate <= 0.0:
        return None
    host = timing["host_time"] - timing["host_time"][0]
    if host[-1] < 1.0:
        return None
    late = host - (timing["tick"] - timing["tick"][0]) / rate
    first = [part[np.argmin(late[part])] for part in np.array_split(np.arange(len(timing)), 16)]
    (slope, _), covariance = np.polyfit(host[first], late[first], 1, cov=True)
    # A virtual rig that plays faster than real time has no such clock.
    return Drift(ppm=-1e6 * float(slope), std=1e6 * float(np.sqrt(covariance[0, 0]))) if abs(slope) < 0.1 else None


def campaign_of(known: Mapping[str, float | str], runs: Sequence[Run], source: str) -> Campaign:
    """The campaign that runs amount to, in the order in which they were taken.

    Raises
    ------
    RecordingError
        Where there is none.
    """
    if not runs:
        raise RecordingError(f"{source} holds not one sample; there is nothing to recover, so acquire again")
    description = known.get("description")
    return Campaign(
        runs=tuple(sorted(runs, key=lambda run: run.started or datetime.max.replace(tzinfo=UTC))),
        known={key: value for key, value in known.items() if not isinstance(value, str)},
        description=description if isinstance(description, str) else None, source=source,
    )  # fmt: skip
