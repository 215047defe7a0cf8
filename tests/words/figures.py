"""Four figures that show whether the Rust sources read like ordinary Rust and plain English. CI fails if one is above its bound.

    python3 tests/words/figures.py [--list FIGURE] [FOLDER]

Prints a table by crate. `--list` names each place that counts for one figure. FOLDER is another checkout, to compare with.

- questions: doc comments that begin with a question word ("What ..", "Whether ..") instead of a noun or a verb, in percent.
- functions: functions outside of trait implementations whose whole name is a participle or a function word (`told`, `of`), in percent.
- types: types whose whole name is one (`Kept`, `Gone`), in percent.
- closures: closures that are bound by `let`, per 1000 lines.

The bounds are at most twice what this script prints for typst, a well-regarded Rust project of similar size (commit a51e0280: 6.9, 4.4,
1.4 and 1.0).
"""

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

BOUNDS = {"questions": 13.8, "functions": 2.8, "types": 2.8, "closures": 2.0}

QUESTION_WORDS = set("what which who where how whether of those".split())
FUNCTION_WORDS = set("""
    a about above after again all alike all alone along also and any apart around as at away back because been before behind below beneath
    beside besides between beyond both but by each either else enough ever every few first for hence here how however if in inside instead
    into it its last least less like many more most much near neither never no none nor not nothing of off often on once one only onto or
    other others otherwise out outside over own per rather same several since so some somebody something still such than that the their
    them then there these they this those though three through thus till to together too toward towards twelve two under until unto up
    upon very what whatever when whenever where whether which while who whole whom whose why within without yet
""".split())
# Names that the standard library has for the same purpose.
USUAL = set("all and any as_ref first from last none not or with".split())
IRREGULAR_PARTICIPLES = set("""
    begun bent been begotten bitten born bought bound broken brought built been caught chosen come crept dealt done drawn driven drunk dug
    eaten fallen fed felt fled flown forgotten fought found frozen gone ground grown had heard held hidden hung kept known laid left lent
    lost made meant met paid ridden risen said seen sent shaken shown slept sold sought spent spoken spun stolen stood struck stuck swept
    sworn swung taken taught thought thrown told torn understood was went were woken won worn wound woven written
""".split())
# Nouns and verbs that end like a participle.
NO_PARTICIPLES = set("bed bleed breed embed exceed feed need proceed seed speed succeed".split())

IMPL = re.compile(r"(\s*)(?:unsafe )?impl\b.*\bfor\b")
VISIBLE = r"\s*(?:pub(?:\([^)]*\))? )?"
FUNCTION = re.compile(VISIBLE + r"(?:(?:default|const|async|unsafe|extern \"C\") )*fn (\w+)")
TYPE = re.compile(VISIBLE + r"(?:struct|enum|trait|type|union) (\w+)")
DOC = re.compile(r"\s*(?:///|//!)(?!/)\W*([A-Za-z]*)")
CLOSURE = re.compile(r"\s*let (?:mut )?\w+(?:: [^=]*)? =(?: (?:move )?\||$)")


def is_no_name(word):
    """Returns true if a word is a participle or a function word, so that it names neither a thing nor an action."""
    if word in FUNCTION_WORDS or word in IRREGULAR_PARTICIPLES:
        return word not in USUAL
    return len(word) > 3 and word.endswith("ed") and "_" not in word and word not in NO_PARTICIPLES


def count(text):
    """Counts one file: totals by kind, and the lines that count for each figure."""
    totals, found = Counter(), []
    lines = text.split("\n")
    in_doc, trait_impl = False, None
    for number, line in enumerate(lines, 1):
        totals["lines"] += 1
        doc = DOC.match(line)
        if doc and not in_doc:
            totals["docs"] += 1
            if doc[1].lower() in QUESTION_WORDS:
                found.append(("questions", number, line.strip()))
        in_doc = bool(doc)
        if implementation := IMPL.match(line):
            trait_impl = implementation[1] + "}"
        elif line.rstrip() == trait_impl:
            trait_impl = None
        if (function := FUNCTION.match(line)) and trait_impl is None:
            totals["fns"] += 1
            if is_no_name(function[1]):
                found.append(("functions", number, line.strip()))
        if kind := TYPE.match(line):
            totals["kinds"] += 1
            if is_no_name(kind[1].lower()) and not kind[1].isupper():
                found.append(("types", number, line.strip()))
        if CLOSURE.match(line) and (line.rstrip()[-1] != "=" or is_closure(lines, number)):
            found.append(("closures", number, line.strip()))
    return totals, found


def is_closure(lines, number):
    """Returns true if the line after a `let .. =` begins with a closure."""
    return number < len(lines) and re.match(r"\s*(?:move )?\|", lines[number]) is not None


def files(folder):
    """Lists the Rust files of a checkout that git tracks or would track; all of a folder without git."""
    if (folder / ".git").exists():
        listed = subprocess.run(
            ["git", "ls-files", "-co", "--exclude-standard", "*.rs"], cwd=folder, text=True, check=True, stdout=subprocess.PIPE
        ).stdout
        return sorted(path for line in set(listed.splitlines()) if (path := folder / line).exists())
    return sorted(folder.rglob("*.rs"))


def figures(totals, found):
    """Computes the four figures from totals and findings."""
    seen = Counter(kind for kind, *_ in found)

    def percent(kind, whole):
        return 100 * seen[kind] / max(totals[whole], 1)

    return {
        "questions": percent("questions", "docs"),
        "functions": percent("functions", "fns"),
        "types": percent("types", "kinds"),
        "closures": 1000 * seen["closures"] / max(totals["lines"], 1),
    }


def main(arguments):
    """Prints the table, or the list of one figure. Returns the exit status: 1 if a figure is above its bound."""
    listed = None
    if arguments[:1] == ["--list"]:
        listed, arguments = arguments[1], arguments[2:]
    folder = Path(arguments[0] if arguments else Path(__file__).parents[2]).resolve()
    crates, places = {}, []
    for path in files(folder):
        name = path.relative_to(folder)
        totals, found = count(path.read_text(encoding="utf-8"))
        crate = crates.setdefault("/".join(name.parts[:-1][:2]) or ".", (Counter(), []))
        crate[0].update(totals)
        crate[1].extend(found)
        places += [(name, *place) for place in found]
    if listed:
        for name, kind, number, line in places:
            if kind == listed:
                print(f"{name}:{number}: {line}")
        return 0
    whole = (sum((totals for totals, _ in crates.values()), Counter()), [place for _, found in crates.values() for place in found])
    print(f"{'':24} {'lines':>8} " + " ".join(f"{name:>9}" for name in BOUNDS))
    for name, (totals, found) in [*sorted(crates.items()), ("all", whole), ("bound", (None, None))]:
        values = BOUNDS if found is None else figures(totals, found)
        lines = "" if found is None else totals["lines"]
        print(f"{name:24} {lines:>8} " + " ".join(f"{value:9.1f}" for value in values.values()))
    above = [name for name, value in figures(*whole).items() if value > BOUNDS[name]]
    for name in above:
        print(f"{name} is above its bound; `python3 tests/words/figures.py --list {name}` names the places")
    return bool(above)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
