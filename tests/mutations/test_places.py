"""Tests that the texts that faults replace exist in the program; they must be adapted when code changes."""

import unittest
from pathlib import Path

from law import FAULTS
from mutations import MUTATIONS

ROOT = Path(__file__).resolve().parents[2]


class Places(unittest.TestCase):
    def test_the_old_text_of_a_fault_occurs_once(self):
        changes = [change for _, changes in FAULTS for change in changes]
        changes += [(file, old, new) for file, old, new, _ in MUTATIONS]
        for file, old, new in changes:
            with self.subTest(file=file, old=old):
                path = ROOT / file
                text = path.read_text() if path.exists() else ""
                self.assertEqual(text.split("#[cfg(test)]")[0].count(old), 1)
                self.assertNotEqual(old, new)


if __name__ == "__main__":
    unittest.main()
