"""Waiting for results, so that renders, exports and scripts get meshes that agree with the current values, files and inputs.

With a window, results arrive by a timer and do not block the user. Without a window there are no timers: each change of the frame waits.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import engine, evaluated, live

# Seconds between two polls while waiting.
PAUSE = 0.002


def update(timeout: float | None = None) -> None:
    """Waits until all live objects show the results for their values, files and inputs.

    `RuntimeError` names the objects that cannot, and why; `TimeoutError` if it takes longer than `timeout` seconds. The objects keep their
    last meshes.
    """
    live.invalidate()
    live.find_linked_again()
    for owner in live.objects():
        live.state(owner).frame = None
    bpy.context.view_layer.update()
    problems = wait(bpy.context.evaluated_depsgraph_get(), timeout)
    if problems:
        raise RuntimeError("; ".join(f"{name}: {why}" for name, why in problems.items()))


def wait(depsgraph: bpy.types.Depsgraph, timeout: float | None = None) -> dict[str, str]:
    """Waits until all live objects agree with this dependency graph; returns the reasons for those that cannot, by name."""
    end = time.monotonic() + timeout if timeout is not None else float("inf")
    live.find_linked_again()
    with engine.poll_lock:
        for owner in live.objects():
            live.state(owner).unread = ""
        # Live objects may be at the inputs of others, so results may take as many rounds as there are objects.
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
    """Marks hidden objects at inputs to be sent again, since Blender does not notify about their changes."""
    for owner in live.objects():
        its = owner.maquette.inputs
        live.state(owner).stale |= {one.name for one in its if one.object and not evaluated.is_seen(one.object, depsgraph)}


def _is_done(owner: bpy.types.Object) -> bool:
    """Returns true if the object shows its result, or cannot show one."""
    it = live.state(owner)
    if engine.end_reason():
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
    return engine.end_reason() or live.hindrance(owner) or next(iter(errors), it.message)


class MAQUETTE_OT_update(bpy.types.Operator):
    """Waits until all live objects show the results for their values, files and inputs"""

    bl_idname = "maquette.update"
    bl_label = "Update Maquette Graphs"
    timeout: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Timeout", description="Seconds after which the operator fails; 0 for no limit", min=0.0
    )

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Waits for the results."""
        try:
            update(self.timeout or None)
        except (RuntimeError, TimeoutError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


# Greater than 0 within `each_frame`.
_waits = 0


class each_frame:
    """A context in which each change of the frame waits for results, also with a window."""

    def __enter__(self) -> None:
        global _waits
        _waits += 1

    def __exit__(self, *_given: Any) -> None:
        global _waits
        _waits -= 1


@persistent
def _on_frame(_scene: Any, depsgraph: bpy.types.Depsgraph | None = None) -> None:
    if bpy.app.background and not evaluated.is_at_work:
        live.invalidate()
    if depsgraph is None or evaluated.is_at_work or not live.objects():
        return
    if not (bpy.app.background or engine.is_rendering or _waits):
        live.on_frame(depsgraph)
        return
    with evaluated.use_frame(depsgraph):
        live.on_frame(depsgraph)
        for name, why in wait(depsgraph).items():
            print(f"maquette: frame {depsgraph.scene.frame_current}, {name}: {why}", file=sys.stderr)


@persistent
def _on_render_start(*_given: Any) -> None:
    engine.is_rendering = True


@persistent
def _on_render_end(*_given: Any) -> None:
    engine.is_rendering = False
    for it in live.states.values():
        it.frame = None


HANDLERS = {"frame_change_post": _on_frame, "render_init": _on_render_start, "render_complete": _on_render_end, "render_cancel": _on_render_end}


def register() -> None:
    """Registers the operator and the handlers."""
    bpy.utils.register_class(MAQUETTE_OT_update)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Unregisters the operator and the handlers."""
    engine.is_rendering = False
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    bpy.utils.unregister_class(MAQUETTE_OT_update)
