"""maquette: a node-based geometry graph for redesigning scanned objects.

A graph is a text file; `load` checks it, `Graph.run` evaluates what is wanted of it, each step once, and what comes out are values whose
columns are NumPy arrays that share their memory:

    import maquette

    graph = maquette.load("graphs/doll.ron")
    run = graph.run(growth=12)
    skin = run["skin.mesh"]
    skin.vertices, skin.faces

Results are kept in memory and on disk, in the same folder as the command line's, so that nothing is computed twice. `python -m maquette`
is the whole command line.
"""

from __future__ import annotations

# Known to checkers of types by its name; `typing` itself takes longer to load than all else here.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from ._graph import (
        Graph,
        Node,
        Output,
        Param,
        Port,
        Progress,
        Run,
        WrittenFile,
        load,
        nodes,
        read,
        value_types,
    )
    from ._problems import GraphError, Problem, UnknownNodeWarning, Use
    from ._values import (
        ControlNet,
        Curve,
        Direction,
        Field,
        Handles,
        Image,
        KnotVector,
        Labels,
        Mask,
        Mesh,
        Part,
        Points,
        RangeImage,
        Region,
        Surface,
        Trace,
        Value,
    )

__all__ = [
    "ControlNet",
    "Curve",
    "Direction",
    "Field",
    "Graph",
    "GraphError",
    "Handles",
    "Image",
    "KnotVector",
    "Labels",
    "Mask",
    "Mesh",
    "Node",
    "Output",
    "Param",
    "Part",
    "Points",
    "Port",
    "Problem",
    "Progress",
    "RangeImage",
    "Region",
    "Run",
    "Surface",
    "Trace",
    "UnknownNodeWarning",
    "Use",
    "Value",
    "WrittenFile",
    "load",
    "nodes",
    "read",
    "value_types",
]

_GRAPH = "Graph Node Output Param Port Progress Run WrittenFile load nodes read value_types".split()
_PROBLEMS = ["GraphError", "Problem", "UnknownNodeWarning", "Use"]


def __getattr__(name: str) -> object:
    """Loads the engine when something of it is asked for."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    module = "._graph" if name in _GRAPH else "._problems" if name in _PROBLEMS else "._values"
    thing = getattr(import_module(module, __name__), name)
    globals()[name] = thing
    return thing


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
