"""Tests that the examples of the documentation for users work."""

from __future__ import annotations

import os
import pathlib
import re
from typing import Any, Iterator

import bpy
import pytest
from test_live import folder  # noqa: F401

README = pathlib.Path(__file__).resolve().parents[1] / "README.md"


@pytest.fixture
def there(folder: pathlib.Path) -> Iterator[pathlib.Path]:  # noqa: F811
    """Makes the folder of a project the current one."""
    before = os.getcwd()
    os.chdir(folder)
    yield folder
    os.chdir(before)


def test_b10_the_examples_of_the_page_run(empty: Any, there: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    examples = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert len(examples) == 2
    names: dict[str, Any] = {}
    for example in examples:
        exec(compile(example, str(README), "exec"), names)
    said = re.search(r"^(\d+) vertices$", capsys.readouterr().out, re.MULTILINE)
    assert said and int(said[1]) > 1000
    assert (there / "frames.abc").stat().st_size > 10000 and "doll frames" in bpy.data.objects


def test_b10_operators_and_widgets_that_the_page_names_are_there(empty: Any) -> None:
    text = README.read_text()
    for name in set(re.findall(r"bpy\.ops\.(\w+\.\w+)", text)):
        group, _, operator = name.partition(".")
        assert operator in dir(getattr(bpy.ops, group)), name
    labels = {getattr(it, "bl_label", "") for it in bpy.types.Operator.__subclasses__()}
    for label in ("Bake Frames", "Edit as Nodes", "Reload"):
        assert label in text and label in labels
