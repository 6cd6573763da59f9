"""The exceptions of the science layer.

::

    AnalysisError
    ├── ModelError        (ValueError)    a rig's description contradicts itself or physics
    ├── DataError         (ValueError)    measured data that cannot carry the question asked of it
    ├── SimulationError   (ArithmeticError)  a simulation that grew without bound or lost its accuracy
    ├── FitError          (ArithmeticError)  a fit that did not come to a usable end
    └── OutOfTimeError    (TimeoutError)  the time that the caller gave is over

Every message is one sentence: what was found, what is allowed, what to do.
"""


class AnalysisError(Exception):
    """Anything that the science layer refuses.

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
    """Measured data that cannot carry the question asked of it."""


class SimulationError(AnalysisError, ArithmeticError):
    """A simulation that grew without bound or lost its accuracy."""


class FitError(AnalysisError, ArithmeticError):
    """A fit that did not come to a usable end."""


class OutOfTimeError(AnalysisError, TimeoutError):
    """The time that the caller gave is over; raised by the caller's own progress callback."""
