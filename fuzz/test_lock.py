"""The targets of fuzzing are a workspace of their own, whose lock file goes out of date in silence."""

import tomllib
import unittest
from pathlib import Path

PROJECT = Path(__file__).parent.parent


def locked():
    """What each of our packages depends on, by the lock file of the targets."""
    packages = tomllib.loads((PROJECT / "fuzz/Cargo.lock").read_text())["package"]
    for package in packages:
        if "source" not in package:
            yield package["name"], {one.split(" ")[0] for one in package.get("dependencies", [])}


def asked():
    """What each of our packages always asks for, by its manifest."""
    for manifest in [*PROJECT.glob("src/*/Cargo.toml"), *PROJECT.glob("nodes/*/Cargo.toml")]:
        text = tomllib.loads(manifest.read_text())
        dependencies = text.get("dependencies", {}).items()
        is_optional = lambda one: isinstance(one, dict) and one.get("optional", False)
        yield text["package"]["name"], {name for name, one in dependencies if not is_optional(one)}


class Lock(unittest.TestCase):
    def test_the_lock_file_has_what_our_packages_ask_for(self):
        asked_for = dict(asked())
        for name, has in locked():
            with self.subTest(package=name):
                missing = asked_for.get(name, set()) - has
                self.assertFalse(missing, "`cargo metadata` in fuzz/ writes a new lock file")


if __name__ == "__main__":
    unittest.main()
