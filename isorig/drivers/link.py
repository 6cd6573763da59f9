"""The connection to an instrument that takes commands: a line, a GPIB adapter, or a VISA resource, with one interface."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from isorig.drivers.port import Port
from isorig.drivers.waits import WAITS, Waits

if TYPE_CHECKING:
    from isorig.drivers.prologix import PrologixLink
    from isorig.drivers.visa import VisaLink

#: Names of VISA resources, and of a GPIB address at an adapter: GPIB::11@/dev/ttyUSB0.
RESOURCE = re.compile(r"(GPIB|TCPIP|USB|ASRL|PXI|VXI)[^@]*::[^@]+", re.IGNORECASE)
ADAPTED = re.compile(r"GPIB\d*::(\d{1,2})(::INSTR)?@(.+)", re.IGNORECASE)


def linked(name: str, *, baud_rate: int, waits: Waits = WAITS) -> Port | PrologixLink | VisaLink:
    """Open the link that a name in a plan denotes; every kind has the methods of a `Port` for commands.

    They raise ConnectionLostError if the instrument is gone or late, ProtocolError if it sends what was not requested.

    Parameters
    ----------
    name
        A path or URL of `isorig.drivers.port`, a VISA resource (GPIB0::11::INSTR), or a GPIB address at a Prologix adapter
        (GPIB::11@/dev/ttyUSB0, GPIB::11@socket://192.168.1.5:1234).
    baud_rate
        Baud rate of a real serial line.
    waits
        Its timeouts.

    Raises
    ------
    SettingError
        The name denotes no port, or the package for VISA is missing.
    ConnectionLostError
        The connection cannot be opened.
    """
    adapted = ADAPTED.fullmatch(name)
    if adapted:
        from isorig.drivers.prologix import PrologixLink

        return PrologixLink(name, port=adapted[3], address=int(adapted[1]), waits=waits)
    if RESOURCE.fullmatch(name):
        from isorig.drivers.visa import VisaLink

        return VisaLink(name, baud_rate=baud_rate, waits=waits)
    return Port(name, baud_rate=baud_rate, waits=waits)
