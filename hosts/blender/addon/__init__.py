"""maquette in Blender.

What is registered is in `MODULES`, and nowhere else; each has `register` and `unregister`. Imports are relative: Blender calls the package
`bl_ext.user_default.maquette`, and a script that has it from its folder calls it `addon`. Scripts call its function `update`.
"""

from __future__ import annotations

from . import engine, frames, live, nodes, paths, preferences, tree, tree_ui, ui, waiting
from .waiting import update

__all__ = ["update"]

# Each may use what those above it have registered.
MODULES = (preferences, engine, live, waiting, nodes, tree, paths, ui, frames, tree_ui)


def register() -> None:
    """Registers all modules, or none: after a failure Blender tries again without calling `unregister`."""
    done = []
    try:
        for module in MODULES:
            module.register()
            done.append(module)
    except BaseException:
        for module in reversed(done):
            module.unregister()
        raise


def unregister() -> None:
    """Leaves nothing behind."""
    for module in reversed(MODULES):
        module.unregister()
