"""The exceptions of the instrument layer. Every message is one sentence: what was found, what is allowed, what to do."""


class DriverError(Exception):
    """Any error of the instrument layer."""


class ConnectionLostError(DriverError, ConnectionError):
    """The instrument is gone: unplugged, powered off or closed."""


class ProtocolError(DriverError, ValueError):
    """The instrument sent something that its protocol does not allow."""


class InstrumentError(DriverError, RuntimeError):
    """The instrument reports a fault."""


class SettingError(DriverError, ValueError):
    """A setting that the instrument does not have."""


def brief(error: Exception) -> str:
    """The message of a library for a sentence: its first paragraph, in one line; further ones repeat the call and its code."""
    return " ".join((str(error).strip() or type(error).__name__).split("\n\n", maxsplit=1)[0].split())[:200]
