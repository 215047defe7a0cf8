"""Reading of values from files, and the catalog of nodes and value types."""

from __future__ import annotations

import errno
import os
import stat
import warnings
from typing import Any, Dict, Optional, Type, Union, overload

from . import _maquette
from ._run import Path, V
from ._value import Value, wrap


@overload
def read(path: Path, kind: Optional[str] = None) -> Value: ...
@overload
def read(path: Path, kind: Type[V]) -> V: ...
def read(path: Path, kind: Union[str, Type[Value], None] = None) -> Value:
    """Reads a value from a file, by the file's extension: a `Mesh` from .glb, .obj, .ply, .stl .., a `RangeImage` from .pcd, a picture from
    .png ..

    `kind` is the requested type, as name or class: `read("a.ply", maquette.Points)`. Warns of doubtful content. Raises FileNotFoundError or
    another OSError if the file cannot be read, and ValueError with the position of an error in the file.
    """
    path = os.fspath(path)
    _check_readable(path)
    name = kind.KIND if isinstance(kind, type) and issubclass(kind, Value) else kind
    value, doubts = _maquette.read(path, name)
    for doubt in doubts:
        warnings.warn(f"{path}: {doubt}", stacklevel=2)
    return wrap(value)


def _check_readable(path: str) -> None:
    """Raises the error of `open` if a file cannot be read."""
    wrong = 0
    if stat.S_ISDIR(os.stat(path).st_mode):
        wrong = errno.EISDIR
    elif not os.access(path, os.R_OK):
        wrong = errno.EACCES
    if wrong:
        raise OSError(wrong, os.strerror(wrong), path)


def nodes() -> Dict[str, Any]:
    """All node types by name, as in `maquette nodes --json`: documentation, inputs, outputs and the JSON schema of the parameters."""
    return {node["name"]: node for node in _maquette.catalog()["nodes"]}


def value_types() -> Dict[str, Any]:
    """All value types by name, with the file extensions for reading and writing."""
    return {kind["name"]: kind for kind in _maquette.catalog()["values"]}
