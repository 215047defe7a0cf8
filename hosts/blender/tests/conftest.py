"""Fixtures: Blender in this process, with the extension installed and enabled, and Blender in separate processes.

`hosts/blender/test` starts pytest in Blender's Python, with a user folder that is private to the tests.
"""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
from typing import Any, Callable, Iterator

import pytest

HERE = pathlib.Path(__file__).resolve().parent
COMMAND = HERE.parent / "command.py"
PACKAGE = "bl_ext.user_default.maquette"
Done = subprocess.CompletedProcess[str]

if not {"MAQUETTE_BLENDER", "MAQUETTE_ZIP", "BLENDER_USER_RESOURCES"} <= os.environ.keys():
    pytest.exit("these tests need an extension that is built and installed: `bash hosts/blender/test` does both", returncode=2)


@pytest.hookimpl(trylast=True)
def pytest_sessionstart() -> None:
    """Checks that the version of Blender is the requested one."""
    import bpy

    found = bpy.app.version_string
    # Some versions have a suffix: `5.2.3 LTS`.
    assert found.split()[0] == os.environ["MAQUETTE_BLENDER"], found
    assert bpy.utils.resource_path("USER") == os.environ["BLENDER_USER_RESOURCES"]


def pytest_report_header() -> str:
    """The version of Blender."""
    return f"blender: {os.environ['MAQUETTE_BLENDER']}"


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Exits with pytest's verdict before Blender's cleanup, which may crash."""
    status = getattr(config, "_maquette_status", None)
    if status is not None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Stores the verdict."""
    session.config._maquette_status = int(exitstatus)  # type: ignore[attr-defined]


@pytest.fixture(scope="session")
def addon() -> Iterator[Any]:
    """The package of the add-on, enabled as by a user."""
    import bpy

    assert bpy.ops.preferences.addon_enable(module=PACKAGE) == {"FINISHED"}
    yield sys.modules[PACKAGE]
    bpy.ops.preferences.addon_disable(module=PACKAGE)


@pytest.fixture
def empty(addon: Any) -> Any:
    """The package of the add-on, with an empty scene."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return addon


@pytest.fixture
def resources(tmp_path: pathlib.Path) -> pathlib.Path:
    """An empty user folder."""
    folder = tmp_path / "resources"
    folder.mkdir()
    return folder


@pytest.fixture
def blender(resources: pathlib.Path, tmp_path: pathlib.Path) -> Callable[[str], Done]:
    """Runs Python code in another Blender, which uses `resources`."""

    def run(text: str) -> Done:
        script = tmp_path / "script.py"
        script.write_text(f"{text}\nimport os, sys\nsys.stdout.flush()\nos._exit(0)\n")
        return process(resources, script)

    return run


@pytest.fixture
def extension(resources: pathlib.Path) -> Callable[..., Done]:
    """Runs `blender --command extension`, which uses `resources`."""

    def run(*words: object) -> Done:
        return process(resources, COMMAND, *words)

    return run


def process(resources: pathlib.Path, *words: object) -> Done:
    """Runs this Blender's Python in another process."""
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(resources)}
    return subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, env=environment, timeout=120)
