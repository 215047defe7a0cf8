"""Runs the `shots` of a script inside Blender's window; started by `screen.py`."""

from __future__ import annotations

import os
import pathlib
import runpy
import subprocess
import sys
import traceback
from typing import Any, Iterator

import bpy

# Seconds in which llvmpipe draws a window of 1600 by 1000 once, with all panels; earlier pictures may show the previous state.
SETTLED = 0.3

# Seconds between two movements of the mouse, so that Blender does not merge them.
HAND = 0.1


class Window:
    """Blender's window, filled by one area."""

    def __init__(self) -> None:
        self.window = bpy.context.window_manager.windows[0]

    @property
    def area(self) -> bpy.types.Area:
        """The largest area: the one that fills the window, once `show` was called."""
        return max(self.window.screen.areas, key=lambda it: it.width * it.height)

    def show(self, kind: str) -> bpy.types.Space:
        """Fills the window with one area of this kind: `VIEW_3D`, `PROPERTIES`, or the `bl_idname` of a node tree's class."""
        if len(self.window.screen.areas) > 1 and not self.window.screen.show_fullscreen:
            with self.override():
                bpy.ops.screen.screen_full_area(use_hide_panels=False)
        self.area.ui_type = kind
        return self.area.spaces.active

    def tree(self, tree: bpy.types.NodeTree, sidebar: bool = False) -> Iterator[None]:
        """Shows a whole node tree: `yield from window.tree(tree)`. Blender does not enlarge a small one."""
        space = self.show(tree.bl_idname)
        space.node_tree = tree
        space.show_region_ui = sidebar
        # The size of nodes is known only after they are drawn.
        yield None
        with self.override():
            bpy.ops.node.view_all()
        yield None

    def override(self, kind: str = "WINDOW") -> Any:
        """A context for operators of the area, which timers lack."""
        area = self.area
        region = next(it for it in area.regions if it.type == kind)
        return bpy.context.temp_override(window=self.window, area=area, region=region)

    def place(self, x: float, y: float) -> tuple[int, int]:
        """The position on the screen of a point of the node tree, in the units of `Node.location`."""
        area = self.area
        region = next(it for it in area.regions if it.type == "WINDOW")
        scale = bpy.context.preferences.system.ui_scale
        right, up = region.view2d.view_to_region(x * scale, y * scale, clip=False)
        return region.x + right, self.window.height - (region.y + up)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> Iterator[float]:
        """Drags the mouse between points of the node tree: `yield from window.drag(..)`."""
        yield from self.pull(self.place(*start), self.place(*end))

    def pull(self, start: tuple[int, int], end: tuple[int, int], steps: int = 4) -> Iterator[float]:
        """Drags the mouse between points of the screen."""
        (x, y), (to_x, to_y) = start, end
        xdotool("mousemove", x, y)
        yield HAND
        xdotool("mousedown", 1)
        yield HAND
        for step in range(1, steps + 1):
            xdotool("mousemove", x + (to_x - x) * step // steps, y + (to_y - y) * step // steps)
            yield HAND
        xdotool("mouseup", 1)
        yield SETTLED

    def click(self, x: int, y: int) -> Iterator[float]:
        """Clicks on a point of the screen."""
        xdotool("mousemove", x, y)
        yield HAND
        xdotool("click", 1)
        yield SETTLED

    def key(self, keys: str) -> Iterator[float]:
        """Presses keys at the position of the mouse: `yield from window.key("ctrl+z")`."""
        xdotool("key", keys)
        yield SETTLED

    def picture(self, path: pathlib.Path) -> None:
        """Writes a picture of the window."""
        with self.override():
            bpy.ops.screen.screenshot(filepath=str(path))


def xdotool(*words: object) -> None:
    """Runs xdotool, which moves the mouse and presses keys."""
    subprocess.run(["xdotool", *map(str, words)], check=True)


def main(script: pathlib.Path, folder: pathlib.Path) -> None:
    """Registers the add-on and runs the script, a step at a time."""
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
    import addon

    addon.register()
    bpy.context.preferences.view.show_splash = False
    window: Window
    shots: Iterator[str | float | None]
    taken: str | None = None

    def start() -> float:
        nonlocal window, shots
        window = Window()
        shots = runpy.run_path(str(script))["shots"](window)
        bpy.app.timers.register(guarded(step), persistent=True)
        return SETTLED

    def step() -> float:
        nonlocal taken
        if taken is not None:
            window.picture(folder / f"{taken}.png")
            taken = None
        wanted = next(shots)
        if isinstance(wanted, str):
            taken = wanted
        window.area.tag_redraw()
        return float(wanted) if isinstance(wanted, (int, float)) else SETTLED

    bpy.app.timers.register(guarded(start), first_interval=SETTLED, persistent=True)


def guarded(step: Any) -> Any:
    """Wraps a timer function so that Blender exits when it ends or raises."""

    def run() -> float | None:
        code = 1
        try:
            once = step.__name__ == "start"
            delay = step()
            return None if once else delay
        except StopIteration:
            code = 0
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)

    return run


main(*map(pathlib.Path, sys.argv[sys.argv.index("--") + 1 :][:2]))
