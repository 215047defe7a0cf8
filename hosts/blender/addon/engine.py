"""The engine of this Blender: one process, started on first use and polled by a timer."""

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

# Seconds between two polls of the engine: while requests are pending, and while it is idle.
BUSY_INTERVAL, IDLE_INTERVAL = 0.02, 0.1

# The option for properties with paths: newer Blenders must know that the add-on supports `//`, the folder of the Blender file.
RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (5, 0) else set()

# Called in each poll. Modules add their functions when they are registered.
ticks: list[Callable[[], None]] = []

_client: Client | None = None

# Held by the thread that polls: a render has its own thread, and waits in it.
poll_lock = threading.RLock()

# True during a render; the timer changes nothing then.
is_rendering = False

# True once the engine's folder in memory was full; its data is on disk from then on.
_is_full = False

# Called after the engine was replaced. Modules add their functions when they are registered.
restart_listeners: list[Callable[[], None]] = []


def roots() -> list[str]:
    """The folders that graphs may read in addition to those of their projects."""
    addon = bpy.context.preferences.addons.get(__package__)
    return [bpy.path.abspath(it.path) for it in addon.preferences.roots if it.path] if addon else []


def command() -> list[str]:
    """The command that starts the engine: the program of the preferences, or MAQUETTE, or the extension's own."""
    addon = bpy.context.preferences.addons.get(__package__)
    program = (addon.preferences.program if addon else "") or os.environ.get("MAQUETTE", "")
    if program:
        return [bpy.path.abspath(program), "serve", "--stdio", *_folder()]
    found = importlib.util.find_spec("maquette")
    folder = pathlib.Path(found.origin).parents[1] if found and found.origin else HERE
    return [sys.executable, "-I", str(HERE / "worker.py"), str(folder), "serve", "--stdio", *_folder()]


def _folder() -> list[str]:
    """The option for a folder on disk, if memory has no room for the engine's data."""
    return [] if exchange.has_room() and not _is_full else ["--folder", bpy.app.tempdir]


def go_to_disk() -> bool:
    """Restarts the engine with its data on disk, since memory has no room for it. Returns false if it is there already."""
    global _is_full
    folder = client().folder
    if folder is None or folder.parent == pathlib.Path(bpy.app.tempdir):
        return False
    _is_full = True
    restart()
    return True


def client() -> Client:
    """Returns the engine, and starts it if there is none. An engine that has ended stays until `restart`, so that users see why."""
    global _client
    if _client is None:
        _client = Client(command())
    return _client


def end_reason() -> str | None:
    """Returns the reason why the engine has ended; None if it runs or was not started."""
    return _client.ended if _client else None


def restart() -> None:
    """Replaces the engine by a new one."""
    global _client
    if _client:
        _client.stop()
    _client = None
    client()
    for its in restart_listeners:
        its()


def poll() -> None:
    """Handles messages of the engine and calls all ticks; does nothing while another thread polls."""
    if not poll_lock.acquire(blocking=False):
        return
    try:
        if _client:
            _client.poll()
        for tick in ticks:
            tick()
    finally:
        poll_lock.release()


def _timer() -> float:
    # Blender removes a timer that raises.
    try:
        if not is_rendering:
            poll()
    except Exception as error:  # noqa: BLE001
        print(f"maquette: {type(error).__name__}: {error}", file=sys.stderr)
    return BUSY_INTERVAL if _client and _client.busy else IDLE_INTERVAL


def register() -> None:
    """Starts the timer."""
    bpy.app.timers.register(_timer, persistent=True)


def unregister() -> None:
    """Stops the timer and the engine."""
    global _client, _is_full
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
    if _client:
        _client.stop()
    _client = None
    _is_full = False


def key(owner: bpy.types.Object) -> int:
    """An identifier of an object for its lifetime, also across undo."""
    return owner.session_uid if hasattr(owner, "session_uid") else hash(owner.name_full)
