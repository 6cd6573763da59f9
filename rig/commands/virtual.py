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
    model: str | None = None,
    seed: int = 0,
    noise: float = 1e-3,
    seconds: float | None = None,
    session: Literal["first", "later"] = "first",
    hide: str | None = None,
    size: float = 1.0,
) -> None:
    """Simulate a whole session on a virtual rig.

    Of the wire bonder: three gains unlocked, two locked, a series of moves. Of another rig: three runs in every configuration,
    driven as its description says in usual.

    Example: rig virtual campaign -o campaign.h5 --seed 1

    Parameters
    ----------
    output
        The recording to write.
    model
        A description in .toml, the name of one that rig describe lists, or a model.json; the thesis's wire bonder where absent.
    seed
        Seed of drives and noise.
    noise
        Standard deviation of every sensor's noise: of the wire bonder in m/s^2, of another rig as a share of the channel's rms.
    seconds
        Length of a run of another rig than the wire bonder; as its description says where absent.
    session
        The first session, or other runs measured later on the same rig.
    hide
        An effect that is hidden in the rig: a cause of the catalogue such as end_stop, "outside: hose" or another that no
        catalogue names, or "two". The seed draws its place and numbers.
    size
        Size of the effect; 1 is full size.
    """
    from isorig.analysis.model.built_in import wire_bonder
    from isorig.analysis.parameters.joint_fit import is_wire_bonder
    from isorig.rig.errors import PlanError
    from isorig.rig.files.recording import write
    from isorig.rig.files.rigfile import GivenRig, read_rig
    from isorig.rig.virtual.campaign import LATER, SESSION
    from isorig.rig.virtual.described import described_campaign
    from isorig.rig.virtual.effects import hidden_in, played

    given = GivenRig(model=wire_bonder()) if model is None else read_rig(model)
    rig = given.model
    if not is_wire_bonder(rig):
        if hide is not None or session != "first":
            raise PlanError(f"--hide and --session are of the wire bonder; {rig.name} has neither, so leave them out")
        write(output, described_campaign(given, seed=seed, noise=noise, seconds=seconds))
        print(output)
        return
    write(output, played(hidden_in(rig, hide, size, seed), SESSION if session == "first" else LATER, seed, noise))
    print(output)


@app.command
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
    """Start a simulated instrument with a virtual rig behind it on a pseudo-terminal, and print its port.

    It speaks the protocol of its kind, so rig acquire --port, or any program that speaks it, can measure with it. A framed
    instrument plays the drive it is given; behind the others the rig is shaken by a drive of its own, at speed 1 unless told
    otherwise.

    Example: rig virtual instrument --kind di1100

    Parameters
    ----------
    kind
        framed, di1100, mti600 (behind a serial CAN adapter), sr785, 35670a, or another kind whose far end is simulated.
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
    hide, size
        An effect that is hidden in the rig behind a framed instrument, and its size; as of rig virtual campaign.

    A fault (from drop to ppm) that an instrument of that kind cannot have is refused.
    """
    from isorig.analysis.model.built_in import wire_bonder
    from isorig.drivers.simulated.faults import Faults
    from isorig.drivers.simulated.framed import SimulatedFramed
    from isorig.drivers.simulated.served import TcpWire, exchange
    from isorig.drivers.simulated.wire import PtyWire
    from isorig.rig.acquire.far_ends import PLAYS, far_end
    from isorig.rig.acquire.plant import VirtualPlant
    from isorig.rig.errors import RigError
    from isorig.rig.files.models import read_model
    from isorig.rig.virtual.effects import hidden_in

    rig = read_model(model)[0] if model is not None else wire_bonder()
    faults = Faults(
        drop=drop, duplicate=duplicate, corrupt=corrupt, stall=stall, overload=overload, unplug_after=unplug_after,
        turn_after=turn_after, first_tick=first_tick, ppm=ppm, seed=seed,
    )  # fmt: skip
    if kind == PLAYS:
        wire = TcpWire() if tcp else PtyWire()
        print(wire.port, flush=True)
        plant = VirtualPlant(rig, noise=noise, seed=seed, hidden=hidden_in(rig, hide, size, seed))
        SimulatedFramed(wire, plant, faults=faults, speed=speed).serve(seconds)
        return
    if hide is not None:
        raise RigError(f"--hide needs an instrument that plays a drive; a {kind} plays none, so choose framed")
    peer = far_end(kind, rig, noise=noise, seed=seed, speed=speed or 1.0, seconds=min(seconds, 600.0), faults=faults)
    wire = TcpWire() if tcp else PtyWire()
    print(wire.port, flush=True)
    end = time.monotonic() + seconds
    exchange(wire, peer, lambda: time.monotonic() > end)
