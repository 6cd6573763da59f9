"""The page on the framed stream: what it shows in C is compiled and measured with."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tty
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from isorig.drivers.framed import FramedInstrument, FramedSettings

ROOT = Path(__file__).resolve().parents[2]


def test_the_instrument_in_c_speaks_the_protocol(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler here")
    page = (ROOT / "docs" / "stream.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```text\n(#include.*?)^```", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "instrument.c").write_text(code)
    binary = tmp_path / "instrument"
    call = [compiler, "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O1", "-o", binary, tmp_path / "instrument.c"]
    subprocess.run(call, check=True, timeout=60)
    own, other = os.openpty()
    tty.setraw(other)
    with subprocess.Popen([binary], stdin=own, stdout=own) as process:
        try:
            with closing(FramedInstrument(os.ttyname(other), FramedSettings())) as instrument:
                assert instrument.identity == "counter"
                assert [(i.unit, i.per_count, i.full_scale, i.dtype) for i in instrument.inputs] == [
                    ("V", 1e-3, 10.0, "int16")
                ] * 2
                assert instrument.prepare(sample_rate=4000.0, channels=[0, 1]) == 4000.0
                assert instrument.set_configuration("locked") is False
                assert instrument.load_drive(np.ones(1000)) is False
                instrument.set_gain(2.5)
                instrument.start()
                blocks = [block for _ in range(60) if (block := instrument.read(0.1)) is not None]
                counted = instrument.stop()
                while (block := instrument.read(0.1)) is not None:
                    blocks.append(block)
        finally:
            process.kill()
    os.close(own)
    os.close(other)
    ticks = np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks])
    np.testing.assert_array_equal(ticks, np.arange(counted or 0))
    samples = np.concatenate([block.samples for block in blocks])
    np.testing.assert_array_equal(samples, np.stack([ticks % 1000, ticks % 1000 + 1000], axis=1))
    assert {block.gain for block in blocks} == {2.5}
    assert blocks[4].device_time == pytest.approx(4 * 64 / 4000.0)
