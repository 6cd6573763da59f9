"""Lists what is connected, and proposes a plan for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from isorig.rig.options import Flag, Output

if TYPE_CHECKING:
    from isorig.drivers.kinds import Connected


def instruments(
    *,
    draft: Flag = False,
    output: Output | None = None,
    kind: str | None = None,
    port: str | None = None,
    ask: Flag = False,
    json: Flag = False,
) -> None:
    """List what is connected to this computer, and the kind of instrument that would serve each.

    Searched are serial ports with their USB names, VISA resources, CAN interfaces, NI devices and sound interfaces. Nothing is
    sent to an instrument, except with --ask. With --draft, a plan for the recognized instrument is written, or for that of
    --port and --kind.

    Example: rig instruments --draft -o session.toml, then: rig acquire session.toml -o campaign.h5

    Parameters
    ----------
    draft
        Write a plan with the table of the instrument, its channels and one run, to be corrected.
    output
        The plan to write.
    kind
        The kind of instrument, as in plans.
    port
        Its port, as in plans; virtual is a simulated instrument.
    ask
        Ask VISA resources for their names (*IDN?).
    json
        Print one JSON object per line on standard output.
    """
    from isorig.drivers.connected import connected, with_identity
    from isorig.drivers.kinds import Connected, kinds
    from isorig.rig.acquire.plan_draft import draft_plan
    from isorig.rig.errors import OutputError, PlanError
    from isorig.rig.files.output import write_text

    if draft != (output is not None):
        raise PlanError("--draft writes a plan, so give it with -o session.toml, and -o with --draft")
    if output is not None and output.exists():
        raise OutputError(f"{output} already exists; give another -o")
    if draft and kind is not None and port is not None:
        if kind not in kinds():
            raise PlanError(f"there is no kind of instrument {kind!r}; there are {', '.join(kinds())}")
        chosen, name = Connected(bus=kinds()[kind].buses[0], port=port, name=""), kind
    else:
        found, reasons = connected()
        found = [with_identity(one) if ask and one.bus == "visa" else one for one in found if port in (None, one.port)]
        if not draft:
            _listed(found, reasons, json=json)
            return
        chosen, name = _chosen(found, kind, named=port is not None)
    assert output is not None
    write_text(output, draft_plan(chosen, name))
    print(output)


def _chosen(found: Sequence[Connected], kind: str | None, *, named: bool) -> tuple[Connected, str]:
    from isorig.rig.errors import PlanError

    def names(one: Connected) -> Sequence[str]:
        if kind is not None:
            return [name for name in one.possible if name == kind]
        # A sound interface that was not named is seldom the instrument.
        return one.possible if named and len(one.possible) == 1 else one.recognized

    fitting = [(one, name) for one in found for name in names(one)]
    if len(fitting) == 1:
        return fitting[0]
    listed = ", ".join(f"{name} at {one.port}" for one, name in fitting) or "none"
    raise PlanError(f"the instrument to plan with is not clear (found: {listed}); give --port and --kind")


def _listed(found: Sequence[Connected], reasons: Sequence[str], *, json: bool) -> None:
    import json as text

    for one in found:
        if json:
            about = {"bus": one.bus, "port": one.port, "name": one.name, "recognized": one.recognized, "possible": one.possible}
            print(text.dumps(about, ensure_ascii=False))
            continue
        served = ", ".join(one.recognized) or f"one of {', '.join(one.possible)}"
        print(f"{one.bus:6}  {one.port}  {one.name}\n        kind: {served}")
    if json:
        return
    if not found:
        print("nothing is connected that an instrument could be")
    for reason in reasons:
        print(f"not searched: {reason}")
