"""The exceptions of the application, and all errors that a command prints as one sentence.

::

    RigError
    ├── RecordingError  (ValueError)  a file that is not a recording, or a damaged one
    ├── PlanError       (ValueError)  a plan, mapping or description file that cannot be used
    ├── OutputError     (OSError)     a result that could not be written
    └── TimeLimitError  (TimeoutError)  work that exceeded its time limit
    analysis.errors.AnalysisError     base of the science layer's errors
    drivers.errors.DriverError        base of the instrument layer's errors

`REFUSALS` contains the base classes: the command line prints such an error as one sentence and exits with status 2.
"""

from isorig.analysis.errors import AnalysisError
from isorig.drivers.errors import DriverError


class RigError(Exception):
    """Any error of the application.

    Examples
    --------
    >>> import isorig as iso
    >>> try:
    ...     iso.read("nothing.h5")
    ... except iso.RigError as refusal:
    ...     print(type(refusal).__name__)
    RecordingError
    """


class RecordingError(RigError, ValueError):
    """A file that is not a recording, or a damaged one."""


class PlanError(RigError, ValueError):
    """A plan, mapping or description file that cannot be used."""


class OutputError(RigError, OSError):
    """A result that could not be written."""


class TimeLimitError(RigError, TimeoutError):
    """Work that exceeded its time limit."""


REFUSALS = (RigError, AnalysisError, DriverError)
