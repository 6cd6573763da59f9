"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

Output = Annotated[Path, Parameter(name=["-o", "--output"])]
#: An option that is not given as --no-...
Flag = Annotated[bool, Parameter(negative=())]
