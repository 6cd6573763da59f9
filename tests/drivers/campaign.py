"""Faults by chance for every driver: what becomes of each is right, told, refused, or (what must not be) wrong in silence.

Each fault is one connection to a far end of `far`, whose samples say when they were taken.
"""

from __future__ import annotations

import random
import struct
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from far import DataqFar, FramedFar, LinesFar, SlcanFar, frame, scan_bytes, text_frame

from isorig.drivers.block import Block, Status
from isorig.drivers.dataq import DataqInstrument, DataqSettings
from isorig.drivers.errors import DriverError
from isorig.drivers.framed import FramedInstrument
from isorig.drivers.hp35670a import Hp35670aInstrument
from isorig.drivers.mti600 import MtiInstrument
from isorig.drivers.shows import Shows
from isorig.drivers.sr785 import Sr785Instrument

#: Seconds that a fault may take at most, with the patience that tests set.
LONGEST = 10.0
#: Scans of a DI-1100 by which nothing that is lost here can displace another.
NEVER = 300
ODD = Status.DISAGREES | Status.RESYNCED | Status.CLOCKED | Status.FAULT


@dataclass
class Outcome:
    """What became of faults: how many of each outcome, and the details of those that must not be."""

    counts: Counter[str] = field(default_factory=Counter)
    bad: list[str] = field(default_factory=list)

    def add(self, what: str, outcome: str) -> None:
        self.counts[outcome] += 1
        if outcome in ("silent", "traceback", "hang"):
            self.bad.append(f"{outcome}: {what}")


def run(driver: str, faults: int, seed: int) -> Outcome:
    """So many faults on a driver."""
    outcome = Outcome()
    for k in range(faults):
        draw = random.Random(f"{driver} {seed} {k}")
        what, attempt = ATTEMPTS[driver](draw)
        began = time.monotonic()
        try:
            result = attempt()
        except DriverError as refusal:
            result = "traceback" if "\n" in str(refusal) else "refused"
        except Exception as error:
            result = "traceback"
            what += f" {type(error).__name__} {error}"
        if time.monotonic() - began > LONGEST:
            result = "hang"
        outcome.add(f"{k} {what}", result)
    return outcome


def judged(wrong: int, flagged: bool) -> str:
    """The outcome of a run whose samples were compared with what they say of themselves."""
    if wrong:
        return "told" if flagged else "silent"
    return "right"


# The framed stream


def garbage(draw: random.Random) -> bytes:
    """Something else than an answer."""
    return draw.choice(
        [
            b"", b"\0\xff", b"nan", b"-1", b"1e999", b"9" * 23, b"0x10", b"1_000", b"inf", b"ERR", b"a b c d e f",
            b"manual none", "ü".encode(), b"1;2", b"1 2", b"x" * 400, bytes(draw.randrange(256) for _ in range(30)),
        ]
    )  # fmt: skip


def framed_answer(draw: random.Random) -> tuple[str, Callable[[], str]]:
    word = draw.choice(["ID", "INPUTS", "RATE", "GAIN", "CONF", "DRIVE", "START", "STOP", "COUNT"])
    text = garbage(draw)
    first = {"STOP": b"COUNT"}.get(word, word.encode())
    told = draw.choice(
        [text_frame(first + b" " + text), text_frame(text), text, b"", text_frame(first), text_frame(b"ERR " + first + b" no")]
    )
    return f"{word} answered with {told!r}", lambda: framed(FramedFar(answer=lambda asked: told if asked == word else None))


def hurt(kind: str, wire: bytes, step: int, draw: random.Random) -> bytes:
    """What goes onto the wire in place of a frame."""
    place = draw.randrange(len(wire))
    return {
        "drop": b"", "double": 2 * wire, "flip": wire[:place] + bytes([wire[place] ^ 1 << draw.randrange(8)]) + wire[place + 1 :],
        "junk": bytes(draw.randrange(256) for _ in range(step)) + wire, "cut": wire[:place] + wire[place + min(step, 60) :],
    }[kind]  # fmt: skip


def framed_stream(draw: random.Random) -> tuple[str, Callable[[], str]]:
    kind = draw.choice(
        [
            "drop", "double", "swap", "flip", "junk", "cut", "counter jumps", "counter back", "counter reset", "counter stuck",
            "counter 2^31", "sequence reset", "sequence stuck", "sequence jumps", "clock back", "clock jumps", "clock stuck",
            "columns", "type", "no rows", "status", "gain", "restart", "lost inside", "payload", "all stuck",
        ]
    )  # fmt: skip
    at, length, other = draw.randrange(1, 25), draw.randrange(1, 6), random.Random(draw.random())
    step = draw.choice([1, 7, 50, 333, 5000])
    waiting: list[bytes] = []

    def spoil(fields: dict) -> bytes:
        k = fields["sequence"]
        late = k >= at
        now = at <= k < at + length
        fields = dict(fields)
        if kind == "swap" and k == at:
            waiting.append(frame(**fields))
            return b""
        if kind in ("drop", "double", "flip", "junk", "cut") and now:
            return hurt(kind, frame(**fields), step, other)
        change = {
            "counter jumps": late and {"tick": fields["tick"] + step}, "counter back": late and {"tick": fields["tick"] - step},
            "counter reset": late and {"tick": fields["tick"] - 50 * at}, "counter stuck": late and {"tick": 50 * at},
            "counter 2^31": late and {"tick": fields["tick"] + 2**31}, "sequence reset": late and {"sequence": k - at},
            "sequence stuck": late and {"sequence": at}, "sequence jumps": late and {"sequence": k + step},
            "clock back": late and {"clock": fields["clock"] - 1000 * step - 10**6},
            "clock jumps": late and {"clock": fields["clock"] + 1000 * step + 10**6},
            "clock stuck": late and {"clock": 50_000 * at},
            "columns": now and {"columns": 1, "rows": 100}, "type": now and {"kind": 1, "rows": 100},
            "no rows": now and {"rows": 0, "payload": b""}, "status": now and {"status": other.choice([2, 4, 6, 0xFFFF])},
            "gain": now and {"gain": other.choice([float("nan"), float("inf"), 1e30])},
            "restart": late and {"tick": fields["tick"] - 50 * at, "sequence": k - at, "clock": fields["clock"] - 50_000 * at},
            "lost inside": late and {"tick": fields["tick"] + step, "clock": fields["clock"] + 1000 * step},
            "payload": now and {"payload": fields["payload"][:-4]},
            "all stuck": late and {"tick": 50 * at, "clock": 50_000 * at, "sequence": at},
        }.get(kind)  # fmt: skip
        wire = frame(**(fields | (change or {}))) + b"".join(waiting)
        waiting.clear()
        return wire

    moved = step if kind == "lost inside" else 0
    return f"{kind} at {at} for {length}, step {step}", lambda: framed(FramedFar(spoil=spoil), inside=(50 * at, moved))


def framed(far: FramedFar, inside: tuple[int, int] = (0, 0)) -> str:
    """A run of a framed instrument; `inside` is where it lost samples itself, and how many."""
    with far:
        instrument = FramedInstrument(far.port)
        try:
            instrument.prepare(sample_rate=1000.0, channels=[0, 1])
            instrument.set_gain(1.0)
            instrument.set_configuration("locked")
            instrument.load_drive(np.zeros(5))
            instrument.start()
            blocks = read(instrument, 1500)
            counted = instrument.stop()
            blocks += read(instrument, 10**9)
            noticed = list(instrument.noticed)
        finally:
            instrument.close()
    wrong = 0
    for block in blocks:
        true = block.samples[:, 0].astype(np.int64)
        true = true + np.where(true >= inside[0], inside[1], 0)
        wrong += int((true != np.arange(block.first_tick, block.end_tick)).sum())
        assert (block.samples[:, 1] == block.samples[:, 0] * 3 + 1).all() or block.status & ODD
    end = max((block.end_tick for block in blocks), default=0)
    wrong += int(counted is not None and counted < end and not noticed)
    return judged(wrong, bool(noticed) or any(block.status & ODD for block in blocks))


def read(instrument: object, ticks: int, silence: float = 0.3) -> list[Block]:
    """Blocks until so many ticks, or nothing comes."""
    blocks: list[Block] = []
    heard = time.monotonic()
    end = 0
    while end < ticks and time.monotonic() - heard < silence:
        block = instrument.read(0.05)  # type: ignore[attr-defined]
        if block is not None:
            blocks.append(block)
            heard, end = time.monotonic(), block.end_tick
    return blocks


# The DI-1100


def dataq_stream(draw: random.Random) -> tuple[str, Callable[[], str]]:
    kind = draw.choice(["byte lost", "byte doubled", "word lost", "flip", "junk", "cut", "noise", "scans doubled by a byte each"])
    at, count, other = draw.randrange(100, 2500), draw.choice([1, 2, 3, 5, 40, 333]), random.Random(draw.random())
    done: list[int] = []

    def stream(first: int, last: int) -> bytes:
        data = bytearray(scan_bytes(first, last))
        if kind == "noise":
            return bytes(other.randrange(256) for _ in range(len(data)))
        if done or last <= at:
            return bytes(data)
        done.append(at)
        place = other.randrange(len(data))
        if kind == "flip":
            # Bits of a value itself nothing on this wire could show.
            data[place - place % 2] ^= 1 << other.randrange(2, 4)
        elif kind == "junk":
            data[place:place] = bytes(other.randrange(256) for _ in range(count))
        elif kind in ("byte lost", "cut"):
            del data[place : place + (1 if kind == "byte lost" else count)]
        elif kind == "word lost":
            place -= place % 2
            del data[place : place + 2]
        else:
            data[place:place] = data[place : place + 1]
        return bytes(data)

    return f"{kind} at {at}, {count}", lambda: dataq(DataqFar(stream=stream, rate=4000.0, scans=3600))


def dataq_answer(draw: random.Random) -> tuple[str, Callable[[], str]]:
    told = draw.choice([b"", b"\r" * 60, garbage(draw) + b"\r", b"x" * 5000, bytes(draw.randrange(256) for _ in range(900))])
    word = draw.choice(["encode", "slist", "srate", "dec", "deca", "ps"])

    class Odd(DataqFar):
        def say(self, data: bytes) -> None:
            super().say(told if data.startswith(word.encode()) else data)

    return f"{word} echoed with {told[:20]!r}", lambda: dataq(Odd(rate=4000.0, scans=800))


def displaced(samples: np.ndarray, ticks: np.ndarray) -> np.ndarray:
    """Scans between each row's place and those that its values were taken in, the furthest of its inputs."""
    words = samples.astype(np.int64) // 16 - 1365 * np.arange(samples.shape[1])
    return np.abs((words - ticks[:, None] + 2048) % 4096 - 2048).max(axis=1)


def dataq(far: DataqFar) -> str:
    """A run of a DI-1100."""
    with far:
        instrument = DataqInstrument(far.port, DataqSettings(full_scale=10.0))
        try:
            instrument.prepare(sample_rate=4000.0, channels=[0, 1])
            instrument.start()
            end = time.monotonic() + far.scans / 4000.0 + 0.2
            blocks = []
            while time.monotonic() < end:
                block = instrument.read(0.05)
                blocks += [] if block is None else [block]
            instrument.stop()
            blocks += read(instrument, 10**9, 0.1)
            unseen = instrument.unseen * 4000.0
        finally:
            instrument.close()
    given = [np.arange(block.first_tick, block.end_tick) for block in blocks]
    off = np.concatenate([displaced(b.samples, t) for b, t in zip(blocks, given, strict=True)]) if blocks else np.zeros(0)
    # Values that were never sent are wrong whatever is told of them: no fault here loses so many scans. A loss of whole scans,
    # within one or between two, may be as long as the driver tells.
    torn = bool(len(off)) and bool(off.max() > NEVER)
    flagged = any(block.status & ODD for block in blocks) or bool(len(off) and off.max() <= unseen)
    return "silent" if torn else judged(int((off > 0).sum()), flagged)


# The MTi-600


def mti_stream(draw: random.Random) -> tuple[str, Callable[[], str]]:
    kind = draw.choice(
        [
            "drop frame", "drop groups", "double frame", "double groups", "swap", "junk", "no end of line", "counter reset",
            "counter jumps", "counter back", "counter stuck", "clock back", "clock jumps", "clock stuck", "restart", "error",
            "short",
        ]
    )  # fmt: skip
    at, length, step = draw.randrange(40, 900), draw.randrange(1, 30), draw.choice([1, 5, 100, 3000, 40000])
    other = random.Random(draw.random())
    waiting: list[bytes] = []

    def spoil(tick: int, frames: list[bytes]) -> bytes:
        now = at <= tick < at + length
        if kind == "drop frame" and now:
            del frames[other.randrange(4)]
        elif kind == "drop groups" and now:
            return b""
        elif kind == "double frame" and now:
            frames.insert(2, frames[1])
        elif kind == "double groups" and now:
            return 2 * b"".join(frames)
        elif kind == "swap" and tick == at:
            waiting.append(b"".join(frames))
            return b""
        elif kind == "junk" and now:
            frames.insert(2, bytes(other.choice(b"\r\7tTrRdDbB0123456789ABCDEFxyz \xff") for _ in range(step % 200)) + b"\r")
        elif kind == "no end of line" and tick == at:
            return b"t0340" * 4000
        elif kind == "error" and now:
            frames.append(b"t001102\r" if other.random() < 0.5 else b"t001101\r")
        elif kind == "short" and now:
            frames[2] = frames[2][:-5] + b"\r"
        told = b"".join(frames) + b"".join(waiting)
        waiting.clear()
        return told

    def group(tick: int) -> tuple[int, int]:
        clock = round(1e6 * tick / 400.0)
        if tick < at:
            return tick, clock
        return {
            "counter reset": (tick - at, clock), "counter jumps": (tick + step, clock), "counter back": (tick - step, clock),
            "counter stuck": (at, clock), "clock back": (tick, clock - 10**6 - step * 1000),
            "clock jumps": (tick, clock + 10**6 + step * 1000), "clock stuck": (tick, round(1e6 * at / 400.0)),
            "restart": (tick - at, clock - round(1e6 * at / 400.0)),
        }.get(kind, (tick, clock))  # fmt: skip

    return f"{kind} at {at} for {length}, step {step}", lambda: mti(SlcanFar(spoil=spoil, group=group, groups=1200))


def mti(far: SlcanFar) -> str:
    """A run of an MTi-600."""
    with far:
        instrument = MtiInstrument(far.port)
        try:
            instrument.prepare(sample_rate=400.0, channels=[0])
            instrument.start()
            blocks = read(instrument, 1190)
            instrument.stop()
            blocks += read(instrument, 10**9, 0.1)
            noticed = list(instrument.noticed)
        finally:
            instrument.close()
    offset = None
    wrong = 0
    for block in blocks:
        true = block.samples[:, 0].astype(np.int64) + 30000 * block.samples[:, 1]
        given = np.arange(block.first_tick, block.end_tick)
        offset = int(true[0] - given[0]) if offset is None else offset
        wrong += int((true - given != offset).sum())
    return judged(wrong, bool(noticed) or any(block.status & ODD for block in blocks))


# The analyzers

VALUES = np.sin(np.arange(64) * 0.7).astype(np.float32)
PLACES = np.linspace(0.0, 63.0, 64)


def spoiled(draw: random.Random, data: bytes) -> bytes:
    """An answer as it must not be."""
    wire = bytearray(data)
    place = draw.randrange(max(len(wire), 1))
    match draw.choice(["lost", "doubled", "flip", "cut", "long", "empty", "garbage", "no end", "twice"]):
        case "lost":
            del wire[place : place + 1]
        case "doubled":
            wire[place:place] = wire[place : place + 1]
        case "flip" if wire:
            wire[place] ^= 1 << draw.randrange(8)
        case "cut":
            del wire[place:]
        case "long":
            wire += bytes(draw.randrange(256) for _ in range(20_000))
        case "empty":
            wire = bytearray(b"\n")
        case "garbage":
            wire = bytearray(garbage(draw) + b"\n")
        case "no end":
            wire = bytearray(bytes(wire).rstrip(b"\n"))
        case "twice":
            wire += bytes(wire)
    return bytes(wire)


def once(draw: random.Random, answer: bytes | Callable[[str], bytes]) -> Callable[[str], bytes]:
    """The answer, spoiled the first or the second time that it is given, or always."""
    count, which = [0], draw.choice([1, 1, 2, 0])

    def told(command: str) -> bytes:
        count[0] += 1
        right = answer(command) if callable(answer) else answer
        return spoiled(draw, right) if which in (0, count[0]) else right

    return told


def sr785_answer(draw: random.Random) -> tuple[str, Callable[[], str]]:
    answers: dict[str, bytes | Callable[[str], bytes]] = {
        "*ESR?": b"0\n", "INPS?": b"0\n", "DSPS?": b"1\n", "NAVG?": b"10\n", "DSPN?": b"64\n",
        "DBIN?": lambda c: b"%.9g\n" % PLACES[int(c.split(",")[1])], "DSPB?": VALUES.tobytes(),
        "DSPY?": lambda c: b"%.9g\n" % VALUES[int(c.split(",")[1])],
    }  # fmt: skip
    word = draw.choice(list(answers))
    answers[word] = once(draw, answers[word])

    def attempt() -> str:
        with LinesFar(answers) as far:
            instrument = Sr785Instrument(far.port, [Shows(trace="0", kind="time", unit="V")])
            try:
                instrument.measure(1.0)
                (record,) = instrument.records()
            finally:
                instrument.close()
        same = np.array_equal(record.values, VALUES) and np.allclose(record.x, PLACES) and record.averages == 10
        return judged(int(not same), bool(record.status))

    return word, attempt


def hp35670a_answer(draw: random.Random) -> tuple[str, Callable[[], str]]:
    def block(values: np.ndarray) -> bytes:
        data = struct.pack(f">{len(values)}f", *values)
        return b"#3%03d" % len(data) + data + b"\n"

    answers: dict[str, bytes | Callable[[str], bytes]] = {
        "*STB?": b"+32\n", "SYST:ERR?": b'+0,"No Error"\n', "CALC1:X:DATA?": block(PLACES), "CALC1:DATA?": block(VALUES),
    }  # fmt: skip
    word = draw.choice(list(answers))
    answers[word] = once(draw, answers[word])

    def attempt() -> str:
        with LinesFar(answers) as far:
            instrument = Hp35670aInstrument(far.port, [Shows(trace="XTIM:VOLT 1", kind="time", unit="V")])
            try:
                instrument.measure(1.0)
                (record,) = instrument.records()
            finally:
                instrument.close()
        same = np.array_equal(record.values, VALUES) and np.allclose(record.x, PLACES)
        return judged(int(not same), bool(record.status))

    return word, attempt


Attempt = tuple[str, Callable[[], str]]


def mostly(
    often: Callable[[random.Random], Attempt], seldom: Callable[[random.Random], Attempt]
) -> Callable[[random.Random], Attempt]:
    """The first three times of four."""
    return lambda draw: (often if draw.random() < 0.75 else seldom)(draw)


ATTEMPTS: dict[str, Callable[[random.Random], Attempt]] = {
    "framed": mostly(framed_stream, framed_answer), "di1100": mostly(dataq_stream, dataq_answer), "mti600": mti_stream,
    "sr785": sr785_answer, "35670a": hp35670a_answer,
}  # fmt: skip
