"""`python -m rig` is the same as `rig`."""

import sys

from rig.cli import main

sys.exit(main())
