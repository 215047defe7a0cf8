"""The engine's process: `python -I worker.py FOLDER ARGUMENT ..` runs the command line of the module `maquette` in that folder.

An isolated Python (`-I`) imports no other modules that a user has installed. This module does not use Blender.
"""

import sys

if __name__ == "__main__":
    sys.path.insert(0, sys.argv[1])
    sys.argv[:] = ["maquette", *sys.argv[2:]]
    from maquette.__main__ import main

    sys.exit(main())
