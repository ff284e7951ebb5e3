"""`python -m isosample` is the command `isosample`."""

from __future__ import annotations

import sys

from isosample.cli import main

if __name__ == "__main__":
    sys.exit(main())
