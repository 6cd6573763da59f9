"""Faults by chance for every driver: what becomes of each is right, reported, refused, or (what must not be) wrong in silence.

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
import sound_device
from far import CsvFar, DataqFar, FramedFar, LinesFar, PrologixFar, SlcanFar, TcpLines, frame, scan_bytes, text_frame
from ni_device import ANSWERED, Device, chassis
from nidaqmx.errors import DaqError

from isorig.drivers.block import Block, Status
from isorig.drivers.dataq import DataqInstrument, DataqSettings
from isorig.drivers.errors import DriverError
from isorig.drivers.framed import FramedInstrument, FramedSettings
from isorig.drivers.hp35670a import Hp35670aInstrument
from isorig.drivers.lines import Field, LinesInstrument, LinesSettings
from isorig.drivers.mti600 import MtiInstrument, MtiSettings
from isorig.drivers.ni import NiInstrument, NiSettings
from isorig.drivers.sound import SoundInstrument, SoundSettings
from isorig.drivers.sr785 import Sr785Instrument
from isorig.drivers.waits import Waits

#: Seconds that a fault may take at most, with the patience that tests set.
LONGEST = 10.0
#: Scans of a DI-1100 by which nothing that is lost here can displace another.
NEVER = 300
#: Outcomes that must not be.
BAD = ("silent", "traceback", "hang")
ODD = Status.DISAGREES | Status.RESYNCED | Status.CLOCKED | Status.FAULT


@dataclass
class Outcome:
    """What became of faults: how many of each outcome, and the details of those that must not be."""

    counts: Counter[str] = field(default_factory=Counter)
    bad: list[str] = field(default_factory=list)

    def add(self, what: str, outcome: str) -> None:
        self.counts[outcome] += 1
        if outcome in BAD:
            self.bad.append(f"{outcome}: {what}")


#: Far ends of tests answer at once.
SHORT = Waits(answer=0.5, silence=0.5, start=0.5, adapter=0.0, poll=0.01, sound_start=1.0, sound=1.5)


def run(driver: str, faults: int, seed: int) -> Outcome:
    """So many faults on a driver."""
    outcome = Outcome()
    for k in range(faults):
        what, result, seconds = tried(driver, seed, k)
        if seconds > LONGEST and result not in BAD:
            # The host may be busy. A hang is one again.
            result = "hang" if all(tried(driver, seed, k)[2] > LONGEST for _ in range(2)) else "late"
        outcome.add(f"{k} {what}", result)
    return outcome


def tried(driver: str, seed: int, k: int) -> tuple[str, str, float]:
    """One fault: what it is, its outcome, its seconds."""
    what, attempt = ATTEMPTS[driver](random.Random(f"{driver} {seed} {k}"))
    began = time.monotonic()
    try:
        result = attempt()
    except DriverError as refusal:
        result = "traceback" if "\n" in str(refusal) else "refused"
    except Exception as error:
        result = "traceback"
        what += f" {type(error).__name__} {error}"
    return what, result, time.monotonic() - began


def judged(wrong: int, flagged: bool) -> str:
    """The outcome of a run whose samples were compared with what they say of themselves."""
    if wrong:
        return "reported" if flagged else "silent"
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
        instrument = FramedInstrument(far.port, FramedSettings(), SHORT)
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
        instrument = DataqInstrument(far.port, DataqSettings(full_scale=10.0), waits=SHORT)
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
            unseen = instrument._arrivals.unseen * 4000.0
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
        instrument = MtiInstrument(far.port, MtiSettings(), SHORT)
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


# Lines


def lines_stream(draw: random.Random) -> tuple[str, Callable[[], str]]:
    kind = draw.choice(
        [
            "drop", "double", "swap", "flip", "junk", "cut", "merge", "counter back", "counter jumps", "counter reset",
            "clock back", "clock jumps", "clock stuck", "digit lost", "no end of line", "garbage",
        ]
    )  # fmt: skip
    at, length, step = draw.randrange(20, 200), draw.randrange(1, 15), draw.choice([1, 7, 300])
    other, waiting = random.Random(draw.random()), list[bytes]()

    def columns(tick: int) -> list[str]:
        late = tick >= at
        count = {"counter back": tick - step, "counter jumps": tick + step, "counter reset": tick - at}.get(kind, tick)
        clock = {"clock back": tick - 1000 - step, "clock jumps": tick + 1000 + step, "clock stuck": at}.get(kind, tick)
        return [str((count if late else tick) % 65536), str(10 * max(clock if late else tick, 0)), str(tick), str(3 * tick)]

    def spoil(tick: int, line: bytes) -> bytes:
        now, wire = at <= tick < at + length, line + b"\n"
        if kind == "swap" and tick == at:
            waiting.append(wire)
            return b""
        if now and kind in ("drop", "double", "flip", "junk", "cut"):
            wire = hurt(kind, wire, step % 200, other)
        elif now and kind == "merge":
            wire = line
        elif now and kind == "digit lost":
            wire = line[:1] + line[2:] + b"\n"
        elif now and kind == "garbage":
            wire = garbage(other) + b"\n"
        elif tick == at and kind == "no end of line":
            wire = b"1" * 5000
        told = wire + b"".join(waiting)
        waiting.clear()
        return told

    return f"{kind} at {at} for {length}, step {step}", lambda: lines(CsvFar(spoil=spoil, columns=columns, lines=260))


def lines(far: CsvFar) -> str:
    """A run of an instrument of lines. Nothing guards the digits of a value: damaged ones are not judged."""
    fields = (Field(what="count", wrap=65536), Field(what="clock", unit="ms"), Field(), Field())
    with far:
        instrument = LinesInstrument(far.port, LinesSettings(fields=fields, start=("go",), stop=("halt",)), waits=SHORT)
        try:
            instrument.prepare(sample_rate=100.0, channels=[0, 1])
            instrument.start()
            blocks = read(instrument, 250)
            instrument.stop()
            blocks += read(instrument, 10**9, 0.1)
            told = list(instrument.noticed) + ["damaged"] * bool(instrument.damaged)
        finally:
            instrument.close()
    wrong = 0
    for block in blocks:
        whole = block.samples[:, 1] == 3 * block.samples[:, 0]
        wrong += int((whole & (block.samples[:, 0] != np.arange(block.first_tick, block.end_tick))).sum())
    return judged(wrong, bool(told) or any(block.status & ODD for block in blocks))


# NI devices


def ni_call(draw: random.Random) -> tuple[str, Callable[[], str]]:
    kind = draw.choice(["error", "error", "error", "overwritten", "coerced", "late", "gone", "unsupported", "overload"])
    code = draw.choice([-201003, -200279, -200220, -200452, -88705, -200290, -50405, -1])
    name = draw.choice(sorted(ANSWERED))
    when, place = draw.choice([1, 1, 2, 3, 7, 20]), draw.randrange(200, 3000)
    seen: Counter[str] = Counter()

    def fault(call: str) -> None:
        seen[call] += 1
        if call == name and seen[call] >= when:
            raise DaqError(f"Something failed in {call}.\n\nTask Name: here\nStatus Code: {code}", code)

    device = Device(
        fault=fault if kind == "error" else lambda call: None, lost=(place, 500) if kind == "overwritten" else None,
        coerced=1999.0 if kind == "coerced" else None, buffer=700 if kind == "late" else None,
        gone_after=place if kind == "gone" else None, unsupported=kind == "unsupported",
        overload_from=place if kind == "overload" else None,
    )  # fmt: skip
    return f"{kind}: {name} fails with {code} from call {when} on, place {place}", lambda: ni(device)


def ni(device: Device) -> str:
    """A run of an NI device with a drive; the output is at zero at the end, unless the device is gone."""
    settings = NiSettings(
        inputs=("cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1"), output="cDAQ1Mod2/ao0", drive_volts=0.01, tachometer="cDAQ1/_ctr0"
    )  # fmt: skip
    with chassis(device):
        instrument = NiInstrument("cDAQ1", settings)
        try:
            rate = instrument.prepare(sample_rate=2048.0, channels=[0, 1])
            instrument.load_drive(np.full(5000, 10.0))
            instrument.start()
            blocks = read(instrument, 3000)
            counted = instrument.stop()
            blocks += read(instrument, 10**9, 0.1)
            noticed = list(instrument.noticed)
        finally:
            instrument.close()
    wrong = 0
    for block in blocks:
        ticks = np.arange(block.first_tick, block.end_tick)
        wrong += int((block.samples[:, 0] != ticks).sum()) + int((block.samples[:, -1] != ticks // 5).sum())
    wrong += int(counted is not None and bool(blocks) and counted < blocks[-1].end_tick) + int(rate not in (2048.0, 1999.0))
    wrong += int(device.level != 0.0)
    return judged(wrong, bool(noticed) or any(block.status & ODD for block in blocks))


# Sound interfaces


def sound_fault(draw: random.Random) -> tuple[str, Callable[[], str]]:
    kind = draw.choice(["lost", "lost in silence", "slow", "fast", "mute", "silent", "refuses", "gone"])
    place, count = draw.randrange(9000, 14000), draw.choice([300, 800, 2000])
    device = sound_device.Device(
        lost=(place, count) if kind.startswith("lost") else None, told=kind != "lost in silence", silent=kind == "silent",
        clock={"slow": 0.97, "fast": 1.03}.get(kind, 1.0), mute_after=place if kind == "mute" else None,
        refuses=draw.choice(["open", "start"]) if kind == "refuses" else "",
    )  # fmt: skip
    return f"{kind} at {place}, {count}", lambda: sounding(device, kind == "gone")


def sounding(device: sound_device.Device, gone: bool) -> str:
    """A run of a sound interface; its first input counts the samples."""
    with sound_device.card(device):
        instrument = SoundInstrument("card", SoundSettings(full_scale=1.0, output=0, drive_volts=0.001, ramp=0.05), waits=SHORT)
        try:
            instrument.prepare(sample_rate=8000.0, channels=[0, 1])
            instrument.load_drive(np.full(9000, 10.0))
            instrument.start()
            if gone:
                device.gone.set()
            blocks = read(instrument, 12_000, 2.5)
            instrument.stop()
            blocks += read(instrument, 10**9, 0.1)
            unseen, noticed = instrument._arrivals.unseen * 8000.0, list(instrument.noticed)
        finally:
            instrument.close()
    wrong = int(device.level != 0)
    for block in blocks:
        given = np.arange(block.first_tick, block.end_tick) + int(blocks[0].samples[0, 0])
        wrong += int((np.abs(block.samples[:, 0] - given) > max(unseen, 0.05 * 8000.0)).sum())
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


def at_a_wire(draw: random.Random, answers: Answers) -> tuple[LinesFar, Callable[[], str]]:
    """A far end on one of the wires that an analyzer is reached by, and the name that it has in a plan once it is served."""
    wire = draw.choice(["line", "resource", "adapter"])
    if wire == "resource":
        resource = TcpLines(answers)
        return resource, lambda: resource.resource
    if wire == "adapter":
        adapter = PrologixFar(answers, status=lambda: 32)
        return adapter, lambda: f"GPIB::11@{adapter.port}"
    line = LinesFar(answers)
    return line, lambda: line.port


def once(draw: random.Random, answer: bytes | Callable[[str], bytes]) -> Callable[[str], bytes]:
    """The answer, spoiled the first or the second time that it is given, or always."""
    count, which = [0], draw.choice([1, 1, 2, 0])

    def told(command: str) -> bytes:
        count[0] += 1
        right = answer(command) if callable(answer) else answer
        return spoiled(draw, right) if which in (0, count[0]) else right

    return told


Answers = dict[str, bytes | Callable[[str], bytes]]


def analyzer_answer(
    draw: random.Random,
    answers: Answers,
    kind: Callable[..., Sr785Instrument | Hp35670aInstrument],
    trace: str,
    averages: int | None,
) -> tuple[str, Callable[[], str]]:
    """One answer of an analyzer, spoiled; `averages` are those that it reports."""
    word = draw.choice(list(answers))
    answers[word] = once(draw, answers[word])
    far, name = at_a_wire(draw, answers)

    def attempt() -> str:
        with far:
            instrument = kind(name(), [trace], waits=SHORT)
            try:
                instrument.measure(1.0)
                (record,) = instrument.records()
            finally:
                instrument.close()
        same = np.array_equal(record.values, VALUES) and np.allclose(record.x, PLACES) and record.averages == averages
        return judged(int(not same), bool(record.status))

    return f"{word} at {type(far).__name__}", attempt


def sr785_answer(draw: random.Random) -> tuple[str, Callable[[], str]]:
    answers: Answers = {
        "*ESR?": b"0\n", "INPS?": b"0\n", "DSPS?": b"1\n", "NAVG?": b"10\n", "DSPN?": b"64\n",
        "DBIN?": lambda c: b"%.9g\n" % PLACES[int(c.split(",")[1])], "DSPB?": VALUES.tobytes(),
        "DSPY?": lambda c: b"%.9g\n" % VALUES[int(c.split(",")[1])],
    }  # fmt: skip
    return analyzer_answer(draw, answers, Sr785Instrument, "0", 10)


def hp35670a_answer(draw: random.Random) -> tuple[str, Callable[[], str]]:
    def block(values: np.ndarray) -> bytes:
        data = struct.pack(f">{len(values)}f", *values)
        return b"#3%03d" % len(data) + data + b"\n"

    answers: Answers = {
        "*STB?": b"+32\n", "SYST:ERR?": b'+0,"No Error"\n', "CALC1:X:DATA?": block(PLACES), "CALC1:DATA?": block(VALUES),
    }  # fmt: skip
    return analyzer_answer(draw, answers, Hp35670aInstrument, "XTIM:VOLT 1", None)


Attempt = tuple[str, Callable[[], str]]


def mostly(
    often: Callable[[random.Random], Attempt], seldom: Callable[[random.Random], Attempt]
) -> Callable[[random.Random], Attempt]:
    """The first three times of four."""
    return lambda draw: (often if draw.random() < 0.75 else seldom)(draw)


ATTEMPTS: dict[str, Callable[[random.Random], Attempt]] = {
    "framed": mostly(framed_stream, framed_answer), "di1100": mostly(dataq_stream, dataq_answer), "mti600": mti_stream,
    "lines": lines_stream, "nidaqmx": ni_call, "sound": sound_fault,
    "sr785": sr785_answer, "35670a": hp35670a_answer,
}  # fmt: skip
