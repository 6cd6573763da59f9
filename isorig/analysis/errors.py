"""The exceptions of the science layer.

::

    AnalysisError
    ├── ModelError        (ValueError)    a rig's description contradicts itself or physics
    ├── DataError         (ValueError)    measured data that are not suitable for the requested result
    ├── SimulationError   (ArithmeticError)  a simulation that grew without bound or lost its accuracy
    ├── FitError          (ArithmeticError)  a fit without a usable result
    ├── OutOfTimeError    (TimeoutError)  the caller's time limit has been reached
    └── ArgumentError     (TypeError)     an argument that the function does not take

Every message is one sentence: what was found, what is allowed, what to do.
"""


class AnalysisError(Exception):
    """Any error of the science layer.

    Examples
    --------
    >>> import isorig as iso
    >>> try:
    ...     iso.wire_bonder().get("bodies.motor.colour")
    ... except iso.AnalysisError as refusal:
    ...     print(type(refusal).__name__)
    ModelError
    """


class ModelError(AnalysisError, ValueError):
    """A rig's description contradicts itself or physics."""


class DataError(AnalysisError, ValueError):
    """Measured data that are not suitable for the requested result."""


class SimulationError(AnalysisError, ArithmeticError):
    """A simulation that grew without bound or lost its accuracy."""


class FitError(AnalysisError, ArithmeticError):
    """A fit without a usable result."""


class OutOfTimeError(AnalysisError, TimeoutError):
    """The caller's time limit has been reached (`analysis/deadline.py`)."""


class ArgumentError(AnalysisError, TypeError):
    """An argument that the function does not take."""
