"""Where the engine puts its large data for Blender: in memory, or in a folder on disk where there is little memory for files.

In containers `/dev/shm` often has 64 MB. Nothing of Blender is here.
"""

from __future__ import annotations

import pathlib
import shutil

# Where systems have files in memory.
MEMORY = pathlib.Path("/dev/shm")

# The number of bytes that must be free there: two answers of some million triangles, and what is at the inputs.
ROOM = 512 << 20


def has_room() -> bool:
    """Returns true if files in memory have room for meshes, or if the system has no such files."""
    try:
        return shutil.disk_usage(MEMORY).free >= ROOM
    except OSError:
        return True


def is_unwritten(why: str, folder: pathlib.Path | None) -> bool:
    """Returns true if the engine could not put a value into the folder: then it says which file it could not write."""
    return folder is not None and why.startswith(str(folder))
