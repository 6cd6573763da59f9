"""A virtual rig, as a recording or as a simulated instrument."""

import time
from contextlib import closing
from pathlib import Path
from typing import Literal

from cyclopts import App

from isorig.rig.options import Output

virtual = App(name="virtual", help="A virtual rig, as a recording or as a simulated instrument.")


@virtual.command
def campaign(
    *,
    output: Output,
    model: str | None = None,
    seed: int = 0,
    noise: float = 1e-3,
    seconds: float | None = None,
    session: Literal["first", "later"] = "first",
    hide: str | None = None,
    size: float = 1.0,
) -> None:
    """Simulate a whole session on a virtual rig.

    For the wire bonder: three gains unlocked, two locked, a series of moves. For another rig: three runs in every configuration,
    with the usual drive of its description.

    Example: rig virtual campaign -o campaign.h5 --seed 1

    Parameters
    ----------
    output
        The recording to write.
    model
        A description in .toml, the name of one that rig describe lists, or a model.json; by default the thesis's wire bonder.
    seed
        Random seed of drives and noise.
    noise
        Standard deviation of every sensor's noise: for the wire bonder in m/s^2, for another rig as a share of the channel's rms.
    seconds
        Length of a run, s, for rigs other than the wire bonder; by default as in the description.
    session
        The first session, or other runs measured later on the same rig.
    hide
        An effect hidden in the rig: a cause of the catalogue, e.g. end_stop, "outside: hose" or another effect outside
        the catalogue, or "two". The seed determines its place and parameters.
    size
        Relative size of the effect; 1 is full size.
    """
    from isorig.analysis.parameters.joint_fit import is_wire_bonder
    from isorig.rig.errors import PlanError
    from isorig.rig.files.recording import write
    from isorig.rig.files.rigfile import read_rig
    from isorig.rig.virtual.simulated_recording import described_campaign
    from isorig.rig.wire_bonder.effects import campaign_with, hidden_in
    from isorig.rig.wire_bonder.session import LATER, SESSION

    given = read_rig(model or "wire-bonder")
    if is_wire_bonder(given.model):
        takes = SESSION if session == "first" else LATER
        simulated = campaign_with(hidden_in(given.model, hide, size, seed), takes, seed, noise)
    elif hide is not None or session != "first":
        raise PlanError(f"--hide and --session are available for the wire bonder only; omit them for {given.model.name}")
    else:
        simulated = described_campaign(given, seed=seed, noise=noise, seconds=seconds)
    write(output, simulated)
    print(output)


@virtual.command
def instrument(
    *,
    kind: str = "framed",
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
    hide: str | None = None,
    size: float = 1.0,
) -> None:
    """Start a simulated instrument, connected to a virtual rig, on a pseudo-terminal, and print its port.

    It uses the protocol of its kind, so rig acquire --port, or any program with that protocol, can measure with it. A framed
    instrument plays the drive that it receives; the other kinds measure a rig with a random drive, at speed 1 unless another is
    given. A fault (from drop to ppm) that an instrument of that kind does not support is refused.

    Example: rig virtual instrument --kind di1100

    Parameters
    ----------
    kind
        framed, di1100, mti600 (with a serial CAN adapter), sr785, 35670a, or another kind with a simulated counterpart.
    model
        A model.json of the rig; by default the thesis's wire bonder.
    seed
        Random seed of noise and faults.
    noise
        Standard deviation of each sensor's noise, m/s^2.
    speed
        Speed relative to real time; by default as fast as the connection allows.
    seconds
        Duration of the service.
    drop
        Probability per frame that it is not sent; for a DI-1100, which has no frames, that half of a second's scans are not sent.
    duplicate
        Probability per frame that it is sent twice.
    corrupt
        Probability per frame that it is damaged.
    stall
        Probability per frame that it is late.
    overload
        Probability per frame that it reports an overload.
    unplug_after
        Seconds of signal after which the connection is cut.
    turn_after
        Seconds of signal after which the gain is increased by a tenth.
    first_tick
        Initial value of the instrument's counter, to test its wrapping.
    ppm
        Rate error of its clock, parts per million.
    tcp
        Listen on a TCP port of the loopback interface instead of a pseudo-terminal, for systems that have none.
    hide
        An effect hidden in the rig of a framed instrument; as for rig virtual campaign.
    size
        Its size.
    """
    from isorig.drivers.simulated.commanded import Faults
    from isorig.drivers.simulated.served import PtyWire, TcpWire, exchange
    from isorig.rig.acquire.simulated_instruments import far_end
    from isorig.rig.errors import RigError
    from isorig.rig.files.rigfile import read_model
    from isorig.rig.process.interrupts import ended_by_signals
    from isorig.rig.wire_bonder.description import wire_bonder
    from isorig.rig.wire_bonder.effects import hidden_in

    rig = read_model(model)[0] if model is not None else wire_bonder()
    faults = Faults(
        drop=drop, duplicate=duplicate, corrupt=corrupt, stall=stall, overload=overload, unplug_after=unplug_after,
        turn_after=turn_after, first_tick=first_tick, ppm=ppm, seed=seed,
    )  # fmt: skip
    if hide is not None and kind != "framed":
        raise RigError(f"--hide needs an instrument that plays a drive; {kind} does not, so use --kind framed")
    peer = far_end(
        kind, rig, noise=noise, seed=seed, speed=speed, seconds=min(seconds, 600.0), faults=faults,
        hidden=hidden_in(rig, hide, size, seed),
    )  # fmt: skip
    with ended_by_signals(), closing(TcpWire() if tcp else PtyWire()) as wire:
        print(wire.port, flush=True)
        end = time.monotonic() + seconds
        exchange(wire, peer, lambda: time.monotonic() > end)
