"""`python -m lanelib` is the command line."""

import sys

from lanelib.cli import main

if __name__ == "__main__":
    sys.exit(main())
