"""Tests that long calls can be stopped: by Ctrl-C, by another thread, by a timeout, and by asyncio."""

from __future__ import annotations

import asyncio
import concurrent.futures
import pathlib
import subprocess
import sys
import textwrap
import threading
import time

import pytest

import maquette

pytestmark = pytest.mark.every_change

TEXT = """Graph(
    format: 1,
    params: { "levels": Integer(default: 9, min: 0, max: 12, doc: "") },
    nodes: {
        "box": Primitive(shape: Box(size: (10, 20, 30))),
        "skin": Subdivide(mesh: "box", scheme: CatmullClark, levels: Param("levels")),
        "coarse": Simplify(mesh: "skin", faces: 12),
    },
    outputs: { "s.ply": "coarse" },
)"""

# The number of levels for which `Simplify` takes ten seconds, on one core of any machine.
LONG = 8
AFTER = 0.2
# The maximum time until a run has stopped: a busy machine is slower than the 80 ms of an idle one.
SOON = 1.5


@pytest.fixture
def graph() -> maquette.Graph:
    return maquette.load("long.ron", text=TEXT, cache=None, max_memory="8GB")


def later(work: object) -> None:
    timer = threading.Timer(AFTER, work)  # type: ignore[arg-type]
    timer.daemon = True
    timer.start()


def test_a_run_ends_with_its_time(graph: maquette.Graph) -> None:
    start = time.monotonic()
    with pytest.raises(TimeoutError, match="timeout"):
        graph.run(levels=LONG, timeout=AFTER)
    assert AFTER <= time.monotonic() - start < SOON
    assert graph.run(levels=0, timeout=60)["s.ply"]
    assert graph.run(levels=0, timeout=float("inf"))["s.ply"]
    with pytest.raises(TimeoutError):
        graph.run(levels=LONG, timeout=0)
    for wrong in (-1, float("nan")):
        with pytest.raises(ValueError, match="timeout"):
            graph.run(timeout=wrong)


def test_another_thread_stops_a_run_and_the_next_one_is_not_stopped(graph: maquette.Graph) -> None:
    later(graph.cancel)
    start = time.monotonic()
    with pytest.raises(maquette.Cancelled):
        graph.run(levels=LONG)
    assert AFTER <= time.monotonic() - start < SOON
    assert graph.run(levels=1)["s.ply"] == maquette.load("long.ron", text=TEXT, cache=None).run(levels=1)["s.ply"]
    graph.cancel()
    assert graph.run(levels=1)["s.ply"]


def test_a_run_that_was_begun_is_a_future(graph: maquette.Graph) -> None:
    assert graph.start(levels=1).result(60)["s.ply"] == graph.run(levels=1)["s.ply"]
    assert graph.start("s.ply", nodes="box", params={"levels": 1}).result(60).keys() == {"s.ply", "box"}
    with pytest.raises(maquette.GraphError):
        graph.start(levels=99).result(60)
    with pytest.raises(TypeError):
        graph.start(params=3).result(60)
    running = graph.start(levels=LONG)
    assert isinstance(running, concurrent.futures.Future) and not running.done()
    with pytest.raises(concurrent.futures.TimeoutError):
        running.result(AFTER)
    start = time.monotonic()
    assert running.cancel() and running.cancelled()
    with pytest.raises(concurrent.futures.CancelledError):
        running.result()
    assert graph.run(levels=0)["s.ply"] and time.monotonic() - start < SOON
    done = graph.start(levels=0)
    done.result()
    assert not done.cancel() and done.result()


def test_runs_side_by_side_are_stopped_one_by_one(graph: maquette.Graph) -> None:
    other = maquette.load("long.ron", text=TEXT, cache=None)
    one, two = graph.start(levels=LONG), other.start(levels=LONG)
    one.cancel()
    assert not two.done()
    other.cancel()
    with pytest.raises(maquette.Cancelled):
        two.result(SOON)


def test_a_run_does_not_wait_for_one_that_began_later(graph: maquette.Graph) -> None:
    later: "list[maquette.Running]" = []

    def begin(progress: maquette.Progress) -> None:
        if not later:
            later.append(graph.start(levels=LONG))
            time.sleep(AFTER)

    start = time.monotonic()
    assert graph.run(levels=1, progress=begin)["s.ply"] and graph.trouble is None
    assert time.monotonic() - start < SOON and not later[0].done()
    later[0].cancel()


def test_asyncio_stops_a_run(graph: maquette.Graph) -> None:
    async def work() -> float:
        assert (await graph.start(levels=1))["s.ply"]
        task = asyncio.ensure_future(awaited())
        await asyncio.sleep(AFTER)
        start = time.monotonic()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(awaited(), AFTER)
        # A plain run on a thread of asyncio is stopped by `Graph.cancel`.
        begun = threading.Event()
        thread = asyncio.get_running_loop().run_in_executor(None, lambda: graph.run(levels=LONG, progress=lambda _: begun.set()))
        while not begun.is_set():
            await asyncio.sleep(AFTER)
        graph.cancel()
        with pytest.raises(maquette.Cancelled):
            await thread
        return time.monotonic() - start

    async def awaited() -> maquette.Run:
        return await graph.start(levels=LONG)

    assert asyncio.run(work()) < 3 * SOON


INTERRUPTED = r"""
import os, signal, sys, threading, time
import numpy as np
import maquette

n = 900
xx, yy = np.meshgrid(np.arange(n), np.arange(n))
V = np.stack([xx, yy, np.sin(xx / 20.0) * 9], -1).reshape(-1, 3).astype(float)
k = np.arange(n * (n - 1)).reshape(n - 1, n)[:, :-1]
F = np.concatenate([np.stack([k, k + 1, k + n], -1).reshape(-1, 3), np.stack([k + 1, k + n + 1, k + n], -1).reshape(-1, 3)])
big, other = maquette.Mesh(V, F), maquette.Mesh(V + 1, F)
os.chdir(sys.argv[1])
big.save("big.obj")
CALLS = {
    "render": lambda: big.render(20, 20, size=(9000, 9000)),
    "save": lambda: [big.save("again.obj") for _ in range(50)],
    "to_bytes": lambda: [big.to_bytes("ply") for _ in range(99)],
    "read": lambda: [maquette.read("big.obj") for _ in range(50)],
    "summary": lambda: [big.summary for _ in range(50)],
    "compare": lambda: [big.compare(other, remeshed=True) for _ in range(50)],
}
for name, call in CALLS.items():
    time.sleep(0.05)
    threading.Timer(0.15, os.kill, (os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    try:
        call()
        print(name, "ran to its end", time.monotonic() - start)
    except KeyboardInterrupt:
        print(name, time.monotonic() - start)
print([it for it in os.listdir(".") if it not in ("big.obj", "again.obj")])
"""


def test_ctrl_c_is_heard_by_every_long_call(tmp_path: pathlib.Path) -> None:
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(INTERRUPTED), str(tmp_path)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    *calls, left = done.stdout.splitlines()
    assert len(calls) == 6 and all("its end" not in call and float(call.split()[1]) < SOON for call in calls), calls
    assert left == "[]", "a file was left half-written"
