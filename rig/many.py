"""Many campaigns: diagnosed side by side through Dask, what is done skipped, one summary of all."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

import msgspec

from analysis.parallel import cores
from rig.baseline import Baseline
from rig.errors import REFUSALS, RigError

LOOPBACK = "127.0.0.1:0"


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the summary; `refusal` says why a recording could not be used, and is empty where it could."""

    campaign: str
    verdict: str = ""
    causes: str = ""
    locations: str = ""
    holdout_baseline: float | None = None
    holdout_extended: float | None = None
    noise_floor: float | None = None
    refusal: str = ""


def diagnose_file(file: Path, folder: Path, baseline: Baseline, tell: Callable[[str], None] = lambda text: None) -> Outcome:
    """Diagnose one recording into a folder.

    Raises
    ------
    RigError, AnalysisError
        Where the recording cannot be used; nothing is written then.
    """
    from analysis.diagnose.diagnosis import diagnose
    from rig.baseline import baseline_model
    from rig.findings import write_findings
    from rig.recording import read

    tell("reading")
    campaign = read(file)
    found = diagnose(campaign, baseline_model(campaign, baseline), progress=tell)
    tell("writing the report")
    write_findings(folder, found, campaign, {"baseline": baseline, **fingerprint(file)})
    return _outcome(folder)


def diagnose_files(
    jobs: Sequence[tuple[Path, Path]], baseline: Baseline, *, scheduler: str | None = None, again: bool = False
) -> Iterator[Outcome]:
    """Diagnose recordings into a folder each, yielding outcomes as they come; those already answered come first.

    Parameters
    ----------
    jobs
        Recording and folder.
    baseline
        Name of the baseline.
    scheduler
        Address of a Dask scheduler whose workers see the same files; threads of this process where None.
    again
        Whether to diagnose what has an answer already.
    """
    import dask
    from dask.distributed import Client, as_completed

    left = []
    for file, folder in jobs:
        if not again and _answered(file, folder, baseline):
            yield _outcome(folder)
        else:
            left.append((file, folder))
    if not left:
        return
    # Within the process; what still listens, listens to this machine alone.
    own = {
        "processes": False, "n_workers": 1, "threads_per_worker": cores(),
        "dashboard_address": LOOPBACK, "worker_dashboard_address": LOOPBACK,
    }  # fmt: skip
    # Its worker cannot die alone; a computer that sleeps must not make it look dead.
    with (
        dask.config.set({"distributed.scheduler.worker-ttl": None}),
        Client(scheduler) if scheduler else Client(**own) as client,
    ):
        futures = client.map(_answer, [(str(f.resolve()), str(d.resolve()), baseline) for f, d in left], pure=False)
        for future in as_completed(futures):
            yield future.result()


def _answer(job: tuple[str, str, Baseline]) -> Outcome:
    file, folder, baseline = job
    try:
        return diagnose_file(Path(file), Path(folder), baseline)
    except REFUSALS as refusal:
        return Outcome(campaign=Path(file).stem, verdict="refused", refusal=str(refusal))


def fingerprint(file: Path) -> dict[str, str]:
    """Where a result came from: the recording's name and hash, and the version of this program."""
    digest = hashlib.file_digest(file.open("rb"), "sha256").hexdigest()
    return {"recording": file.name, "sha256": digest, "version": version("isorig")}


def _answered(file: Path, folder: Path, baseline: Baseline) -> bool:
    try:
        found = msgspec.json.decode((folder / "findings.json").read_bytes())
        return bool(found["origin"] == {"baseline": baseline, **fingerprint(file)})
    except (OSError, msgspec.DecodeError, KeyError, TypeError):
        return False


def _outcome(folder: Path) -> Outcome:
    found = msgspec.json.decode((folder / "findings.json").read_bytes())
    return Outcome(
        campaign=Path(found["origin"]["recording"]).stem, verdict=found["verdict"],
        causes="+".join(step["cause"] for step in found["steps"]),
        locations="+".join(step["location"] for step in found["steps"]),
        holdout_baseline=found["holdout"]["baseline"], holdout_extended=found["holdout"]["extended"],
        noise_floor=found["holdout"]["noise_floor"],
    )  # fmt: skip


def summary(outcomes: Sequence[Outcome]) -> str:
    """The summary of many campaigns as CSV, in the order of their names."""
    text = io.StringIO()
    table = csv.DictWriter(text, Outcome.__struct_fields__, lineterminator="\n")
    table.writeheader()
    table.writerows(msgspec.structs.asdict(o) for o in sorted(outcomes, key=lambda o: o.campaign))
    return text.getvalue()


def recordings_in(given: Sequence[Path]) -> list[Path]:
    """The recordings that were named, a folder standing for all of its .h5 files.

    Raises
    ------
    RigError
        Where there is none, or two have the same name.
    """
    files = [f for place in given for f in (sorted(place.glob("*.h5")) if place.is_dir() else [place])]
    if not files:
        raise RigError("no recording was given; name a file, or a folder that holds .h5 files")
    names = [file.stem for file in files]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RigError(f"two recordings are named {twice!r}; rename one, because each answer goes to a folder of that name")
    return files
