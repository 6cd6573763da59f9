"""`python -m isorig` is the same as `rig`."""

import sys

from isorig.rig.cli import main

if __name__ == "__main__":
    sys.exit(main())
