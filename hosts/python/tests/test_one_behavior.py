"""Tests that each option of a run has the same effect on the command line, in `maquette serve`, in the Blender add-on and in Python.

`tests/hosts/table.py` has the options.
"""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

import pytest

import maquette

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "tests/hosts"))

import behavior  # noqa: E402
import hosts  # noqa: E402
import outcome  # noqa: E402
import project  # noqa: E402
import table  # noqa: E402

pytestmark = pytest.mark.every_change

PROGRAM = [os.environ.get("MAQUETTE_PROGRAM", str(ROOT / "target/release/maquette"))]
# The command of the Blender extension, but with this Python.
WORKER = [sys.executable, "-I", str(hosts.ADDON_FOLDER / "worker.py"), str(pathlib.Path(maquette.__file__).parents[1])]
HOSTS = {
    hosts.PYTHON: hosts.module,
    hosts.COMMAND_LINE: hosts.command_line(PROGRAM),
    hosts.SERVE: hosts.serve_host(PROGRAM),
    hosts.ADDON: hosts.serve_host(WORKER, hosts.AddonClient),
}


@pytest.mark.parametrize("row", table.ROWS, ids=lambda row: row.name)
def test_a_row_of_the_table_is_the_same_by_all_hosts(row: table.Row, tmp_path: pathlib.Path) -> None:
    behavior.check(row, HOSTS, PROGRAM, tmp_path)


def test_what_a_host_lacks_is_in_the_table_with_a_reason_and_tried() -> None:
    tried = {(host, option) for row in table.ROWS for option in row.options for host in HOSTS}
    assert set(table.LACKS) <= tried and all(table.LACKS.values())


def test_every_option_of_the_command_line_is_in_the_table() -> None:
    words = subprocess.run([*PROGRAM, "run", "--help"], capture_output=True, text=True, check=True).stdout.split()
    options = {word.strip("-,").split("[")[0].replace("-", "_") for word in words if word.startswith("--")}
    ours = {"no_cache": "cache", "no_pins": "pins", "no_provenance": "provenance", "only": "outputs", "root": "roots", "input": "input_files"}
    in_table = {option for row in table.ROWS for option in row.options}
    # Options about the output and about the command itself.
    others = {"help", "version", "json", "events"}
    assert {ours.get(option, option) for option in options} - others <= in_table


def test_all_hosts_say_why_a_node_would_run(tmp_path: pathlib.Path) -> None:
    place = project.make(tmp_path)
    environment = hosts.environment(place)
    run = [*PROGRAM, "run", "it.ron"]
    subprocess.run(run, cwd=place, env=environment, check=True, capture_output=True)
    path = place / "it.ron"
    path.write_text(path.read_text().replace('"levels": Integer(default: 1', '"levels": Integer(default: 2'))
    for node in ("box", "skin", "turned", "idle", "part/moved", "nothing"):
        told = subprocess.run([*PROGRAM, "why", "it.ron", node], cwd=place, env=environment, capture_output=True, text=True)
        with hosts.working_in(place):
            try:
                mine = maquette.load("it.ron").why(node)
            except KeyError:
                mine = None
        answers = []
        for command, kind in ((PROGRAM, hosts.Server), (WORKER, hosts.AddonClient)):
            server = kind([*command, "serve", "--stdio"], place)
            answers.append(server.ask("why", lambda *_: None, {"graph": "it.ron", "node": node}))
            server.stop()
        if mine is None:
            assert told.returncode == 2 and [it["event"] for it in answers] == ["refused"] * 2
        else:
            texts = {outcome.without_folder(text, place).rstrip("\n") for text in (told.stdout, mine, answers[0]["why"], answers[1]["why"])}
            assert len(texts) == 1, texts
