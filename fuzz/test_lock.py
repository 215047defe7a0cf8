"""The targets of fuzzing are a workspace of their own, whose lock file goes out of date in silence."""

import tomllib
import unittest
from pathlib import Path

FUZZ = Path(__file__).parent


def dependencies(lock):
    """What each of our packages depends on, by a lock file."""
    packages = tomllib.loads(lock.read_text())["package"]
    names = lambda package: {one.split(" ")[0] for one in package.get("dependencies", [])}
    return {package["name"]: names(package) for package in packages if "source" not in package}


class Lock(unittest.TestCase):
    def test_our_packages_depend_on_what_they_depend_on_in_the_project(self):
        ours, project = dependencies(FUZZ / "Cargo.lock"), dependencies(FUZZ.parent / "Cargo.lock")
        for name in ours.keys() & project.keys():
            with self.subTest(package=name):
                # Dependencies of tests are in the project's lock file alone.
                missing = self.normal(name) & project[name] - ours[name]
                self.assertFalse(missing, "`cargo metadata` in fuzz/ writes a new lock file")

    def normal(self, name):
        """The dependencies of a package that are neither of its tests nor optional, as its manifest names them."""
        for manifest in FUZZ.parent.glob("**/Cargo.toml"):
            if "target" in manifest.relative_to(FUZZ.parent).parts:
                continue
            text = tomllib.loads(manifest.read_text())
            if text.get("package", {}).get("name") == name:
                all = text.get("dependencies", {}).items()
                is_optional = lambda one: isinstance(one, dict) and one.get("optional", False)
                return {name for name, one in all if not is_optional(one)}
        return set()


if __name__ == "__main__":
    unittest.main()
