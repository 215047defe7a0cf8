#!/usr/bin/env python3
"""Checks how much is rebuilt after edits.

An edit of crates that use the packs recompiles no pack and keeps all cached results, and so does a change of a library that only the
commands use. An edit of a pack recompiles no other pack except those that use it. Works on a copy of the sources in target/rebuild.
"""

import json
import os
import pathlib
import shutil
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]
WORK = ROOT / "target/rebuild"
TREE = WORK / "tree"
ENVIRONMENT = {**os.environ, "CARGO_TARGET_DIR": str(WORK / "target"), "MAQUETTE_CACHE": str(WORK / "cache")}
# Crates that do not affect results.
ABOVE = ["edit", "diagram", "golden", "lsp", "preview", "cli"]


def copy():
    """Copies the current sources; unchanged files keep their modification times, which cargo compares."""
    listed = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True)
    names = {name.decode() for name in listed.stdout.split(b"\0") if name and (ROOT / name.decode()).is_file()}
    for path in [path for path in TREE.rglob("*") if path.is_file() and str(path.relative_to(TREE)) not in names]:
        path.unlink()
    for name in names:
        source, to = ROOT / name, TREE / name
        if not to.exists() or source.read_bytes() != to.read_bytes():
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, to)
            os.utime(to)


def edit(file, old, new):
    path = TREE / file
    text = path.read_text()
    assert old in text, f"{file} has no {old!r}"
    path.write_text(text.replace(old, new, 1))


def build():
    """Builds the program. Returns the crates of the workspace that were compiled."""
    command = ["cargo", "build", "--locked", "--bin", "maquette", "--message-format", "json"]
    output = subprocess.run(command, cwd=TREE, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True, check=True).stdout
    messages = [json.loads(line) for line in output.splitlines()]
    artifacts = [it for it in messages if it["reason"] == "compiler-artifact" and "lib" in it["target"]["kind"]]
    names = [it["target"]["name"] for it in artifacts if not it["fresh"] and str(TREE) in it["manifest_path"]]
    return {name.removeprefix("maquette_") for name in names}


def count_computed():
    """Runs the doll. Returns the number of computed nodes; results of all others were cached."""
    command = [WORK / "target/debug/maquette", "run", "graphs/doll.ron"]
    output = subprocess.run(command, cwd=TREE, env=ENVIRONMENT, capture_output=True, text=True, check=True)
    return (output.stdout + output.stderr).count("computed ")


def expect(what, compiled, is_cached, found, count):
    assert found == compiled, f"{what}: compiled {sorted(found)}, not {sorted(compiled)}"
    assert (count == 0) == is_cached, f"{what}: {count} nodes computed"
    print(f"ok {what}: compiled {', '.join(sorted(found))}; {count} nodes computed")


shutil.rmtree(WORK / "cache", ignore_errors=True)
copy()
build()
assert count_computed() > 0 and count_computed() == 0, "a second run must compute nothing"

for crate in ABOVE:
    edit(f"src/{crate}/lib.rs", "//!", "//! Edited.\n//!")
expect("an edit of crates that use the packs", set(ABOVE), True, build(), count_computed())

edit("Cargo.toml", 'open = { version = "5", default-features = false }', 'open = { version = "5", default-features = false, features = ["insecure"] }')
# The build script that creates ids depends on the workspace's manifest, so the crates that use it are compiled again, with the same ids.
compiled = build()
expect("another library of the commands", compiled, True, compiled, count_computed())

edit("nodes/image/threshold.rs", "//!", "//! Edited.\n//!")
compiled = build()
assert not compiled & {*ABOVE, "value", "node", "format", "graph", "engine"}, f"compiled {sorted(compiled)}"
expect("an edit of a pack", compiled, False, compiled, count_computed())
