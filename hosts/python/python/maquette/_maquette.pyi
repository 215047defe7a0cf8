"""The native module of the engine, which the package wraps."""

from os import PathLike
from pathlib import PurePath
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "Cancel",
    "Column",
    "Finished",
    "Graph",
    "Session",
    "VERSION",
    "Value",
    "catalog",
    "command_line",
    "finish_all",
    "make",
    "read",
]

_Path = Union[str, "PathLike[str]"]
_Problem = Dict[str, Any]

VERSION: str

@final
class Cancel:
    def __new__(cls) -> Cancel: ...
    @property
    def is_cancelled(self) -> bool: ...
    def cancel(self) -> None: ...

@final
class Column:
    @property
    def __array_interface__(self) -> Dict[str, Any]: ...
    @property
    def name(self) -> str: ...
    @property
    def on(self) -> str: ...
    @property
    def meaning(self) -> str: ...
    @property
    def aside(self) -> bool: ...

@final
class Value:
    @property
    def kind(self) -> str: ...
    @property
    def hash(self) -> str: ...
    @property
    def size(self) -> int: ...
    def facts(self) -> Dict[str, Any]: ...
    def columns(self) -> List[Column]: ...
    def describe(self) -> Dict[str, Any]: ...
    def probe(self, at: Tuple[int, int]) -> Dict[str, Any]: ...
    def files(self, name: str) -> Tuple[List[Tuple[str, bytes]], List[str]]: ...
    def save(self, path: _Path) -> Tuple[List[PurePath], List[str]]: ...
    def compare(
        self,
        other: Value,
        max: Optional[float],
        rms: Optional[float],
        normals: Optional[float],
        attributes: Mapping[str, float],
        differing: float,
        level: float,
        relative: float,
        remeshed: bool,
    ) -> Dict[str, Any]: ...
    def normals(self) -> Optional[Column]: ...
    def triangle_corners(self) -> Optional[Column]: ...
    def render(
        self,
        size: Optional[Tuple[int, int]],
        yaw: float,
        pitch: float,
        zoom: float,
        orthographic: bool,
    ) -> Optional[Value]: ...
    def edges(self) -> Optional[Tuple[Column, Column]]: ...
    def triangles(self) -> Optional[Column]: ...

@final
class Graph:
    @staticmethod
    def load(
        path: _Path,
        roots: Sequence[_Path],
        set: Sequence[Tuple[str, str]],
        texts: Dict[str, str],
        draft: bool,
        pins: bool,
        locked: bool,
    ) -> Tuple[Optional[Graph], List[_Problem], List[str]]: ...
    @property
    def path(self) -> str: ...
    @property
    def doc(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def nodes(self) -> List[str]: ...
    def schema(self) -> Dict[str, Any]: ...
    def inputs(self) -> List[Tuple[str, str, str]]: ...
    def results(self) -> List[Tuple[str, Optional[str]]]: ...
    def unused(self) -> List[_Problem]: ...
    def as_ron(self, parameter: str, value: object) -> str: ...
    def svg(self) -> str: ...
    def edited(
        self,
        values: Sequence[Tuple[str, str]],
        roots: Sequence[_Path],
        texts: Dict[str, str],
    ) -> Tuple[Optional[str], List[_Problem]]: ...

@final
class Finished:
    def value(self, name: str) -> Optional[Value]: ...
    def trace(self) -> List[Dict[str, Any]]: ...
    def problems(self) -> List[_Problem]: ...
    def write(
        self,
        folder: Optional[_Path],
        graph: _Path,
        draft: bool,
        only: Sequence[str],
        signs: bool,
        kept: Sequence[_Path],
    ) -> Tuple[List[Dict[str, Any]], List[_Problem]]: ...

@final
class Session:
    def __new__(
        cls,
        cache: Optional[_Path],
        memory: str,
        threads: int,
        max_memory: Optional[str],
        server: Optional[str],
        verify: float,
    ) -> Session: ...
    def troubles(self) -> List[str]: ...
    def why(self, graph: Graph, node: str) -> Optional[str]: ...
    def forget(self) -> None: ...
    def read_inputs(
        self, graph: Graph, files: Sequence[Tuple[str, _Path]]
    ) -> Tuple[Optional[Dict[str, Value]], List[_Problem]]: ...
    def run(
        self,
        graph: Graph,
        outputs: bool,
        nodes: Sequence[str],
        inputs: Dict[str, Value],
        told: Optional[Callable[[str, str, float], object]],
        cancel: Cancel,
        timeout: Optional[float],
    ) -> Tuple[Optional[Finished], List[_Problem]]: ...

def make(
    kind: str,
    columns: Sequence[Tuple[str, str, str, int, npt.NDArray[np.generic]]],
    facts: Sequence[Tuple[str, object]],
    row: Optional[int],
) -> Value: ...
def read(path: _Path, kind: Optional[str]) -> Tuple[Value, List[str]]: ...
def catalog() -> Dict[str, Any]: ...
def command_line(words: Sequence[str]) -> int: ...
def finish_all() -> List[str]: ...
