"""Tests that the lock file of the fuzz targets, which are a separate workspace, is up to date."""

import tomllib
import unittest
from pathlib import Path

PROJECT = Path(__file__).parent.parent


def locked_dependencies():
    """The dependencies of each of our packages in the lock file of the fuzz targets."""
    packages = tomllib.loads((PROJECT / "fuzz/Cargo.lock").read_text())["package"]
    for package in packages:
        if "source" not in package:
            yield package["name"], {one.split(" ")[0] for one in package.get("dependencies", [])}


def required_dependencies():
    """The non-optional dependencies of each of our packages in its manifest."""
    for manifest in [*PROJECT.glob("src/*/Cargo.toml"), *PROJECT.glob("nodes/*/Cargo.toml")]:
        text = tomllib.loads(manifest.read_text())
        dependencies = text.get("dependencies", {}).items()
        is_optional = lambda one: isinstance(one, dict) and one.get("optional", False)
        yield text["package"]["name"], {name for name, one in dependencies if not is_optional(one)}


class Lock(unittest.TestCase):
    def test_the_lock_file_has_all_dependencies_of_our_packages(self):
        required = dict(required_dependencies())
        for name, has in locked_dependencies():
            with self.subTest(package=name):
                missing = required.get(name, set()) - has
                self.assertFalse(missing, "out of date: run `cargo metadata` in fuzz/, which writes a new lock file")


if __name__ == "__main__":
    unittest.main()
