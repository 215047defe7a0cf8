"""Tests that each option of a run has the same effect in Blender's engine, on the command line and in the Python module of the extension.

`tests/hosts/table.py` has the options; `hosts/python/tests` has the same tests without Blender.
"""

from __future__ import annotations

import functools
import pathlib
import sys
from typing import Any

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[3] / "tests/hosts"))

import behavior  # noqa: E402
import hosts  # noqa: E402
import table  # noqa: E402


@pytest.mark.parametrize("row", table.ROWS, ids=lambda row: row.name)
def test_a_row_of_the_table_is_the_same_in_blender(row: table.Row, addon: Any, tmp_path: pathlib.Path) -> None:
    command = addon.engine.command()[: -len(["serve", "--stdio"])]
    client = functools.partial(hosts.AddonClient, make=addon.client.Client)
    found = {hosts.PYTHON: hosts.module, hosts.COMMAND_LINE: hosts.command_line(command), hosts.ADDON: hosts.serve_host(command, client)}
    behavior.check(row, found, command, tmp_path)
