"""``python -m fingerfit``: the command line without an installed script."""

import sys

from fingerfit.cli import main

if __name__ == "__main__":
    sys.exit(main())
