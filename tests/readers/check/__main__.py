"""Opens files with other programs, and compares what they read with what was written.

python check FOLDER GRAPH MAQUETTE [all | PROGRAM ..]: prints a table of formats and programs. FOLDER has the outputs of `maquette run
GRAPH`. By default, runs the programs that are installed within a minute.
"""

from __future__ import annotations

import concurrent.futures
import pathlib
import sys

import compare
import table
import truth
from limits import LIMITS
from program import PROGRAMS, Program


def main(folder: str, graph: str, maquette: str, *which: str) -> int:
    programs = [it for it in PROGRAMS if it.name in which or "all" in which or not which and it.is_quick]
    if not programs:
        raise ValueError(f"unknown program {which[0]}; expected one of {', '.join(it.name for it in PROGRAMS)}")
    values = truth.truths(pathlib.Path(graph).resolve(), maquette)
    files = {name: pathlib.Path(folder).resolve() / name for name in sorted(values)}

    def differences(program: Program) -> table.Words:
        known = [path for path in files.values() if path.suffix[1:] in program.endings]
        records = program.read(known)
        return {(program.name, path.name): compare.difference(values[path.name], records[path.name]) for path in known}

    words: table.Words = {}
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        for part in pool.map(differences, programs):
            words.update(part)
    verdicts = table.Verdicts(words, LIMITS)
    print(table.text(verdicts, {name: values[name]["type"] for name in files}, [it.name for it in programs]))
    return 1 if verdicts.failures() else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
