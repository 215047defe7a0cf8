"""The engine's own process: `python -I worker.py FOLDER WORD ..` does what the words say by the module `maquette` of that folder.

An isolated Python sees no module but those of this folder, whatever a user has installed. Nothing of Blender is here.
"""

import sys

if __name__ == "__main__":
    sys.path.insert(0, sys.argv[1])
    sys.argv[:] = ["maquette", *sys.argv[2:]]
    from maquette.__main__ import main

    sys.exit(main())
