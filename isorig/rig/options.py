"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def _no_file(_: object, path: Path) -> None:
    if path.is_file():
        raise ValueError("It is a file; give the name of a folder, which is created if it does not exist.")


Output = Annotated[Path, Parameter(name=["-o", "--output"])]
#: A folder for several results.
OutputFolder = Annotated[Path, Parameter(name=["-o", "--output"], validator=_no_file)]
#: An option that is not given as --no-...
Flag = Annotated[bool, Parameter(negative=())]
