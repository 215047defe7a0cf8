"""Opens files with the programs that people have, and compares what they find with what is in the files.

python check FOLDER GRAPH MAQUETTE [all | PROGRAM ..]: prints a table of formats and programs. FOLDER has what `maquette run GRAPH` wrote.
Without further words the programs are those that are installed in a minute.
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
        raise ValueError(f"there is no {which[0]}: {', '.join(it.name for it in PROGRAMS)}")
    values = truth.truths(pathlib.Path(graph).resolve(), maquette)
    files = {name: pathlib.Path(folder).resolve() / name for name in sorted(values)}

    def found(program: Program) -> table.Words:
        known = [path for path in files.values() if path.suffix[1:] in program.endings]
        records = program.read(known)
        return {(program.name, path.name): compare.difference(values[path.name], records[path.name]) for path in known}

    words: table.Words = {}
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        for part in pool.map(found, programs):
            words.update(part)
    verdicts = table.Verdicts(words, LIMITS)
    print(table.text(verdicts, {name: values[name]["type"] for name in files}, [it.name for it in programs]))
    return 1 if verdicts.failures() else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
