#!/usr/bin/env python3
"""Measures all figures that have a bar (an upper limit):  python3 benches/bars/bars.py [WORD ...]

    WORD ...      only bars whose subject or name contains one of these words; by default all, which takes most of an hour

Prints a table of our figure, the peer's, the bar and the verdict. Rows of `benches/peers/peers.py` are measured as there, alternating with
their peers, and with the same environment variables. Other benchmarks and tests print their figures themselves, and are run again if one
misses its bar. The exit code is 1 if a bar is missed by more than noise, or if a figure is not printed. On a busy machine, bars are not
judged instead of missed. Bars in milliseconds were set on an AMD EPYC of family 26 with AVX-512, and apply to every machine; if one is
missed, and the time of a peer on that EPYC is known, the ratio to the peer is printed for both machines. Bars that are checked by tests in
CI, by `just python` or by `just blender`, and build times, are not included.

To add a bar, add a line to BARS; for a bar in milliseconds of a row of peers, set the bar in that row.
"""
import itertools
import math
import os
import re
import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Callable

PROJECT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PROJECT / "benches/peers"))
import peers  # noqa: E402
from peers import THREADS, Row  # noqa: E402

# The maximum number of runs of a benchmark that misses a bar on a quiet machine.
RUNS = 3
# The time in seconds after which a peer in a row is not measured further.
PEER_SECONDS = 20


# ---------------------------------------------------------------- bars
@dataclass
class Bar:
    # The group of the bar.
    subject: str
    name: str
    # A row of peers, or a command that prints figures.
    by: Row | tuple[str, ...]
    # The maximum of our figure, in `unit`.
    limit: float | None
    unit: str = "ms"
    # The pattern of printed lines: # is one figure or several separated by commas, * is any text, a space is any number of spaces. Results
    # of divan have the form `GROUP/ARGUMENT: # ms`, with the median. If several lines match, the greatest figure counts.
    line: str = ""
    # Selects a figure of a line.
    take: Callable[[list[float]], float] = max
    # The maximum ratio of our time to the peer's; without a peer, `limit` applies.
    times: float | None = None
    # A word in the name of that peer; by default the fastest peer.
    peer_word: str = ""
    # The name of a peer, and its time in milliseconds on the machine on which the bar was set.
    reference: tuple[str, float] | None = None


def row_bar(subject, word, times=None, peer_word="", reference=None):
    """The bar of a row of the table of peers, by the name of our work or the beginning of the row's name."""
    row = next(row for row in peers.ROWS if row.ours == word or row.name.startswith(word))
    return Bar(subject, row.name, row, row.bar, times=times, peer_word=peer_word, reference=reference)


def bench(name, *words):
    """The command of a benchmark. Without `--package`, so that all benchmarks share one build of the engine."""
    return ("cargo", "bench", "-q", "--bench", name, "--", *words)


def growth(figures):
    return figures[1] - figures[0]


MAQUETTE, CACHE = PROJECT / "target/release/maquette", peers.WORK / "cache"
RUN_DOLL = [MAQUETTE, "run", PROJECT / "graphs/doll.ron", "--threads", str(THREADS), "--json", "--out", peers.OUT]
DOLL = Row("doll.ron, from the start to its files", [*RUN_DOLL, "--no-cache"])
DOLL_AGAIN = Row("doll.ron again, from the cache on disk", [*RUN_DOLL, "--cache", CACHE])
TESTS = Row("maquette test graphs, from the cache", [MAQUETTE, "test", PROJECT / "graphs", "--threads", str(THREADS), "--cache", CACHE])

LOCAL, INTERPOLATE, WATCH, PAGE = bench("local"), bench("interpolate", "nearest feet: Loop", "fit of"), bench("watch"), bench("page")
ENGINE, COMPARE, REUSE = (bench(name) for name in ("engine", "compare", "reuse"))
FILL, BATCH = bench("fill", "model classes"), bench("batch")
SHEET = ("bash", "tests/sheet/run", "thousand")

BARS = [
    Bar("main job", DOLL.name, DOLL, 120),
    Bar("main job", "doll.ron, memory", DOLL, 150, "MB"),
    Bar("main job", "check a graph of 500 nodes", bench("check"), 20, line="check/500: # ms"),
    row_bar("first publication", "segment"),
    row_bar("first publication", "edges", reference=("OpenCV", 25.4)),
    row_bar("first publication", "edges-percentile", reference=("OpenCV", 25.4)),
    row_bar("first publication", "points-2", reference=("SciPy", 61.7)),
    row_bar("first publication", "points-3", reference=("SciPy", 61.8)),
    row_bar("first publication", "normals-2", reference=("SciPy", 373)),
    row_bar("first publication", "normals-3", reference=("SciPy", 361)),
    row_bar("first publication", "pipeline", reference=("OpenCV + splinepy + pymeshlab", 2639)),
    row_bar("first publication", "read-pcd"),
    row_bar("first publication", "read-ply", reference=("trimesh", 3.5)),
    row_bar("first publication", "write-ply", reference=("trimesh", 11.7)),
    Bar("memory", "10 000 nodes, first evaluation", ENGINE, 12, line="chain_first_evaluation: # ms"),
    Bar("memory", "10 000 nodes, nothing changed", ENGINE, 0.3, line="chain_nothing_changed: # ms"),
    Bar("memory", "10 000 nodes, last changed", ENGINE, 1, line="chain_last_changed: # ms"),
    Bar("memory", "10 000 nodes, first changed", ENGINE, 12, line="chain_first_changed: # ms"),
    Bar("memory", "cheap node behind a subdivision", ENGINE, 10, line="cheap_behind_subdivision_changed: # ms"),
    Bar("memory", "the same, nothing changed", ENGINE, 0.05, line="cheap_behind_subdivision_nothing_changed: # ms"),
    Bar("memory", DOLL_AGAIN.name, DOLL_AGAIN, 30),
    Bar("watch", "save to problems, half", WATCH, 30, line="save to problems shown, broken graph p50 # ms"),
    Bar("watch", "save to problems, 95 of 100", WATCH, 80, line="save to problems shown, broken graph * p95 # ms"),
    Bar("watch", "save to check, half", WATCH, 30, line="save to check shown, good graph p50 # ms"),
    Bar("watch", "save to check, 95 of 100", WATCH, 80, line="save to check shown, good graph * p95 # ms"),
    Bar("watch", "save to outputs, half", WATCH, 60, line="save to outputs written p50 # ms"),
    Bar("watch", "save to outputs, 95 of 100", WATCH, 120, line="save to outputs written * p95 # ms"),
    Bar("watch", "nodes run by 20 comments", WATCH, 0, "nodes", "nodes run by 20 comments #"),
    Bar("watch", "processor time without work, of 10 s", WATCH, 0, "ticks", "processor time in * without work # ticks"),
    Bar("golden tests", "compare two meshes of a million faces", COMPARE, 1500, line="million_faces/*: # ms"),
    Bar("golden tests", "picture of a million faces", COMPARE, 300, line="picture/1000000: # ms"),
    Bar("golden tests", TESTS.name, TESTS, 1000),
    Bar("graphs of graphs", "check 2 041 uses", REUSE, 100, line="check_2041_uses: # ms"),
    Bar("graphs of graphs", "evaluate 3 745 nodes, 2 us each", REUSE, 7.5, line="evaluate_3745_nodes: # ms"),
    row_bar("subdivision", "catmull-clark"),
    row_bar("subdivision", "catmull-clark-places"),
    row_bar("subdivision", "loop"),
    row_bar("subdivision", "loop-places"),
    row_bar("subdivision", "doo-sabin"),
    Bar("subdivision", "Catmull-Clark, limit and normals", bench("subdivide", "with_limit"), 90, line="with_limit_and_normals/CatmullClark: # ms"),
    row_bar("interpolation", "interpolate-loop"),
    row_bar("interpolation", "interpolate-catmull-clark"),
    Bar("interpolation", "closest feet, 1 516 vertices, Loop", INTERPOLATE, 300, line="nearest feet: Loop, * vertices #"),
    Bar("interpolation", "fit of the doll, 95 of 100 within", INTERPOLATE, 0.1, "mm", "scan to surface: * 95 % #, 99 %"),
    row_bar("free-form", "ffd-64", times=1.0, peer_word="plain C"),
    row_bar("free-form", "ffd-256", times=0.75, peer_word="plain C"),
    row_bar("free-form", "ffd-near", times=0.4, peer_word="plain C"),
    row_bar("free-form", "ffd-drag"),
    row_bar("filling", "fill", reference=("CGAL", 14.8)),
    Bar("filling", "exemplar, smooth, 1 094 lost", FILL, 0.25, "s", "A, smooth *; * #, rms"),
    Bar("filling", "exemplar, sharp, 1 432 lost", FILL, 0.25, "s", "B, sharp *; * #, rms"),
    Bar("filling", "exemplar, relief, 668 lost", FILL, 0.65, "s", "C, relief *; * #, rms"),
    row_bar("whole skin", "reconstruct"),
    row_bar("whole skin", "reconstruct-normals"),
    row_bar("whole skin", "reconstruct-clean"),
    Bar("whole skin", "off the torus, 1 % noise", bench("reconstruct", "100000 points alone, noise 0.01"), 0.5, "apart", "noise 0.01 * * * #"),
    Bar("live page", "1.5 M moved triangles in the card", PAGE, 150, line="from the message to the buffers, *: # ms in half"),
    Bar("live page", "save of 10.8 M triangles to the page's message", PAGE, 800, line="from the save to the message: # ms in half"),
    Bar("live page", "move of a slider to the same", PAGE, 300, line="from a move of a slider to its message: # ms in half"),
    Bar("live page", "local edit of 10.8 M triangles in the card", PAGE, 300, line="from that message to the buffers: # ms in half"),
    Bar("live page", "bytes of such an edit", PAGE, 10, "MB", "for which # MB were sent; the program"),
    Bar("live page", "bytes of a local edit", PAGE, 10, "%", "another nose of the doll: * MB, # %"),
    Bar("live page", "objects left by 500 edits", PAGE, 1, "MB", "page # and # MB of objects", growth),
    Bar("language", "check ForEach over 5 000 regions", bench("each", "check"), 100, line="check: # ms"),
    Bar("editors", "slowest request, 95 of 100", bench("lsp"), 50, line="95th of a hundred # ms"),
    Bar("batches", "held task of the doll", BATCH, 2, line="tasks of doll *, nothing has changed* # ms a task"),
    Bar("batches", "the same in the first run after", BATCH, 2, line="tasks of doll *, first run after* # ms a task"),
    Bar("batches", "sheet of 1 000 tasks opens", SHEET, 1000, line="open after # ms"),
    Bar("batches", "key to picture in it", SHEET, 50, line="keys # ms"),
    row_bar("real scans", "align", times=1.0, peer_word="Open3D"),
    row_bar("real scans", "union", times=1.0, peer_word="of meshes"),
    row_bar("real scans", "unwrap"),
    row_bar("real scans", "remesh", times=1.0, peer_word="MeshLab"),
    row_bar("real scans", "simplify", times=1.0, peer_word="MeshLab"),
    row_bar("real scans", "simplify-texture", times=1.0, peer_word="MeshLab"),
    row_bar("real scans", "outliers", times=1.0, peer_word="Open3D"),
    Bar("local changes", "growth by a mm, 10.8 M faces", LOCAL, 40, line="growth by a millimeter: # ms"),
    Bar("local changes", "handle of an FFD on the same", LOCAL, 40, line="handle of an FFD by *: # ms"),
    Bar("local changes", "save to written PLY of the same", LOCAL, 120, line="from a millimeter to the written PLY file: # ms"),
]


# ---------------------------------------------------------------- printed figures
FIGURES = r"(-?\d[\d.]*(?:, -?\d[\d.]*)*)"
MILLISECONDS = {"ns": 1e-6, "µs": 1e-3, "ms": 1.0, "s": 1e3}


def lines(text):
    """The lines of a benchmark's output; a leaf of divan's tree becomes a line with its median."""
    path = []
    for line in text.splitlines():
        branch = re.match(r"([│ ]*)[├╰]─ (.+?)  +(.*)", line)
        if not branch:
            yield " ".join(line.split())
            continue
        indent, name, rest = branch.groups()
        path[len(indent) // 3 :] = [name]
        number, _, unit = rest.split("│")[2].strip().partition(" ")
        if number:
            yield f"{'/'.join(path)}: {float(number) * MILLISECONDS[unit]:.9f} ms"


def figure(bar, text):
    """The figure of a bar in an output; None if no line has it."""
    pattern = "".join({"#": FIGURES, "*": ".*?"}.get(letter) or re.escape(letter) for letter in bar.line)
    matches = filter(None, (re.search(pattern, line) for line in lines(text)))
    return max((bar.take([float(number) for group in match.groups() for number in group.split(", ")]) for match in matches), default=None)


# ---------------------------------------------------------------- a quiet machine
# A machine is quiet if other programs use at most this fraction of a core, and if the upper quartile of the times of a fixed loop is at
# most this multiple of its fastest time.
OTHERS, SLOWER = 0.1, 1.15


class Machine:
    def __init__(self):
        self.pool, self.data, self.fastest = ThreadPoolExecutor(THREADS), bytes(1 << 24), math.inf
        self.loops, self.others = [], 0.0

    def loop(self):
        """Measures a fixed amount of work on each thread, about 10 ms."""
        start = time.perf_counter()
        list(self.pool.map(lambda _: sha256(self.data).digest(), range(THREADS)))
        self.loops.append(time.perf_counter() - start)
        self.fastest = min(self.fastest, self.loops[-1])

    def sample(self):
        self.others = max(self.others, busy_cores())
        for _ in range(5):
            self.loop()

    def observe(self, measure):
        """Calls a function and returns its result; observes the load of the machine before, after, and when the function calls `loop`."""
        self.loops, self.others = [], 0.0
        self.sample()
        result = measure()
        self.sample()
        return result

    def slower(self):
        return quartiles(self.loops)[2] / self.fastest

    def is_quiet(self):
        return self.others <= OTHERS and self.slower() <= SLOWER

    def __str__(self):
        return f"other programs use {self.others:.1f} cores, a fixed loop is {self.slower():.2f} times slower"


def busy_cores(seconds=0.5):
    """The number of busy cores while this program sleeps; 0 if the system does not report it."""

    def busy():
        user, nice, system, _idle, _waiting, *others = map(int, Path("/proc/stat").read_text().split("\n")[0].split()[1:9])
        return (user + nice + system + sum(others)) / os.sysconf("SC_CLK_TCK")

    if not Path("/proc/stat").exists():
        return 0.0
    before, start = busy(), time.perf_counter()
    time.sleep(seconds)
    return (busy() - before) / (time.perf_counter() - start)


# ---------------------------------------------------------------- verdicts
def quartiles(samples):
    return statistics.quantiles(samples, n=4, method="inclusive") if len(samples) > 1 else samples * 3


def verdict(samples, limit, slower, is_quiet):
    """Judges samples: the median must not exceed the limit. It is missed by more than noise if three of four samples exceed the limit
    times `slower`, the slowdown of the machine."""
    low, middle, _ = quartiles(samples)
    if middle <= limit:
        return "holds"
    if not is_quiet:
        return "not judged"
    return "MISSED" if low > limit * slower else "within noise"


@dataclass
class BarResult:
    bar: Bar
    samples: list[float]
    peer: str = ""
    theirs: float | None = None
    # The ratios of our time to the peer's, run by run.
    ratios: list[float] | None = None
    # The reason why there is no peer, or no sample.
    why: str = ""

    def judge(self, machine):
        samples, limit = (self.ratios, self.bar.times) if self.ratios and self.bar.times else (self.samples, self.bar.limit)
        if not samples or limit is None:
            return self.why
        word = verdict(samples, limit, machine.slower(), machine.is_quiet())
        return word if word == "holds" else "; ".join([f"{word}: {machine}" if word == "not judged" else word, *self.peer_notes()])

    def peer_notes(self):
        """The ratio to the peer here, and that of the bar on the machine on which it was set, for information only."""
        name, reference = self.bar.reference or ("", 0.0)
        if reference and self.ratios and self.peer.startswith(name):
            yield f"{statistics.median(self.ratios):.2g} of the peer, the bar was {self.bar.limit / reference:.2g} of it"


def measure_row(bars, machine):
    try:
        measured = machine.observe(lambda: peers.measure(bars[0].by, bars[0].peer_word, machine.loop, PEER_SECONDS))
    except (Exception, SystemExit) as error:
        measured = peers.RowResult(bars[0].by, missing=[f"no figure: {error!r}"])
    for bar in bars:
        if bar.unit == "MB":
            yield BarResult(bar, [measured.peak] if measured.peak else [], why="; ".join(measured.missing))
            continue
        found = BarResult(bar, measured.ours, why="; ".join(measured.missing))
        if measured.peers:
            found.peer, theirs = min(measured.peers.items(), key=lambda peer: statistics.median(peer[1]))
            found.theirs = statistics.median(theirs)
            found.ratios = [ours / theirs for ours, theirs in zip(measured.ours, theirs)]
        yield found


def measure_command(bars, machine):
    samples = [[] for _ in bars]
    for _ in range(RUNS):
        done = machine.observe(lambda: subprocess.run(bars[0].by, cwd=PROJECT, capture_output=True, text=True))
        for bar, of_bar in zip(bars, samples):
            found = None if done.returncode else figure(bar, done.stdout)
            of_bar += [] if found is None else [found]
        misses = any(of_bar and of_bar[-1] > bar.limit for bar, of_bar in zip(bars, samples))
        if not misses or not machine.is_quiet():
            break
    skipped = [line for line in done.stdout.splitlines() if line.startswith("skipped")]
    why = skipped[0] if skipped else f"no figure: {(done.stderr.strip() or 'no such line').splitlines()[-1]}"
    return [BarResult(bar, of_bar, why="" if of_bar else why) for bar, of_bar in zip(bars, samples)]


# ---------------------------------------------------------------- the table
def number(x):
    return f"{x:.0f}" if x >= 100 else f"{x:.3g}"


LINE = "| {:17} | {:43} | {:29} | {:40} | {:>5} | {:>11} | {} |"


def show(found, said):
    bar = found.bar
    ours = peer = ratio = ""
    if found.samples:
        low, middle, high = quartiles(found.samples)
        spread = f" ({number(low)} to {number(high)})" if len(found.samples) > 1 else ""
        ours = f"{number(middle)} {bar.unit}{spread}"
    if found.theirs is not None:
        peer, ratio = f"{number(found.theirs)} ms, {found.peer}", f"{statistics.median(found.ratios):.2f}"
    elif found.samples:
        peer = found.why[:40]
    bound = f"{bar.times:g} x peer" if bar.times and (found.ratios or bar.limit is None) else f"{bar.limit:g} {bar.unit}"
    print(LINE.format(bar.subject, bar.name, ours, peer, ratio, bound, said), flush=True)


def output(*command):
    return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True).stdout.strip()


def processor():
    text = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    field = lambda name: (re.search(rf"^{name}\s*: (.*)", text, re.MULTILINE) or ("", "unknown"))[1]
    vectors = next((word for word in ["avx512f", "avx2"] if word in field("flags").split()), "no avx2")
    return f"{field('model name')} of family {field('cpu family')}, {vectors}"


def main():
    words = [word.lower() for word in sys.argv[1:]]
    bars = [bar for bar in BARS if not words or any(word in f"{bar.subject} {bar.name}".lower() for word in words)]
    needs_peers = any(bar.by in peers.ROWS for bar in bars)
    if needs_peers and peers.PEERS.is_dir():
        peers.prepare()
    elif needs_peers:
        print(f"skipped: the rows of peers, since {peers.NO_PEERS}")
        bars = [bar for bar in bars if bar.by not in peers.ROWS]
    if any(isinstance(bar.by, Row) for bar in bars):
        peers.build()
    commit = (output("git", "rev-parse", "--short", "HEAD") or "no commit") + (" and changes" if output("git", "status", "--porcelain") else "")
    machine = Machine()
    machine.observe(lambda: None)
    print(f"{commit}; {THREADS} threads of {os.cpu_count()}, {processor()}; load {os.getloadavg()[0]:.2f}, {machine}\n")
    print(LINE.format("subject", "what", f"ours, {commit}", "peer", "ratio", "bar", "verdict"))
    print(LINE.format("---", "---", "---", "---", "---", "---", "---"))
    verdicts = {}
    for by, group in itertools.groupby(bars, key=lambda bar: bar.by):
        measure = measure_row if isinstance(by, Row) else measure_command
        for found in measure(list(group), machine):
            said = found.judge(machine)
            show(found, said)
            verdicts.setdefault(re.split("[:;]", said)[0], []).append(found.bar.name)
    print()
    for said, names in verdicts.items():
        print(f"{len(names)} {said}" + ("" if said == "holds" else f": {'; '.join(names)}"))
    if "not judged" in verdicts:
        print("The machine is not quiet.")
    sys.exit(1 if {"MISSED", "no figure"} & verdicts.keys() else 0)


if __name__ == "__main__":
    main()
