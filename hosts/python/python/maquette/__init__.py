"""maquette: a node-based geometry graph for redesigning scanned objects.

A graph is a text file. `load` checks it, and `Graph.run` evaluates the requested outputs, each node once. The results are values whose
columns are copied to NumPy arrays:

    import maquette

    graph = maquette.load("graphs/doll.ron")
    run = graph.run(growth=12)
    model = run.value("model.glb", maquette.Mesh)
    model.vertices, model.faces

Results are cached in memory and on disk, in the same folder as those of the command line, so that nothing is computed twice. `python -m
maquette` is the whole command line.
"""

from __future__ import annotations

# Type checkers know this name. Importing `typing` would take longer than the rest of this module.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from ._build import GraphBuilder, ron
    from ._files import nodes, read, value_types
    from ._graph import Graph, load
    from ._params import Output, Param, Port
    from ._problems import Cancelled, Element, GraphError, GraphWarning, Note, Problem, TextEdit, UnknownNodeWarning, Use
    from ._run import Node, Progress, Run, WrittenFile
    from ._running import Running
    from ._values import (
        Comparison,
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

    __version__: str

__all__ = [
    "Cancelled",
    "Comparison",
    "ControlNet",
    "Curve",
    "Direction",
    "Element",
    "Field",
    "Graph",
    "GraphBuilder",
    "GraphError",
    "GraphWarning",
    "Handles",
    "Image",
    "KnotVector",
    "Labels",
    "Mask",
    "Mesh",
    "Node",
    "Note",
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
    "Running",
    "Surface",
    "TextEdit",
    "Trace",
    "UnknownNodeWarning",
    "Use",
    "Value",
    "WrittenFile",
    "__version__",
    "load",
    "nodes",
    "read",
    "ron",
    "value_types",
]

_PROBLEMS = "Cancelled Element GraphError GraphWarning Note Problem TextEdit UnknownNodeWarning Use".split()
_MODULES = {
    **dict.fromkeys(_PROBLEMS, "._problems"),
    **dict.fromkeys(["Graph", "load"], "._graph"),
    **dict.fromkeys(["Output", "Param", "Port"], "._params"),
    **dict.fromkeys(["Node", "Progress", "Run", "WrittenFile"], "._run"),
    **dict.fromkeys(["nodes", "read", "value_types"], "._files"),
    "GraphBuilder": "._build",
    "Running": "._running",
    "__version__": "._maquette",
    "ron": "._build",
}

# Hidden from type checkers, which would accept any name otherwise.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Imports the module of a name on first access."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        module = import_module(_MODULES.get(name, "._values"), __name__)
        thing = getattr(module, "VERSION" if name == "__version__" else name)
        globals()[name] = thing
        return thing


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
