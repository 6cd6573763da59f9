"""After a power loss nothing is wrong in silence, and nothing that was synced is lost."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from power import ROWS, look_at, write_session, wrong
from ramps import acquire, ticks_of

from isorig.rig.acquire.journal import CHECKSUM, HEAD, HEADER, _block
from isorig.rig.acquire.recover import working
from isorig.rig.cli import main
from isorig.rig.errors import RecordingError
from isorig.rig.files.recording import read


def test_any_image_of_the_disk_is_recovered_without_a_wrong_value(tmp_path: Path) -> None:
    assert sum(look_at(300, tmp_path, seed=0).values()) >= 300


@pytest.mark.study
@pytest.mark.parametrize("seed", range(10))
def test_many_images_of_the_disk(tmp_path: Path, seed: int) -> None:
    seen = look_at(500, tmp_path, seed=100 + 2 * seed)
    print(dict(seen))


def test_every_prefix_of_the_first_blocks(tmp_path: Path) -> None:
    told = write_session(tmp_path / "a.partial", 0)
    path = tmp_path / "image.partial"
    for cut in [*range(0, told.ends[3], 97), *(end + d for end in told.ends[:-1] for d in (-1, 0, 1))]:
        path.write_bytes(told.content[:cut])
        try:
            with working(path) as (_, found):
                assert not wrong(found, ticks_of)
                whole = sum(end <= cut for write, end in enumerate(told.ends) if write in told.held)
                assert sum(item.stored for item in found) == sum(len(ticks) for _, ticks in list(told.held.values())[:whole])
        except RecordingError:
            assert cut < told.ends[0]


def test_a_damaged_first_block_costs_nothing(tmp_path: Path) -> None:
    told = write_session(tmp_path / "a.partial", 0)
    content = bytearray(told.content)
    content[: told.ends[0] // 2] = bytes(told.ends[0] // 2)
    (tmp_path / "a.partial").write_bytes(content)
    with working(tmp_path / "a.partial") as (_, found):
        assert sum(item.stored for item in found) == sum(len(ticks) for _, ticks in told.held.values())
        assert not any(item.damaged for item in found)
        assert all(item.run.started is not None for item in found)


def test_a_damaged_block_is_reported_and_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = write_session(tmp_path / "a.partial", 0)
    write = sorted(told.held)[3]
    name, ticks = told.held[write]
    content = bytearray(told.content)
    content[told.ends[write] - 9] ^= 1
    (tmp_path / "a.partial").write_bytes(content)
    assert main(["recover", str(tmp_path / "a.partial"), "-o", str(tmp_path / "a.h5")]) == 0
    told_of = re.search(r"a: complete, .* lost, up to (\d+) of them in damaged parts of the file", capsys.readouterr().out)
    assert told_of is not None
    # Beside the block there may be a gap of the wire's, which cannot be told from it.
    assert len(ticks) <= int(told_of[1]) < len(ticks) + 4 * ROWS
    run = read(tmp_path / "a.h5").runs[0]
    assert run.id == name == "a"
    assert set(range(2048)) - set(ticks_of(run).tolist()) >= set(ticks)


def test_a_block_that_names_another_run_is_not_filed(tmp_path: Path) -> None:
    told = write_session(tmp_path / "a.partial", 0)
    content = bytearray(told.content)
    moved = [write for write, (name, _) in told.held.items() if name == "a"][3:5]
    for write in moved:
        # A block as the writer would have written it, of the same take, for the run after it; and for one that is not planned.
        begin, end = told.ends[write - 1], told.ends[write]
        _, kind, _, take, number, _, file, offset = HEADER.unpack_from(content, begin)
        run = 1 if write == moved[0] else 7
        content[begin:end] = _block(file, offset, number, kind, run, take, bytes(content[begin + HEAD : end - CHECKSUM.size]))
    (tmp_path / "a.partial").write_bytes(content)
    with working(tmp_path / "a.partial") as (_, found):
        assert not wrong(found, ticks_of)
        missing_ticks = sum(len(told.held[write][1]) for write in moved)
        whole = sum(len(ticks) for name, ticks in told.held.values() if name == "a")
        assert found[0].stored == whole - missing_ticks
        assert found[0].damaged >= missing_ticks
        assert found[1].stored == sum(len(ticks) for name, ticks in told.held.values() if name == "b")


def test_the_recording_is_on_the_disk_before_the_working_file_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ramps import Watcher, plan_of, ramp_instrument

    import isorig.rig.files.output as output_module

    done: list[str] = []
    sync, unlink, replace = output_module._sync, Path.unlink, Path.replace
    monkeypatch.setattr(output_module, "_sync", lambda path: (done.append(f"sync {path.name}"), sync(path)))
    monkeypatch.setattr(Path, "replace", lambda self, to: (done.append(f"replace {to.name}"), replace(self, to))[1])
    monkeypatch.setattr(
        Path, "unlink", lambda self, missing_ok=False: (done.append(f"unlink {self.name}"), unlink(self, missing_ok))[1]
    )
    with ramp_instrument() as (port, _):
        acquire(plan_of({"id": "a", "seconds": 1.0}), port, tmp_path / "c.h5", Watcher().operator, force=True)
    place = done.index("replace c.h5")
    assert done[place - 1].startswith("sync .c.h5.")
    assert done[place + 1] == f"sync {tmp_path.name}"
    assert done.index("unlink c.h5.partial") > place + 1
