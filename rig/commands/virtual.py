"""rig virtual: a rig that exists in this program alone, as a recording or behind an instrument's port."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

app = App(name="virtual", help="A rig that exists in this program alone, as a recording or behind an instrument's port.")


@app.command
def campaign(
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    model: Path | None = None,
    seed: int = 0,
    noise: float = 1e-3,
    session: Literal["first", "later"] = "first",
) -> None:
    """Play a whole session on a virtual rig: three gains unlocked, two locked, a series of moves.

    Example: rig virtual campaign -o campaign.h5 --seed 1

    Parameters
    ----------
    output
        The recording to write.
    model
        A model.json; the thesis's wire bonder where absent.
    seed
        Seed of drives and noise.
    noise
        Standard deviation of every sensor's noise, m/s^2.
    session
        The first session, or other runs measured later on the same rig.
    """
    from analysis.rigs import wire_bonder
    from rig.models import read_model
    from rig.recording import write
    from rig.virtual import LATER, SESSION, virtual_campaign

    rig = read_model(model)[0] if model is not None else wire_bonder()
    write(output, virtual_campaign(rig, SESSION if session == "first" else LATER, noise=noise, seed=seed))
    print(output)


@app.command
def instrument(
    *,
    kind: Literal["framed", "di1100", "mti600", "sr785", "35670a"] = "framed",
    model: Path | None = None,
    seed: int = 0,
    noise: float = 1e-3,
    speed: float | None = None,
    seconds: float = 3600.0,
    drop: float = 0.0,
    duplicate: float = 0.0,
    corrupt: float = 0.0,
    stall: float = 0.0,
    overload: float = 0.0,
    unplug_after: float | None = None,
    turn_after: float | None = None,
    first_tick: int = 0,
    ppm: float = 0.0,
    tcp: bool = False,
) -> None:
    """Start a simulated instrument with a virtual rig behind it on a pseudo-terminal, and print its port.

    It speaks the protocol of its kind, so rig acquire --port, or any program that speaks it, can measure with it. A framed
    instrument plays the drive it is given; behind the others the rig is shaken by a drive of its own, at speed 1 unless told
    otherwise.

    Example: rig virtual instrument --kind di1100

    Parameters
    ----------
    kind
        framed, di1100, mti600 (behind a serial CAN adapter), sr785 or 35670a.
    model
        A model.json of the rig; the thesis's wire bonder where absent.
    seed
        Seed of noise and faults.
    noise
        Standard deviation of every sensor's noise, m/s^2.
    speed
        Signal seconds per second; as fast as the wire takes it where absent.
    seconds
        How long it stays.
    drop, duplicate, corrupt, stall, overload
        Probability per frame that it is not sent, sent twice, hurt, late, or tells of an overload; of a DI-1100, which has no
        frames, drop is the probability that half of a second's scans are not sent.
    unplug_after, turn_after
        Signal seconds after which the wire is cut; after which the gain is turned up by a tenth.
    first_tick
        Where the instrument's counter begins, to see it wrap.
    ppm
        How much faster than told its clock runs, parts per million.
    tcp
        Listen on a TCP port of this machine instead of a pseudo-terminal, for machines that have none.

    A fault (from drop to ppm) that an instrument of that kind cannot have is refused.
    """
    from analysis.rigs import wire_bonder
    from drivers.simulated.faults import Faults
    from drivers.simulated.framed import SimulatedFramed
    from drivers.simulated.served import TcpWire, exchange
    from drivers.simulated.wire import PtyWire
    from rig.acquire.far_ends import far_end
    from rig.acquire.plant import VirtualPlant
    from rig.models import read_model

    rig = read_model(model)[0] if model is not None else wire_bonder()
    faults = Faults(
        drop=drop, duplicate=duplicate, corrupt=corrupt, stall=stall, overload=overload, unplug_after=unplug_after,
        turn_after=turn_after, first_tick=first_tick, ppm=ppm, seed=seed,
    )  # fmt: skip
    if kind == "framed":
        wire = TcpWire() if tcp else PtyWire()
        print(wire.port, flush=True)
        SimulatedFramed(wire, VirtualPlant(rig, noise=noise, seed=seed), faults=faults, speed=speed).serve(seconds)
        return
    peer = far_end(kind, rig, noise=noise, seed=seed, speed=speed or 1.0, seconds=min(seconds, 600.0), faults=faults)
    wire = TcpWire() if tcp else PtyWire()
    print(wire.port, flush=True)
    end = time.monotonic() + seconds
    exchange(wire, peer, lambda: time.monotonic() > end)
