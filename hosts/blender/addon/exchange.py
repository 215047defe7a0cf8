"""The place of the engine's large data for Blender: files in memory, or a folder on disk if memory has little room for files.

In containers, `/dev/shm` often has only 64 MB. This module does not use Blender.
"""

from __future__ import annotations

import pathlib
import shutil

# The folder of files in memory.
MEMORY = pathlib.Path("/dev/shm")

# The minimum of free bytes: enough for two results of some million triangles and the data of inputs.
ROOM = 512 << 20


def has_room() -> bool:
    """Returns true if files in memory have room for meshes, or if the system has no such files."""
    try:
        return shutil.disk_usage(MEMORY).free >= ROOM
    except OSError:
        return True


def is_unwritten(why: str, folder: pathlib.Path | None) -> bool:
    """Returns true if a message of the engine says that it could not write a file into the folder."""
    return folder is not None and why.startswith(str(folder))
