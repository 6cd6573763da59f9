"""python -m thesis FOLDER: writes thesis.md and pictures/thesis-*.png into a folder."""

from __future__ import annotations

import sys
from pathlib import Path

from isorig.rig.files.output import write_text
from isorig.rig.frf.figures import save
from thesis.page import PREFACE, steps
from thesis.step import markdown


def main() -> None:
    """Write the page and its pictures."""
    folder = Path(sys.argv[1]) if len(sys.argv) == 2 else Path("docs")
    found = steps(tell=lambda text: print(text, file=sys.stderr, flush=True))
    for step in found:
        for name, figure in step.pictures.items():
            save(figure, folder / "pictures" / f"thesis-{name}.png")
    print(write_text(folder / "thesis.md", markdown(found, PREFACE)))


if __name__ == "__main__":
    main()
