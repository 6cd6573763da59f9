"""The exceptions of the instrument layer.

::

    DriverError
    ├── ConnectionLostError  (ConnectionError)  the far end is gone: unplugged, powered off, closed
    ├── ProtocolError        (ValueError)       the far end said something that its protocol does not allow
    ├── InstrumentError      (RuntimeError)     the instrument reports a fault of its own
    └── SettingError         (ValueError)       a setting that the instrument does not have

Every message is one sentence: what was found, what is allowed, what to do.
"""


class DriverError(Exception):
    """Anything that the instrument layer refuses."""


class ConnectionLostError(DriverError, ConnectionError):
    """The far end is gone: unplugged, powered off or closed."""


class ProtocolError(DriverError, ValueError):
    """The far end said something that its protocol does not allow."""


class InstrumentError(DriverError, RuntimeError):
    """The instrument reports a fault of its own."""


class SettingError(DriverError, ValueError):
    """A setting that the instrument does not have."""
