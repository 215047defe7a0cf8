"""The whole command line: `python -m maquette run graphs/doll.ron`."""

from __future__ import annotations

import sys

from . import _maquette


def main() -> int:
    """Runs the command line and returns its exit code: 0 success, 1 the graph failed, 2 wrong arguments."""
    return _maquette.command_line(["maquette", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
