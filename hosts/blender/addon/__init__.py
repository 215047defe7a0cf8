"""The Blender extension of maquette.

Each of `MODULES` has `register` and `unregister`; nothing else is registered. Imports are relative, since the package has two names:
`bl_ext.user_default.maquette` in Blender, and `addon` for scripts that import it from its folder. Scripts call its function `update`.
"""

from __future__ import annotations

from . import engine, frames, live, nodes, paths, preferences, tree, tree_ui, ui, waiting
from .waiting import update

__all__ = ["update"]

# In the order of registration: each module may use what earlier ones have registered.
MODULES = (preferences, engine, live, waiting, nodes, tree, paths, ui, frames, tree_ui)


def register() -> None:
    """Registers all modules, or none of them: after a failure Blender tries again without calling `unregister`."""
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
    """Unregisters all modules."""
    for module in reversed(MODULES):
        module.unregister()
