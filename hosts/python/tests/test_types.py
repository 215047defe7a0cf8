"""Tests that type stubs are correct and that everything public is documented."""

from __future__ import annotations

import inspect
import pathlib
import subprocess
import sys

import maquette

HERE = pathlib.Path(__file__).resolve().parents[1]


def test_the_stubs_are_complete_and_true() -> None:
    done = subprocess.run([sys.executable, "-m", "mypy.stubtest", "maquette"], capture_output=True, text=True, cwd=HERE)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_and_its_examples_are_typed() -> None:
    package = pathlib.Path(maquette.__file__).parent
    assert (package / "py.typed").exists()
    words = ["--strict", "--ignore-missing-imports", "python/maquette", *map(str, (HERE / "examples").glob("*.py"))]
    done = subprocess.run([sys.executable, "-m", "mypy", *words], capture_output=True, text=True, cwd=HERE)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_mistake_of_a_user_is_found_by_types(tmp_path: pathlib.Path) -> None:
    (tmp_path / "it.py").write_text("import maquette\nmaquette.load('a.ron', memry='2GB')\nmaquette.load('a.ron').run().trace[0].stat\n")
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "it.py"], capture_output=True, text=True, cwd=tmp_path)
    assert "memry" in done.stdout and '"stat"' in done.stdout


def test_everything_that_users_see_is_documented() -> None:
    missing = []
    for name in maquette.__all__:
        thing = getattr(maquette, name)
        assert inspect.getdoc(thing), name
        if inspect.isclass(thing):
            for member in vars(thing):
                it = inspect.getattr_static(thing, member)
                shown = not member.startswith("_") and (callable(it) or isinstance(it, (property, staticmethod)))
                if shown and not inspect.getdoc(it):
                    missing.append(f"{name}.{member}")
    assert not missing
