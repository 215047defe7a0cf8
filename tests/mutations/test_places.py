"""Where faults are to be put: what moves in the program must be found there again."""

import unittest
from pathlib import Path

from law import FAULTS
from mutations import MUTATIONS

ROOT = Path(__file__).resolve().parents[2]


class Places(unittest.TestCase):
    def test_what_a_fault_replaces_stands_there_once(self):
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
