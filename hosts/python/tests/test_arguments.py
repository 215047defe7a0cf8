"""Tests that any Python object as any argument gives a value or an exception, without a crash or a panic."""

from __future__ import annotations

import pathlib
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import maquette

pytestmark = pytest.mark.every_change

GRAPH = """Graph(
    format: 1,
    params: {
        "number": Number(default: 1, min: 0, max: 4, doc: ""), "count": Integer(default: 1, min: 0, max: 4, doc: ""),
        "flag": Toggle(default: true, doc: ""), "text": Text(default: "a", doc: ""), "color": Color(default: "#102030", doc: ""),
        "choice": Choice(default: A, of: [A, B], doc: ""), "vector": Vector(default: (1, 2, 3), min: 0, max: 9, doc: ""),
    },
    nodes: { "box": Primitive(shape: Box(size: Param("vector"))) },
    outputs: { "box.ply": "box" },
)"""

# Evaluates every call with every object as `it`, and prints each call first, so that a crash can be located.
SCRIPT = r"""
    import datetime, decimal, fractions, io, itertools, os, pathlib, sys, warnings
    import numpy as np
    import maquette

    warnings.simplefilter("ignore")

    class Odd:
        def __init__(self, **methods): self.methods = methods

    def raises(*_): raise RuntimeError("odd")
    def odd(name, method): return type("Odd", (), {name: method})()

    itself = []
    itself.append(itself)
    deep = []
    for _ in range(100_000): deep = [deep]
    OBJECTS = [
        None, True, -1, 0, 3, 2**31, 2**63, 2**200, -2**200, 0.5, 1e308, float("nan"), float("-inf"), 1j, "", "a", "\udce9", "caf\udce9.obj",
        "\0", "x" * 100_000, b"", b"\xff", bytearray(3), memoryview(b"abc"), [], [[]], itself, [1, 2], ["\udce9"], (1, 2, 3), (1,) * 1000,
        {}, {"\udce9": 1}, {1: 2}, {"a": itself}, set(), frozenset({1}), range(3), range(2**40), object(), object, len, lambda: 1, ..., NotImplemented,
        iter([1]), itertools.count(), (it for it in "ab"), decimal.Decimal("1.5"), decimal.Decimal("nan"), fractions.Fraction(1, 3),
        pathlib.Path("a"), pathlib.Path("\udce9"), datetime.date.today(), io.StringIO(), sys, Exception("a"), type("It", (str,), {})("\udce9"),
        odd("__iter__", raises), odd("__float__", raises), odd("__array__", raises), odd("__str__", raises), odd("__index__", raises),
        odd("__len__", lambda _: 2**62), odd("__getitem__", lambda *_: 1), odd("__float__", lambda _: "a"), odd("tolist", lambda _: itself),
        odd("vertices", itself), odd("__fspath__", lambda _: "\udce9"), odd("__bool__", raises), odd("__eq__", raises), odd("__hash__", raises),
        np.float32(1), np.bool_(True), np.datetime64("2020-01-01"), np.str_("\udce9"), np.zeros(0), np.zeros((0, 3)), np.zeros((3, 0)),
        np.zeros((2, 2, 2, 2)), np.full((4, 3), np.nan), np.full((4, 3), np.inf), np.zeros((4, 3), complex), np.array([None, 1]), np.array(["a"]),
        np.zeros((4, 3), "f2"), np.zeros((4, 3), "i8") - 1, np.zeros((4, 3), ">f8"), np.zeros((8, 6))[::-2, ::-2], np.zeros((4, 3), "V4"),
        np.zeros((4, 3), [("a", "f8")]), np.ma.masked_array(np.zeros((4, 3)), True), np.full((4, 3), 2**40), np.array(1.0),
        np.lib.stride_tricks.as_strided(np.zeros(1), (2**31, 3), (0, 0)),
    ]
    V = [[0, 0, 0], [9, 0, 0], [0, 9, 0]]
    F = [[0, 1, 2]]
    path, text = sys.argv[1], open(sys.argv[1]).read()
    graph = maquette.load(path, cache=None)
    function = maquette.load("f.ron", cache=None, text='Graph(format: 1, inputs: {"mesh": Mesh(doc: "")}, nodes: {}, outputs: {"out": "mesh"})')
    mesh, run = maquette.Mesh(V, F), graph.run()
    image = maquette.Image(np.zeros((2, 2, 3), np.uint8))
    NET = np.zeros((4, 4, 3)) + np.arange(4.0)[:, None]
    grid = maquette.RangeImage(np.zeros((4, 3, 3)))
    CALLS = {
        **{f"run({name}=it)": lambda it, name=name: graph.run(**{name: it}) for name in [*graph.params, "box.shape", "other"]},
        **{f"edited({name}=it)": lambda it, name=name: graph.edited(**{name: it}) for name in graph.params},
        "run(it)": lambda it: graph.run(it),
        "run(nodes=it)": lambda it: graph.run(nodes=it),
        "run(inputs=it)": lambda it: function.run(inputs=it),
        "run(inputs={mesh: it})": lambda it: function.run(inputs={"mesh": it}),
        "run(inputs={it: mesh})": lambda it: function.run(inputs={it: mesh}),
        "run(progress=it)": lambda it: graph.run(count=2, progress=it),
        "run(strict=it)": lambda it: graph.run(strict=it),
        "run(draft=it)": lambda it: graph.run(draft=it),
        "run[it]": lambda it: run[it],
        "it in run": lambda it: it in run,
        "why(it)": lambda it: graph.why(it),
        "params[it]": lambda it: graph.params[it],
        "run(params=it)": lambda it: graph.run(params=it),
        "run(params={it: 1})": lambda it: graph.run(params={it: 1}),
        "run(timeout=it)": lambda it: graph.run(timeout=it),
        "run.value(it)": lambda it: run.value(it, maquette.Mesh),
        "run.value(.., it)": lambda it: run.value("box", it),
        "load(it)": lambda it: maquette.load(it, cache=None),
        "load(cache_remote=it)": lambda it: maquette.load(path, cache_remote=it),
        "load(verify_cache=it)": lambda it: maquette.load(path, verify_cache=it, cache=None),
        "load(pins=it)": lambda it: maquette.load(path, pins=it, cache=None),
        "load(locked=it)": lambda it: maquette.load(path, locked=it, cache=None),
        "ron.Box(size=it)": lambda it: maquette.GraphBuilder().node("a", maquette.ron.Box(size=it)),
        "GraphBuilder.node(it)": lambda it: maquette.GraphBuilder().node(it, maquette.ron.Box()),
        "load(text=it)": lambda it: maquette.load(path, text=it, cache=None),
        "load(roots=it)": lambda it: maquette.load(path, roots=it, cache=None),
        "load(cache=it)": lambda it: None if it in (True, None) else maquette.load(path, cache=it),
        "load(memory=it)": lambda it: maquette.load(path, memory=it, cache=None).run(),
        "load(max_memory=it)": lambda it: maquette.load(path, max_memory=it, cache=None).run(),
        "load(threads=it)": lambda it: maquette.load(path, threads=it, cache=None).run(),
        "read(it)": lambda it: maquette.read(it),
        "read(kind=it)": lambda it: maquette.read(path, it),
        "save(it)": lambda it: mesh.save(it),
        "to_bytes(it)": lambda it: mesh.to_bytes(it),
        "write(it)": lambda it: run.write(it),
        "probe(it, 0)": lambda it: image.probe(it, 0),
        "render(it)": lambda it: mesh.render(it, size=(8, 8)),
        "render(pitch=it)": lambda it: mesh.render(pitch=it, size=(8, 8)),
        "render(size=it)": lambda it: mesh.render(size=it),
        "render(zoom=it)": lambda it: mesh.render(zoom=it, size=(8, 8)),
        "compare(it)": lambda it: mesh.compare(it),
        "compare(max=it)": lambda it: mesh.compare(mesh, max=it),
        "compare(attributes=it)": lambda it: mesh.compare(mesh, attributes=it),
        "mesh == it": lambda it: mesh == it,
        "replace(it)": lambda it: mesh.replace(it),
        "replace(faces=it)": lambda it: mesh.replace(faces=it),
        "replace(uv=it)": lambda it: mesh.replace(uv=it),
        "replace(texture=it)": lambda it: mesh.replace(texture=it),
        "Mesh(like=it)": lambda it: maquette.Mesh(V, F, like=it),
        "Mesh(color=it)": lambda it: maquette.Mesh(V, F, color=it),
        "RangeImage(camera=it)": lambda it: maquette.RangeImage(np.ones((4, 3)), camera=it),
        "RangeImage(depth=it)": lambda it: maquette.RangeImage(it, camera=(1, 1, 0, 0)),
        "Value.from_parts(it)": lambda it: maquette.Value.from_parts(it, {}),
        "Value.from_parts(.., it)": lambda it: maquette.Value.from_parts("Points", it),
        "Value.from_parts(facts=it)": lambda it: maquette.Value.from_parts("Surface", {"point": ("point", V)}, it),
        "Value.from_parts(fact=it)": lambda it: maquette.Value.from_parts("ControlNet", {"point": ("point", V)}, {"control points": it}),
        "Value.from_parts(on=it)": lambda it: maquette.Value.from_parts("Points", {"position": (it, V)}),
        "Value.from_parts(name=it)": lambda it: maquette.Value.from_parts("Points", {"position": ("point", V), it: ("point", [1, 2, 3])}),
        "Mesh(it)": lambda it: maquette.Mesh(it),
        "Mesh(it, F)": lambda it: maquette.Mesh(it, F),
        "Mesh(V, it)": lambda it: maquette.Mesh(V, it),
        "Mesh(uv=it)": lambda it: maquette.Mesh(V, F, uv=it),
        "Mesh(texture=it)": lambda it: maquette.Mesh(V, F, texture=it),
        "Mesh(heat=it)": lambda it: maquette.Mesh(V, F, heat=it),
        "Mesh(face_attributes=it)": lambda it: maquette.Mesh(V, F, face_attributes=it),
        "Mesh(corner_attributes=it)": lambda it: maquette.Mesh(V, F, corner_attributes={"a": it}),
        "Points(it)": lambda it: maquette.Points(it),
        "Image(it)": lambda it: maquette.Image(it),
        "Mask(it)": lambda it: maquette.Mask(it),
        "Field(it)": lambda it: maquette.Field(it),
        "Labels(it)": lambda it: maquette.Labels(it),
        "RangeImage(it)": lambda it: maquette.RangeImage(it),
        "RangeImage(color=it)": lambda it: maquette.RangeImage(np.zeros((4, 3, 3)), color=it),
        "Curve(it)": lambda it: maquette.Curve(it),
        "Curve(knots=it)": lambda it: maquette.Curve(V, knots=it),
        "ControlNet(it)": lambda it: maquette.ControlNet(it),
        "Handles(it)": lambda it: maquette.Handles(it, V),
        "Handles(.., it)": lambda it: maquette.Handles(V, it),
        "Handles(sigma=it)": lambda it: maquette.Handles(V, V, sigma=it),
        "Direction(it)": lambda it: maquette.Direction(it),
        "KnotVector(it)": lambda it: maquette.KnotVector(it, 3),
        "Surface(it)": lambda it: maquette.Surface(it, V, V),
        "Surface(.., it)": lambda it: maquette.Surface(NET, it),
        "Surface(degree=it)": lambda it: maquette.Surface(NET, degree=it),
        "Surface(degree=(it, 1))": lambda it: maquette.Surface(NET, degree=(it, 1)),
        "Surface(knots_u=it)": lambda it: maquette.Surface(NET, knots_u=it),
        "Curve(weights=it)": lambda it: maquette.Curve(V, weights=it),
        "Curve(closed=it)": lambda it: maquette.Curve(V, closed=it),
        "Curve(degree=it)": lambda it: maquette.Curve(V, knots=[0, 0, 1, 2, 2], degree=it),
        "KnotVector(.., it)": lambda it: maquette.KnotVector([0, 0, 1, 1], it),
        "ControlNet(.., it)": lambda it: maquette.ControlNet(NET, it),
        "Handles(weight=it)": lambda it: maquette.Handles(V, weight=it),
        "Handles(space=it)": lambda it: maquette.Handles(V, space=it),
        "Points(a=it)": lambda it: maquette.Points(V, a=it),
        "Points(color=it)": lambda it: maquette.Points(V, color=it),
        "RangeImage.replace(it)": lambda it: grid.replace(it),
        "RangeImage.replace(color=it)": lambda it: grid.replace(color=it),
        "replace(heat=it)": lambda it: mesh.replace(heat=it),
        "replace(corner_attributes=it)": lambda it: mesh.replace(corner_attributes=it),
        "compare(rms=it)": lambda it: mesh.compare(mesh, rms=it),
        "compare(attributes={a: it})": lambda it: mesh.compare(mesh, attributes={"a": it}),
        "compare(remeshed=it)": lambda it: mesh.compare(mesh, remeshed=it),
        "render(orthographic=it)": lambda it: mesh.render(orthographic=it, size=(8, 8)),
        "probe(0, it)": lambda it: image.probe(0, it),
        "write(provenance=it)": lambda it: run.write(provenance=it),
        "run.get(it)": lambda it: run.get(it),
        "start(it)": lambda it: graph.start(it).result(),
        "start(number=it)": lambda it: graph.start(number=it).result(),
        "start(timeout=it)": lambda it: graph.start(timeout=it).result(),
        "GraphBuilder.param(it)": lambda it: maquette.GraphBuilder().param(it, maquette.ron.Integer(default=1)),
        "GraphBuilder.param(.., it)": lambda it: maquette.GraphBuilder().param("a", it),
        "GraphBuilder.output(it)": lambda it: maquette.GraphBuilder().output(it, "a"),
        "GraphBuilder.output(.., it)": lambda it: maquette.GraphBuilder().output("a.ply", it),
        "value_of(dict)": lambda it: function.run(inputs={"mesh": {"vertices": it, "faces": F}}),
    }
    for call, function_ in CALLS.items():
        # Except the last array: NumPy itself would compare each of its six billion numbers.
        for number, it in enumerate(OBJECTS[:-1] if call == "mesh == it" else OBJECTS):
            print(call, number, type(it).__name__, flush=True)
            try:
                function_(it)
            except Exception:
                pass
            except BaseException as error:
                print("PANIC", call, number, type(it).__name__, repr(error)[:300], flush=True)
    print("done", len(CALLS) * len(OBJECTS), flush=True)
"""


def test_every_object_as_every_argument_gives_a_value_or_an_exception(tmp_path: pathlib.Path) -> None:
    (tmp_path / "it.ron").write_text(GRAPH)
    # An array of six billion numbers must be refused at once and not be allocated in swap.
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))\n"
    script = limit + textwrap.dedent(SCRIPT)
    (tmp_path / "script.py").write_text(script)
    command = [sys.executable, "-X", "faulthandler", "script.py", "it.ron"]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=600, cwd=tmp_path)
    lines = done.stdout.splitlines()
    assert done.returncode == 0, (lines[-1:], done.stderr[-3000:])
    assert not [line for line in lines if line.startswith("PANIC")]
    assert lines[-1].startswith("done")


def test_an_array_of_very_many_numbers_is_no_parameter(tmp_path: pathlib.Path) -> None:
    (tmp_path / "it.ron").write_text(GRAPH)
    graph = maquette.load(tmp_path / "it.ron", cache=None)
    many = np.lib.stride_tricks.as_strided(np.zeros(1), (2**31, 3), (0, 0))
    for name in ("number", "vector", "box.shape"):
        with pytest.raises(ValueError, match=f"`{name}` is an array of 6442450944 numbers"):
            graph.run(params={name: many})


@pytest.mark.parametrize("name", ["text", "number", "vector", "color", "choice", "flag", "box.shape", "other"])
def test_a_text_that_is_not_valid_unicode_is_refused_by_the_name_of_its_parameter(name: str, tmp_path: pathlib.Path) -> None:
    (tmp_path / "it.ron").write_text(GRAPH)
    graph = maquette.load(tmp_path / "it.ron", cache=None)
    for value in ["caf\udce9.obj", "\ud800", ["a", "\udfff"], np.str_("\udce9")]:
        with pytest.raises(ValueError, match=f"`{name}` is .*not valid Unicode"):
            graph.run(**{name: value})
        with pytest.raises(ValueError, match=f"`{name}` is .*not valid Unicode"):
            graph.edited(**{name: value})


def test_what_there_is_no_room_for_is_a_memory_error() -> None:
    script = """
        import resource
        import numpy as np
        import maquette

        mesh = maquette.Mesh([[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, 2]])
        array = np.zeros((5_000_000, 3))
        mesh.render(size=(8, 8)), maquette.Points(mesh.vertices)
        held = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (held + (100 << 20), held + (100 << 20)))
        for call in (lambda: mesh.render(size=(16384, 16384)), lambda: maquette.Points(array), lambda: maquette.RangeImage(array.reshape(1000, 5000, 3))):
            try:
                call()
            except MemoryError as error:
                print("MemoryError")
        print(mesh.render(size=(8, 8)).pixels.shape)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.splitlines() == ["MemoryError"] * 3 + ["(8, 8, 3)"]


@pytest.mark.parametrize("value", [b"7", bytearray(b"7"), memoryview(b"7"), 10**400, [10**400]])
def test_a_value_that_no_parameter_can_have_is_refused_with_its_name(value: object) -> None:
    graph = maquette.load("a.ron", text=GRAPH, cache=None)
    for name in ("number", "count", "vector"):
        with pytest.raises((TypeError, ValueError), match=name):
            graph.run(params={name: value})
