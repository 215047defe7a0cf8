"""The table of formats and programs, with notes."""

from __future__ import annotations

import fnmatch
from typing import Dict, Iterable, List, Tuple

from limits import Limit

# The names of kinds of values in the table.
KINDS = {"Mesh": "mesh", "ControlNet": "mesh", "Curve": "curve", "Surface": "surface", "Picture": "picture"}
KINDS |= dict.fromkeys(("Points", "RangeImage", "Region", "Handles"), "points")
KINDS |= dict.fromkeys(("Image", "Mask", "Labels", "Field"), "picture")

# The description of the difference for each program and file, which is empty if there is none.
Words = Dict[Tuple[str, str], str]


class Verdicts:
    """Matches differences with the known limits of programs."""

    def __init__(self, words: Words, limits: Iterable[Limit]) -> None:
        self.words = words
        self.limits = list(limits)
        self.met: Dict[Tuple[str, str], Limit] = {}
        for (program, file), word in words.items():
            limit = next((it for it in self.limits if word and it.is_of(program, file) and fnmatch.fnmatchcase(word, it.word)), None)
            if limit is not None:
                self.met[program, file] = limit

    def failures(self) -> List[str]:
        """Describes unexpected differences, and limits that no longer occur."""
        wrong = [f"{program}, {file}: {word}" for (program, file), word in self.words.items() if self.is_wrong((program, file))]
        met = {(program, limit) for (program, _), limit in self.met.items()}
        here = {program for program, _ in self.words}
        stale = [(program, it) for it in self.limits for program in it.programs.split() if program in here and (program, it) not in met]
        return wrong + [f"{program}, {it.files}: `{it.word}` no longer occurs: remove it from limits.py" for program, it in stale]

    def is_wrong(self, key: Tuple[str, str]) -> bool:
        return bool(self.words[key]) and key not in self.met

    def cell(self, program: str, files: List[str]) -> str:
        """The cell for some files: `ok` with the numbers of limits; `no` if all files have limits; `-` if the program does not support such
        files; or an unexpected difference."""
        keys = [(program, file) for file in files if (program, file) in self.words]
        if not keys:
            return "-"
        wrong = sorted({self.words[key] for key in keys if self.is_wrong(key)})
        if wrong:
            return f"FAILED: {wrong[0][:20]}"
        numbers = sorted({1 + self.limits.index(self.met[key]) for key in keys if key in self.met})
        marks = "".join(f" *{number}" for number in numbers)
        return f"{'no' if all(self.words[key] for key in keys) else 'ok'}{marks}"


def text(verdicts: Verdicts, kinds: Dict[str, str], programs: List[str]) -> str:
    """The text of the table, with notes on limits and with failures."""
    rows: Dict[str, List[str]] = {}
    for file, kind in kinds.items():
        rows.setdefault(f"{KINDS[kind]} .{file.rsplit('.', 1)[1]}", []).append(file)
    lines = [["", *programs]]
    lines += [[row, *(verdicts.cell(program, rows[row]) for program in programs)] for row in sorted(rows)]
    widths = [max(map(len, column)) for column in zip(*lines)]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines]
    met = [limit for limit in verdicts.limits if limit in verdicts.met.values()]
    notes = [f"*{1 + verdicts.limits.index(it)} {it.programs}: {it.reason}" for it in met]
    failures = verdicts.failures()
    passed = sum(not verdicts.is_wrong(key) for key in verdicts.words)
    return "\n".join([*table, "", *notes, *(f"FAILED {it}" for it in failures), "", f"{passed} passed, {len(failures)} failed"])
