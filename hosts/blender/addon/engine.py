"""The one engine of this Blender: a process of its own, started when it is first needed, and heard by a timer."""

from __future__ import annotations

import importlib.util
import os
import pathlib
import sys
import threading
from typing import Callable

import bpy

from . import exchange
from .client import Client

HERE = pathlib.Path(__file__).resolve().parent

# Seconds between two looks at the engine: while something is under way, and while nothing is.
BUSY, IDLE = 0.02, 0.1

# What properties for paths have: later Blenders want to be told that `//`, the folder of their file, is known here.
RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (5, 0) else set()

# What is called with each look. Modules put their own in as they are registered.
ticks: list[Callable[[], None]] = []

_client: Client | None = None

# Whoever polls holds this: a render has its own thread, and waits in it.
alone = threading.RLock()

# True while a render is at work: what it shows is not changed by the timer.
is_rendering = False

# True if the engine's folder was found full: its data is on disk from then on.
_is_full = False

# Called when an engine was replaced. Modules put their own in as they are registered.
replaced: list[Callable[[], None]] = []


def roots() -> list[str]:
    """The folders outside of their projects that graphs may read."""
    addon = bpy.context.preferences.addons.get(__package__)
    return [bpy.path.abspath(it.path) for it in addon.preferences.roots if it.path] if addon else []


def command() -> list[str]:
    """What starts the engine: the program that the preferences name, or MAQUETTE; else that of the extension."""
    addon = bpy.context.preferences.addons.get(__package__)
    program = (addon.preferences.program if addon else "") or os.environ.get("MAQUETTE", "")
    if program:
        return [bpy.path.abspath(program), "serve", "--stdio", *_folder()]
    found = importlib.util.find_spec("maquette")
    folder = pathlib.Path(found.origin).parents[1] if found and found.origin else HERE
    return [sys.executable, "-I", str(HERE / "worker.py"), str(folder), "serve", "--stdio", *_folder()]


def _folder() -> list[str]:
    """Where the engine puts its data, if not where it does by itself."""
    return [] if exchange.has_room() and not _is_full else ["--folder", bpy.app.tempdir]


def go_to_disk() -> bool:
    """Begins with a new engine whose data is on disk, because there is no room for it in memory. False if it is there already."""
    global _is_full
    folder = client().folder
    if folder is None or folder.parent == pathlib.Path(bpy.app.tempdir):
        return False
    _is_full = True
    restart()
    return True


def client() -> Client:
    """The engine; a new one if there was none. One that has ended stays, so that its end is seen, until `restart`."""
    global _client
    if _client is None:
        _client = Client(command())
    return _client


def ended() -> str | None:
    """Why there is no engine any more; None if all is well."""
    return _client.ended if _client else None


def restart() -> None:
    """Begins with a new engine."""
    global _client
    if _client:
        _client.stop()
    _client = None
    client()
    for its in replaced:
        its()


def poll() -> None:
    """One look: takes what has come, and lets everyone go on; nothing while another thread does."""
    if not alone.acquire(blocking=False):
        return
    try:
        if _client:
            _client.poll()
        for tick in ticks:
            tick()
    finally:
        alone.release()


def _timer() -> float:
    # A timer that raises is called no more.
    try:
        if not is_rendering:
            poll()
    except Exception as error:  # noqa: BLE001
        print(f"maquette: {type(error).__name__}: {error}", file=sys.stderr)
    return BUSY if _client and _client.busy else IDLE


def register() -> None:
    """Begins to look."""
    bpy.app.timers.register(_timer, persistent=True)


def unregister() -> None:
    """Ends the engine."""
    global _client, _is_full
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
    if _client:
        _client.stop()
    _client = None
    _is_full = False


def key(owner: bpy.types.Object) -> int:
    """What an object is known by while it lives, undo included."""
    return owner.session_uid if hasattr(owner, "session_uid") else hash(owner.name_full)
