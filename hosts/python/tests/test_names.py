"""Tests that parameters may have any name: each can be set, also if `run` has an argument of this name, and ambiguous calls are refused."""

from __future__ import annotations

import inspect
import keyword

import pytest

import maquette

pytestmark = pytest.mark.every_change

ARGUMENTS = [name for name in inspect.signature(maquette.Graph.run).parameters if name not in ("self", "named")]
NAMES = [*ARGUMENTS, "self", "named", "graph", "token", "arguments", "given", "class", "a-b", "text", "cls"]


def graph_with(*names: str) -> maquette.Graph:
    """A box whose sides are the first three of these parameters; the others are unused."""
    params = ", ".join(f'"{name}": Number(default: 1, min: 0, max: 99, doc: "")' for name in names)
    size = ", ".join(f'Param("{name}")' for name in (list(names) * 3)[:3])
    text = f'Graph(format: 1, params: {{ {params} }}, nodes: {{ "b": Primitive(shape: Box(size: ({size}))) }}, outputs: {{ "b.ply": "b" }})'
    return maquette.load("names.ron", text=text, cache=None)


def size(run: maquette.Run) -> float:
    bounds = run.value("b", maquette.Mesh).bounds
    assert bounds is not None
    return float((bounds[1] - bounds[0])[0])


@pytest.mark.parametrize("name", NAMES)
def test_a_parameter_of_any_name_can_be_given(name: str) -> None:
    graph = graph_with(name)
    assert size(graph.run(params={name: 7})) == 7
    assert "default: 7" in graph.edited({name: 7})
    word = name.replace("-", "_")
    if word in ARGUMENTS:
        return
    assert size(graph.run(**{word: 7})) == 7  # type: ignore[arg-type]
    assert keyword.iskeyword(word) or "default: 7" in graph.edited(**{word: 7})


@pytest.mark.parametrize("name", [name for name in ARGUMENTS if name != "params"])
def test_what_may_mean_a_parameter_or_an_argument_is_refused_and_says_how_to_say_it(name: str) -> None:
    graph, given = graph_with(name), {"timeout": 60, "outputs": "b.ply", "nodes": "b", "inputs": {}}.get(name, True)
    with pytest.raises(TypeError, match=f"`{name}` is an argument of run and a parameter .*params="):
        graph.run(**{name: given})  # type: ignore[arg-type]
    # With a dict of parameters it is the argument.
    assert size(graph.run(params={name: 7}, **{name: given, **({"nodes": "b"} if name == "outputs" else {})})) == 7  # type: ignore[arg-type]
    assert size(graph.run(params={}, **{name: given, **({"nodes": "b"} if name == "outputs" else {})})) == 1  # type: ignore[arg-type]


def test_a_parameter_that_is_called_params_is_one_more() -> None:
    graph = graph_with("params")
    with pytest.raises(TypeError, match="expected a dict"):
        graph.run(params=3)  # type: ignore[arg-type]
    assert size(graph.run(params={"params": 3})) == 3


def test_no_parameter_is_given_twice() -> None:
    graph = graph_with("a-b", "c")
    with pytest.raises(TypeError, match="`c` is given twice"):
        graph.run(params={"c": 1}, c=2)
    with pytest.raises(TypeError, match="a_b"):
        graph.run(params={"a-b": 1}, a_b=2)
    with pytest.raises(TypeError, match="twice"):
        graph.run(params={"a-b": 1, "a_b": 2})
