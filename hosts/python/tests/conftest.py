"""Fixtures: a copy of the project's graphs, a separate cache for each test, and the command line."""

from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
from typing import Callable, Iterator

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
SHARED = ROOT.parent / "shared"


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "every_change: is run for every change, not only by `just nightly`")


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """A cache for each test, so that tests do not share results."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("MAQUETTE_CACHE", str(folder))
    return folder


@pytest.fixture
def graphs(tmp_path: pathlib.Path) -> pathlib.Path:
    """A copy of the project's graphs, which tests may change."""
    folder = tmp_path / "graphs"
    shutil.copytree(ROOT / "graphs", folder, ignore=shutil.ignore_patterns("goldens", "pictures"))
    return folder


@pytest.fixture
def program() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs the program that `hosts/python/test` builds."""
    path = os.environ.get("MAQUETTE_PROGRAM", str(ROOT / "target/release/maquette"))
    assert os.path.exists(path), f"there is no {path}: `bash hosts/python/test` builds it"

    def run(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run([path, *words], capture_output=True, text=True, **options)  # type: ignore[call-overload, no-any-return]

    return run


@pytest.fixture(scope="session", autouse=True)
def no_display() -> Iterator[None]:
    """Makes Matplotlib draw into files."""
    os.environ["MPLBACKEND"] = "Agg"
    yield
