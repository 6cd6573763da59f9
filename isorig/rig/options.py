"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

Output = Annotated[Path, Parameter(name=["-o", "--output"])]
#: An option that is not given as --no-...
Flag = Annotated[bool, Parameter(negative=())]
#: The wire bonder with Coulomb friction, or without any.
Baseline = Literal["coulomb", "linear"]
#: The wire bonder's values: by the joint fit, or by half-power.
Method = Literal["joint", "half-power"]
