"""What is connected to this computer: serial ports, VISA resources, CAN interfaces, NI devices, sound interfaces."""

import logging
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace

from isorig.drivers.errors import DriverError, SettingError, brief
from isorig.drivers.kinds import Connected
from isorig.drivers.ni import devices as ni_devices
from isorig.drivers.sound import devices as sound_devices

#: Interfaces of python-can that are no hardware, serial ports, or servers on the network that are awaited for seconds.
NO_HARDWARE = ("virtual", "udp_multicast", "serial", "slcan", "socketcand")
#: Resources that are also listed as serial ports, or are adapters.
LISTED_ELSEWHERE = ("ASRL", "PRLGX")


def connected() -> tuple[list[Connected], list[str]]:
    """All that is connected, and for each bus that cannot be searched a sentence with the reason."""
    searches = (serial_ports, visa_resources, can_interfaces, ni_devices, sound_devices)
    found: list[Connected] = []
    reasons: list[str] = []
    # Side by side: some wait for answers, others load libraries.
    with _quiet(), ThreadPoolExecutor(len(searches)) as pool:
        for searched in [pool.submit(search) for search in searches]:
            try:
                found += searched.result()
            except SettingError as error:
                reasons.append(str(error))
    return found, reasons


def with_identity(one: Connected) -> Connected:
    """The same with the answer of a VISA resource to `*IDN?` as its name, if it answers."""
    from isorig.drivers.link import linked

    try:
        with closing(linked(one.port, baud_rate=9600)) as link:
            link.send("*IDN?")
            name = link.line().strip().decode("ascii", "replace")
    except DriverError:
        return one
    return replace(one, name=name) if name else one


def serial_ports() -> list[Connected]:
    """Serial ports, with their USB names and numbers."""
    from serial.tools import list_ports

    found = []
    for port in sorted(list_ports.comports()):
        usb = "" if port.vid is None else f"USB {port.vid:04x}:{port.pid:04x}"
        number = f"serial number {port.serial_number}" if port.serial_number else ""
        about = [port.manufacturer or "", port.description if port.description != "n/a" else "", usb, number]
        found.append(Connected(bus="serial", port=port.device, name=" ".join(part for part in about if part)))
    return found


def visa_resources() -> list[Connected]:
    """VISA resources other than serial ports."""
    from isorig.drivers.visa import manager

    opened = manager()
    try:
        names = opened.list_resources("?*::INSTR")
    except Exception as error:
        if "RSRC_NFOUND" in str(error):
            return []
        raise SettingError(f"VISA resources cannot be listed ({brief(error)}); check the backend of PyVISA") from None
    finally:
        opened.close()
    return [Connected(bus="visa", port=name, name="") for name in names if not name.upper().startswith(LISTED_ELSEWHERE)]


def can_interfaces() -> list[Connected]:
    """Interfaces that python-can detects."""
    import can

    found = can.detect_available_configs(sorted(can.VALID_INTERFACES - set(NO_HARDWARE)))
    return [
        Connected(
            bus="can", port=str(one["channel"]), name=f"CAN interface {one['interface']}",
            settings={"bus": one["interface"]},
        )
        for one in found
    ]  # fmt: skip


@contextmanager
def _quiet() -> Iterator[None]:
    # The libraries log what they do not find, which is no error here.
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
