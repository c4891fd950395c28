"""The program `gnp`: `gnp --help`, `python -m gnp --help`."""

from __future__ import annotations

import os
import sys

from . import _gnp


def main() -> None:
    """Runs the command of the command line and ends as it does."""
    # Not through sys.exit: the program has its own Ctrl-C and its own words for what goes wrong.
    os._exit(_gnp.main([os.path.basename(sys.argv[0]) or "gnp", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
