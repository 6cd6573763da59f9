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
