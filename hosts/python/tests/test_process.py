"""Tests that the module leaves signals, threads, forks, the environment and the allocator to the host program."""

from __future__ import annotations

import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest

import maquette

ROOT = pathlib.Path(__file__).resolve().parents[3]


def script(text: str, *words: str, **options: object) -> subprocess.CompletedProcess[str]:
    """Runs a script in another Python."""
    command = [sys.executable, "-c", textwrap.dedent(text), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, **options)  # type: ignore[call-overload, no-any-return]


def test_importing_changes_nothing() -> None:
    done = script(
        """
        import ctypes, os, signal, sys, threading
        import collections.abc, typing, atexit

        class Counts(ctypes.Structure):
            _fields_ = [(name, ctypes.c_size_t) for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()]

        libc = ctypes.CDLL(None)
        libc.malloc.restype, libc.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
        libc.mallinfo2.restype = Counts

        def mapped() -> int:
            # A list of 1 MB is mapped by the system, which is the default.
            before = libc.mallinfo2().hblks
            libc.malloc(1 << 20)
            return libc.mallinfo2().hblks - before

        def state():
            handlers = [signal.getsignal(number) for number in signal.valid_signals() if number not in (9, 19)]
            return handlers, dict(os.environ), threading.active_count(), mapped(), os.getcwd()

        before = state()
        assert before[3] == 1
        import maquette
        assert state() == before
        assert "numpy" not in sys.modules, "numpy is loaded"
        graph = maquette.load("it.ron", text='Graph(format: 1, nodes: {}, outputs: {})')
        graph.run()
        assert state()[0] == before[0] and state()[1] == before[1] and mapped() == 1
        print("same")
        """
    )
    assert done.stdout == "same\n", done.stderr


LONG = """Graph(
    format: 1,
    inputs: { "points": RangeImage(doc: "A wave."), "ball": Mesh(doc: "A ball.") },
    nodes: {
        "sheet": Triangulate(range: "points"),
        "subdivide": Subdivide(mesh: "sheet", scheme: Loop, levels: 2, limit: true),
        "denoise": Denoise(range: "points", iterations: 100),
        "curvature": Curvature(mesh: "sheet"),
        "simplify": Simplify(mesh: "sheet", faces: 1000),
        "ffd": Ffd(mesh: "sheet", mode: Displacement, handles: [HANDLES]),
        "fill-range": FillRange(range: "points", largest: 100000),
        "interpolate": Interpolate(mesh: "ball", scheme: Loop, foot: Closest, solver: Plain),
        "fill-holes": FillHoles(mesh: "sheet", holes: All, method: ThinPlate),
    },
    outputs: { "out": "sheet" },
)"""


@pytest.mark.parametrize(
    "node", ["subdivide", "denoise", "curvature", "simplify", "ffd", "fill-range", "interpolate", "fill-holes"]
)
def test_ctrl_c_gives_the_prompt_back_within_150_ms(node: str, tmp_path: pathlib.Path) -> None:
    at = np.random.default_rng(7).random((400, 3))
    handles = ", ".join(f"(at: ({x:.3f}, {y:.3f}, {z:.3f}), to: ({y:.3f}, {x:.3f}, {z:.3f}))" for x, y, z in at)
    (tmp_path / "long.ron").write_text(LONG.replace("HANDLES", handles))
    waits = []
    for delay in (0.05, 0.3, 0.9):
        child = subprocess.Popen(
            [
                sys.executable,
                "-c",
                textwrap.dedent(
                    """
                    import sys, time
                    import numpy as np
                    import maquette
                    side = 1500
                    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float))
                    z = 3000 + 20 * np.sin(x / 30) * np.cos(y / 20) + np.random.default_rng(1).random(x.shape)
                    z[(np.abs(x - 750) < 155) & (np.abs(y - 750) < 155)] = np.nan
                    wave = np.dstack([x, y, z])
                    wave[np.isnan(z)] = np.nan
                    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 400, endpoint=False), np.linspace(.1, 3, 200))
                    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], -1).reshape(-1, 3) * 50
                    k = np.arange(199 * 400).reshape(199, 400)
                    n = np.roll(k, -1, axis=1)
                    faces = np.concatenate([np.stack([k, k + 400, n], -1).reshape(-1, 3), np.stack([n, k + 400, n + 400], -1).reshape(-1, 3)])
                    inputs = {"points": maquette.RangeImage(wave), "ball": maquette.Mesh(ball, faces)}
                    graph = maquette.load("long.ron", cache=None)
                    def told(progress):
                        if (progress.node, progress.state) == (sys.argv[1], "started"):
                            print("started", flush=True)
                    try:
                        graph.run([], nodes=[sys.argv[1]], inputs=inputs, progress=told)
                        print("done", flush=True)
                    except KeyboardInterrupt:
                        print(time.monotonic(), flush=True)
                    import os
                    os._exit(0)
                    """
                ),
                node,
            ],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert child.stdout is not None
        assert child.stdout.readline() == "started\n"
        time.sleep(delay)
        sent = time.monotonic()
        child.send_signal(signal.SIGINT)
        # If the node had started again, it would be reported again.
        told = [line for line in child.stdout if line != "started\n"]
        child.wait(60)
        if told != ["done\n"]:
            waits.append(float(told[0]) - sent)
    assert waits, f"{node} was done before it was interrupted"
    assert max(waits) <= 0.15, waits


def test_after_ctrl_c_the_next_run_is_right(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron", cache=None)
    expected = maquette.load(graphs / "doll.ron", cache=None).run(levels=2)["model.ply"].hash
    for delay in (0.02, 0.1, 0.2, 0.4):
        timer = threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        try:
            doll.run(levels=2)
            # The run was faster than the signal, which arrives now.
            timer.join()
            time.sleep(0.05)
        except KeyboardInterrupt:
            pass
        doll.forget()
    assert doll.run(levels=2)["model.ply"].hash == expected


def test_other_threads_go_on_while_a_graph_runs(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron", cache=None, threads=1)
    going = True
    ticks = 0

    def tick() -> None:
        nonlocal ticks
        while going:
            ticks += 1
            time.sleep(0.005)

    def ticks_during(work: object) -> float:
        nonlocal ticks
        ticks, start = 0, time.perf_counter()
        work()  # type: ignore[operator]
        return ticks / (time.perf_counter() - start)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        idle = ticks_during(lambda: time.sleep(1.0))
        busy = ticks_during(lambda: doll.run(levels=3))
    finally:
        going = False
        thread.join()
    assert busy >= 0.9 * idle, (busy, idle)


def test_two_graphs_run_side_by_side(graphs: pathlib.Path) -> None:
    expected = {levels: maquette.load(graphs / "doll.ron", cache=None).run(levels=levels)["model.ply"].hash for levels in (1, 2)}
    times: dict[int, list[float]] = {1: [], 2: []}
    found: dict[int, str] = {}

    def work(levels: int) -> None:
        doll = maquette.load(graphs / "doll.ron", cache=None)
        run = doll.run(levels=levels, progress=lambda _: times[levels].append(time.perf_counter()))
        found[levels] = run["model.ply"].hash

    threads = [threading.Thread(target=work, args=(levels,)) for levels in times]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == expected
    assert max(span[0] for span in times.values()) < min(span[-1] for span in times.values()), "one waited for the other"


def test_one_graph_is_run_by_several_threads(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron", cache=None)
    expected = {growth: maquette.load(graphs / "doll.ron", cache=None).run(growth=growth)["model.ply"].hash for growth in (1, 2, 3, 4)}
    found: dict[int, str] = {}

    def work(growth: int) -> None:
        found[growth] = doll.run(growth=growth)["model.ply"].hash

    threads = [threading.Thread(target=work, args=(growth,)) for growth in expected]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == expected


def in_a_child(work: object, seconds: float = 10.0) -> str:
    """Runs a function in a child made by `fork` and returns its output; kills the child if it hangs."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            signal.alarm(int(seconds))
            os.write(write, str(work()).encode())  # type: ignore[operator]
        except BaseException as error:  # noqa: BLE001
            os.write(write, f"error: {error!r}".encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as file:
        told = file.read()
    os.waitpid(child, 0)
    return told


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_child_gets_a_result_within_a_second(graphs: pathlib.Path) -> None:
    doll = maquette.load(graphs / "doll.ron")
    run = doll.run(levels=0)
    expected = run["model.ply"].hash
    assert doll.run(levels=0, growth=7)["model.ply"].hash != expected

    def work() -> str:
        start = time.perf_counter()
        again = doll.run(levels=0)["model.ply"].hash
        # Large enough to be hashed by several threads.
        made = maquette.Field(np.ones((600, 600))).hash
        picture = len(run["model.ply"].render(size=(64, 64)).pixels)
        seconds = time.perf_counter() - start
        return f"{again} {len(made)} {picture} {seconds < 1.0}"

    assert in_a_child(work) == f"{expected} 64 64 True"
    # The same while another thread of the parent is busy.
    thread = threading.Thread(target=lambda: doll.run(levels=3))
    thread.start()
    time.sleep(0.05)
    told = in_a_child(work)
    thread.join()
    assert told == f"{expected} 64 64 True"


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_the_pools_of_multiprocessing_work(graphs: pathlib.Path) -> None:
    import multiprocessing

    doll = maquette.load(graphs / "doll.ron", cache=None)
    expected = [_skin(doll, growth).hash for growth in (1, 2, 3)]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        found = pool.starmap(_skin_of, [(str(graphs / "doll.ron"), growth) for growth in (1, 2, 3)])
    assert [value.hash for value in found] == expected


def _skin(graph: maquette.Graph, growth: float) -> maquette.Value:
    return graph.run([], nodes="skin", growth=growth, levels=0)["skin"]


def _skin_of(path: str, growth: float) -> maquette.Value:
    return _skin(maquette.load(path, cache=None), growth)


def test_the_whole_command_line_is_in_the_module(graphs: pathlib.Path, tmp_path: pathlib.Path, program) -> None:  # type: ignore[no-untyped-def]
    def words(*given: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-m", "maquette", *given], capture_output=True, text=True, cwd=tmp_path)

    for given in (["--version"], ["nodes"], ["check", str(graphs / "doll.ron")], ["run"], ["why", str(graphs / "doll.ron"), "rad"]):
        ours, theirs = words(*given), program(*given, cwd=tmp_path)
        assert (ours.returncode, ours.stdout, ours.stderr) == (theirs.returncode, theirs.stdout, theirs.stderr)
    assert words("run", str(graphs / "doll.ron"), "--out", "here").returncode == 0
    assert (tmp_path / "here/model.glb").stat().st_size > 1e6
    child = subprocess.Popen([sys.executable, "-m", "maquette", "watch", str(graphs / "doll.ron"), "--out", "here"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    time.sleep(2)
    child.send_signal(signal.SIGINT)
    assert child.wait(5) in (0, 130)
