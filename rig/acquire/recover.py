"""A working file read back: what was measured of each planned run, whether the session ended well or was killed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np

from analysis.measured import Campaign, Channel, Gap, Run
from drivers.block import Status
from rig.acquire.recorder import DONE, RUNNING
from rig.errors import RecordingError

#: Datasets of a run that are no channel.
LEDGERS = frozenset({"gaps", "timing", "progress"})
#: A streamed gain that moves by more than this share of itself is kept beside the samples.
GAIN_MOVED = 1e-5


@dataclass(frozen=True, kw_only=True)
class Recovered:
    """One planned run: its samples where there are any, whether it was finished, ticks stored and lost, blocks overloaded."""

    id: str
    finished: bool
    begun: bool
    run: Run | None
    stored: int
    lost: int
    overloads: int
    drift_ppm: float | None

    @property
    def text(self) -> str:
        """What was saved and lost, in a sentence."""
        if not self.begun:
            return f"{self.id}: not begun."
        state = "whole" if self.finished else "broken off"
        lost = f", {self.lost} lost on the way" if self.lost else ", none lost"
        return f"{self.id}: {state}, {self.stored} samples saved{lost}."


def read_working(path: Path) -> tuple[dict[str, float | str], list[Recovered]]:
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
            f"{path} is no working file ({str(error).splitlines()[0]}); give one that ends in .partial"
        ) from None
    with file:
        if "runs" not in file or any("progress" not in group for group in file["runs"].values()):
            raise RecordingError(f"{path} is no working file; a finished recording needs no recovery, use rig check")
        known = {key: value if isinstance(value, str) else float(value) for key, value in file["rig"].attrs.items()}
        return known, [recovered(group, name) for name, group in file["runs"].items()]


def recovered(group: h5py.Group, name: str) -> Recovered:
    """What a working file holds of one run."""
    progress = group["progress"][0]
    names = [key for key in group if key not in LEDGERS]
    # A writer that was killed may have stored one channel's block and not the next's.
    stored = min(len(group[key]) for key in names)
    gaps = tuple(Gap(first_tick=int(row["first_tick"]), count=int(row["count"])) for row in group["gaps"][:])
    run = None
    if stored > 0:
        attrs = group.attrs
        channels = {}
        gains = _gains(group["timing"][:], stored, gaps)
        for key in names:
            about = group[key].attrs
            channels[key] = Channel(
                name=key, samples=group[key][:stored], quantity=about["quantity"], unit=about["unit"],
                scale=float(about["scale"]), offset=float(about["offset"]),
                full_scale=float(about["range"]) if "range" in about else None,
            )  # fmt: skip
        gain = float(attrs["gain"])
        if gains is not None:
            gain = float(np.median(gains))
            if np.ptp(gains) > GAIN_MOVED * abs(gain):
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
        lost=sum(gap.count for gap in gaps), overloads=int((group["timing"]["status"] & Status.OVERLOAD).astype(bool).sum()),
        drift_ppm=_drift(group["timing"][:], float(progress["sample_rate"])),
    )  # fmt: skip


def _gains(timing: np.ndarray, stored: int, gaps: Sequence[Gap]) -> np.ndarray | None:
    # The streamed gain of each stored sample; None where the instrument streams none.
    timing = timing[np.isfinite(timing["gain"])]
    if not len(timing):
        return None
    ticks = np.arange(stored, dtype=np.int64)
    for gap in gaps:
        ticks[ticks >= gap.first_tick] += gap.count
    block = np.clip(np.searchsorted(timing["tick"], ticks, side="right") - 1, 0, None)
    return np.asarray(timing["gain"][block])


def _drift(timing: np.ndarray, rate: float) -> float | None:
    # How much faster the device counts than the host's clock says. Blocks come late, never early: in each sixteenth of the run
    # the earliest is taken, and a line laid through these. Ticks that were lost are counted, so that loss is no drift.
    if len(timing) < 64 or rate <= 0.0:
        return None
    host = timing["host_time"] - timing["host_time"][0]
    late = host - (timing["tick"] - timing["tick"][0]) / rate
    first = [part[np.argmin(late[part])] for part in np.array_split(np.arange(len(timing)), 16)]
    slope = float(np.polyfit(host[first], late[first], 1)[0]) if host[-1] > 1.0 else -np.inf
    ppm = -1e6 * slope
    # A virtual rig that plays faster than real time has no such clock.
    return ppm if abs(ppm) < 1e5 else None


def campaign_of(known: dict[str, float | str], runs: Sequence[Run], source: str) -> Campaign:
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
