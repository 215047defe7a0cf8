"""Lists every message of the program and the packs in `docs/messages.txt`, so that they can be read as one list.

    python3 tests/words/messages.py          # checks that the file is complete; CI runs this
    python3 tests/words/messages.py --write  # makes the file anew

A message is a string literal of two words or more in the Rust code of `src/` and `nodes/`, tests left out: errors, warnings, help lines,
names of facts, texts of the command line. Help texts of commands and descriptions of nodes are doc comments: `maquette help COMMAND` and
`docs/language.md` have them.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
LIST = ROOT / "docs" / "messages.txt"

TOKEN = re.compile(
    r"""
    (?P<comment>//[^\n]*|/\*.*?\*/)
    | (?P<raw>b?r(?P<hashes>\#*)"(?P<raw_text>.*?)"(?P=hashes))
    | (?P<bytes>b"(?:[^"\\]|\\.)*")
    | (?P<string>"(?P<text>(?:[^"\\]|\\.)*)")
    | (?P<char>'(?:[^'\\]|\\(?:u\{[0-9a-fA-F]+\}|.))[^']{0,3}?')
    | (?P<test>\#\[cfg\(test\)\]\s*(?:pub(?:\([^)]*\))?\s+)?(?:mod\s+\w+\s*\{|(?:fn|impl)\b[^{]*\{))
    | (?P<attribute>\#!?\[(?:serde|schemars|doc|cfg|expect|allow|derive|must_use)\b[^\]]*\])
    """,
    re.VERBOSE | re.DOTALL,
)
ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "0": "\0", "\\": "\\", '"': '"', "'": "'"}
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")
# Two words in a row: a message, not a name, a path or a pattern.
SENTENCE = re.compile(r"[A-Za-z`}][\w`'}.,:)%-]*\s+[`({\"'<\w]")


def unescape(text):
    """Replaces the escapes of a string literal."""
    text = re.sub(r"\\\n\s*", "", text)
    return re.sub(r"\\(u\{([0-9a-fA-F]+)\}|.)", lambda m: chr(int(m[2], 16)) if m[2] else ESCAPES.get(m[1], m[0]), text)


def end_of_block(text, start):
    """Returns the position after the bracket that closes the block which is open at `start`."""
    depth, position = 1, start
    brackets = re.compile(TOKEN.pattern + r"| (?P<open>\{) | (?P<close>\})", TOKEN.flags)
    while depth and (match := brackets.search(text, position)):
        depth += {"open": 1, "close": -1}.get(match.lastgroup, 1 if match.lastgroup == "test" else 0)
        position = match.end()
    return position


def messages(text):
    """Lists the messages of a Rust file, in order."""
    found, position = [], 0
    while match := TOKEN.search(text, position):
        position = match.end()
        if match["test"]:
            position = end_of_block(text, position)
        message = match["raw_text"] if match["raw"] else unescape(match["text"]) if match["string"] else None
        if message and SENTENCE.search(message):
            found.append(" ".join(CONTROL.sub("", message).split()))
    return found


def is_source(path):
    """Returns true if a file is part of the program or a pack, not of a test."""
    parts = path.with_suffix("").parts
    return not any(part in ("tests", "test") and part != parts[1] or part.endswith(("_tests", "law", "edge_cases")) for part in parts)


def listing():
    """Makes the text of the list: a heading for each file, a line for each message."""
    command = ["git", "ls-files", "-co", "--exclude-standard", "src/*.rs", "nodes/*.rs"]
    names = subprocess.run(command, cwd=ROOT, text=True, check=True, stdout=subprocess.PIPE).stdout.split()
    lines = ["Every message of the program and the packs, made by `python3 tests/words/messages.py --write`."]
    for name in sorted(set(names)):
        path = ROOT / name
        if is_source(Path(name)) and path.exists() and (found := messages(path.read_text(encoding="utf-8"))):
            lines += ["", name, *("  " + message for message in dict.fromkeys(found))]
    return "\n".join(lines) + "\n"


def main(arguments):
    """Writes or checks the list. Returns the exit status."""
    now = listing()
    if arguments == ["--write"]:
        LIST.write_text(now, encoding="utf-8")
        return 0
    known = LIST.read_text(encoding="utf-8") if LIST.exists() else ""
    if known == now:
        return 0
    before, after = known.splitlines(), now.splitlines()
    for line in [line for line in after if line not in before][:20]:
        print(f"docs/messages.txt has no `{line.strip()}`")
    print("docs/messages.txt is not up to date: read the new messages, then run `python3 tests/words/messages.py --write`")
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
