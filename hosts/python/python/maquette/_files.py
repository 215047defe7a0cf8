"""Values in files, and what there is to read, write and compute."""

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
    """The value in a file, by its ending: a `Mesh` from .glb, .obj, .ply, .stl .., a `RangeImage` from .pcd, a picture from .png ..

    `kind` says which type it is to be, by name or class, `read("a.ply", maquette.Points)`. What is doubtful of the file is a warning. Raises
    FileNotFoundError and its like if the file cannot be read, ValueError that says what is wrong with it and where.
    """
    path = os.fspath(path)
    _check_readable(path)
    name = kind.KIND if isinstance(kind, type) and issubclass(kind, Value) else kind
    value, doubts = _maquette.read(path, name)
    for doubt in doubts:
        warnings.warn(f"{path}: {doubt}", stacklevel=2)
    return wrap(value)


def _check_readable(path: str) -> None:
    """Raises what `open` raises of a file that cannot be read."""
    wrong = 0
    if stat.S_ISDIR(os.stat(path).st_mode):
        wrong = errno.EISDIR
    elif not os.access(path, os.R_OK):
        wrong = errno.EACCES
    if wrong:
        raise OSError(wrong, os.strerror(wrong), path)


def nodes() -> Dict[str, Any]:
    """All node types by name: what `maquette nodes --json` prints of each: words, inputs, outputs and the JSON schema of its parameters."""
    return {node["name"]: node for node in _maquette.catalog()["nodes"]}


def value_types() -> Dict[str, Any]:
    """All types of values by name, with the endings of files that they are read from and written to."""
    return {kind["name"]: kind for kind in _maquette.catalog()["values"]}
