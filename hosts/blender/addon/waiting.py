"""Waiting for results. Renders and exports see each frame as its values, files and inputs say, and so do scripts that ask for it.

In a window results come by a timer, while the user goes on. Without a window there are no timers: each change of the frame waits.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import engine, evaluated, live

# Seconds between two looks while somebody waits.
PAUSE = 0.002


def update(timeout: float | None = None) -> None:
    """Waits until all live objects show what their values, files and inputs say.

    `RuntimeError` says which objects cannot, and why; `TimeoutError` that `timeout` seconds were not enough. The objects keep their last meshes.
    """
    live.forget()
    live.find_linked_again()
    for owner in live.objects():
        live.state(owner).frame = None
    bpy.context.view_layer.update()
    problems = wait(bpy.context.evaluated_depsgraph_get(), timeout)
    if problems:
        raise RuntimeError("; ".join(f"{name}: {why}" for name, why in problems.items()))


def wait(depsgraph: bpy.types.Depsgraph, timeout: float | None = None) -> dict[str, str]:
    """Waits until all live objects are as this graph says; returns why objects are not, by their names."""
    end = time.monotonic() + timeout if timeout is not None else float("inf")
    live.find_linked_again()
    with engine.alone:
        for owner in live.objects():
            live.state(owner).unread = ""
        # Live objects may be at the inputs of others: one after the other is right.
        for _ in range(len(live.objects()) + 1):
            _refresh(depsgraph)
            before = [it.maquette.shown for it in live.objects()]
            live.look_now()
            engine.poll()
            while not all(map(_is_done, live.objects())):
                if time.monotonic() > end:
                    raise TimeoutError(", ".join(it.name for it in live.objects() if not _is_done(it)) + f": not done after {timeout} s")
                time.sleep(PAUSE)
                engine.poll()
            depsgraph.update()
            if before == [it.maquette.shown for it in live.objects()] and all(map(_is_done, live.objects())):
                break
        return {owner.name: why for owner in live.objects() if (why := _why(owner))}


def _refresh(depsgraph: bpy.types.Depsgraph) -> None:
    """Nothing tells of changes of objects that are not seen."""
    for owner in live.objects():
        its = owner.maquette.inputs
        live.state(owner).stale |= {one.name for one in its if one.object and not evaluated.is_seen(one.object, depsgraph)}


def _is_done(owner: bpy.types.Object) -> bool:
    """Returns true if the object shows its result, or cannot."""
    it = live.state(owner)
    if engine.ended():
        return True
    if it.loaded is None:
        return bool(it.unread)
    if it.loading or it.run is not None or it.sending:
        return False
    if not it.loaded["ok"] or live.hindrance(owner):
        return True
    inputs = {one["name"] for one in it.loaded["inputs"]}
    given = {one.name for one in owner.maquette.inputs if one.object and one.name in inputs}
    if it.stale & given:
        return False
    if inputs - it.inputs.keys():
        return bool(it.message)
    return live.is_answered(owner)


def _why(owner: bpy.types.Object) -> str:
    it = live.state(owner)
    errors = [problem["message"] for problem in it.problems if problem.get("severity") == "error"]
    return engine.ended() or live.hindrance(owner) or next(iter(errors), it.message)


class MAQUETTE_OT_update(bpy.types.Operator):
    """Waits until all live objects show what their values, files and inputs say"""

    bl_idname = "maquette.update"
    bl_label = "Update Maquette Graphs"
    timeout: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Timeout", description="Seconds after which it fails; 0 waits as long as it takes", min=0.0
    )

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Waits."""
        try:
            update(self.timeout or None)
        except (RuntimeError, TimeoutError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


# Greater than 0 while an operator goes through frames and waits in each.
_waits = 0


class each_frame:
    """Within this, each change of the frame waits, in a window too."""

    def __enter__(self) -> None:
        global _waits
        _waits += 1

    def __exit__(self, *_given: Any) -> None:
        global _waits
        _waits -= 1


@persistent
def _framed(_scene: Any, depsgraph: bpy.types.Depsgraph | None = None) -> None:
    if bpy.app.background and not evaluated.is_at_work:
        live.forget()
    if depsgraph is None or evaluated.is_at_work or not live.objects():
        return
    if not (bpy.app.background or engine.is_rendering or _waits):
        live.framed(depsgraph)
        return
    with evaluated.frame(depsgraph):
        live.framed(depsgraph)
        for name, why in wait(depsgraph).items():
            print(f"maquette: frame {depsgraph.scene.frame_current}, {name}: {why}", file=sys.stderr)


@persistent
def _began(*_given: Any) -> None:
    engine.is_rendering = True


@persistent
def _ended(*_given: Any) -> None:
    engine.is_rendering = False
    for it in live.states.values():
        it.frame = None


HANDLERS = {"frame_change_post": _framed, "render_init": _began, "render_complete": _ended, "render_cancel": _ended}


def register() -> None:
    """Begins to wait for frames."""
    bpy.utils.register_class(MAQUETTE_OT_update)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Waits no more."""
    engine.is_rendering = False
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    bpy.utils.unregister_class(MAQUETTE_OT_update)
