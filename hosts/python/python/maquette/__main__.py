"""The whole command line: `python -m maquette run graphs/doll.ron`."""

from __future__ import annotations

import sys

from . import _maquette


def main() -> int:
    """Does what the words on the command line say, and gives the exit code: 0 done, 1 the graph failed, 2 the words are wrong."""
    return _maquette.command_line(["maquette", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
