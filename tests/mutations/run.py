"""Inserts faults into the program, one at a time, and checks that the graph tests notice them.

usage: run.py [COPY] [NUMBER]...

Works in a copy of the sources in COPY or, by default, in a new temporary folder, never in the sources themselves. The copy has its own
build folder, so that each fault costs one incremental build. Tests the faults with these numbers, by default all. First runs the tests
without a fault, also with one thread, which must pass. Prints one line for each fault, then `N passed, N failed`; exits with 1 if fewer
than 57 of 60 are noticed. Takes about an hour on two cores.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mutations import MUTATIONS

ROOT = Path(__file__).resolve().parents[2]
SKIPPED = {"target", ".git", "out", "fuzz"}
WANTED = 57


def copy(to):
    def ignore(folder, names):
        return [name for name in names if name in SKIPPED and Path(folder) == ROOT]

    shutil.copytree(ROOT, to, ignore=ignore, dirs_exist_ok=True)


def build(tree):
    command = ["cargo", "build", "--quiet", "--package", "maquette-program", "--bin", "maquette"]
    # Without debug information, which would take half of the build time.
    environment = os.environ | {"CARGO_PROFILE_DEV_DEBUG": "0"}
    return subprocess.run(command, cwd=tree, capture_output=True, text=True, env=environment)


def test(tree, *more):
    program = tree / "target/debug/maquette"
    command = [program, "test", "graphs", "--cold", *more]
    return subprocess.run(command, cwd=tree, capture_output=True, text=True, timeout=300)


def noticed_by(output):
    failed = [line.split()[1:3] for line in output.splitlines() if line.startswith(("failed ", "broken "))]
    names = [f"{Path(graph).stem}/{case}" for graph, case in failed]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def main():
    tree = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp(prefix="mutations-"))
    wanted = [int(number) for number in sys.argv[2:]] or range(1, len(MUTATIONS) + 1)
    copy(tree)
    start = time.monotonic()
    made = build(tree)
    assert made.returncode == 0, made.stderr
    print(f"built in {time.monotonic() - start:.0f} s", flush=True)
    for more in [[], ["--threads", "1"]]:
        result = test(tree, *more)
        assert result.returncode == 0, f"the tests fail without a fault {more}:\n{result.stdout}{result.stderr}"
    passed, failed, unbuilt = 0, 0, 0
    for number, (name, old, new, kind) in enumerate(MUTATIONS, 1):
        if number not in wanted:
            continue
        path = tree / name
        text = path.read_text()
        tested = text.split("#[cfg(test)]")[0]
        assert tested.count(old) == 1, f"{name}: expected `{old}` once, found it {tested.count(old)} times"
        path.write_text(text.replace(old, new, 1))
        start = time.monotonic()
        made = build(tree)
        middle = time.monotonic()
        try:
            if made.returncode != 0:
                unbuilt += 1
                print(f"{number:2} unbuilt   {name}: {made.stderr.strip()[:300]}", flush=True)
                continue
            try:
                result = test(tree)
                noticed, by = result.returncode != 0, noticed_by(result.stdout)
            except subprocess.TimeoutExpired:
                noticed, by = True, "timeout"
            passed, failed = passed + noticed, failed + (not noticed)
            word = "noticed" if noticed else "MISSED "
            seconds = f"{middle - start:.0f} + {time.monotonic() - middle:.0f} s"
            print(f"{number:2} {word}   {name} ({kind}), {seconds}: {by}", flush=True)
        finally:
            path.write_text(text)
    print(f"{passed} passed, {failed} failed" + (f"; {unbuilt} did not compile" if unbuilt else ""))
    sys.exit(failed > 60 - WANTED)


if __name__ == "__main__":
    main()
