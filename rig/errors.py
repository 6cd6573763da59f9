"""The exceptions of the application, and all that a command turns into one sentence.

::

    RigError
    ├── RecordingError  (ValueError)  a file that is not a recording, or a damaged one
    ├── PlanError       (ValueError)  a plan, mapping or description file that cannot be used
    ├── OutputError     (OSError)     a result that could not be written
    └── TimeLimitError  (TimeoutError)  work that took longer than it was given
    analysis.errors.AnalysisError     the science layer's tree
    drivers.errors.DriverError        the instrument layer's tree

`REFUSALS` holds the roots: the command line prints such an error as one sentence and exits with status 2.
"""

from isorig.analysis.errors import AnalysisError
from isorig.drivers.errors import DriverError


class RigError(Exception):
    """Anything that the application refuses.

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
    """Work that took longer than it was given."""


REFUSALS = (RigError, AnalysisError, DriverError)
