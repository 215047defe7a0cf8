"""Inserts faults into the evaluator's cache, one at a time, and checks that the law of memory (src/engine/eval/law.rs) notices them.

usage: law.py [COPY] [NUMBER]...

Works in a copy of the sources without node packs, in COPY or, by default, in a new temporary folder. Tests the faults with these numbers,
by default all. First runs the test without a fault, which must pass. Prints for each fault after how many random sequences it was noticed;
exits with 1 if a fault was missed. The environment variable SEQUENCES is the maximum number of sequences, by default 20 000. Takes about
half an hour on two cores.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from run import copy

SEQUENCES = os.environ.get("SEQUENCES", "20000")
SEED = "20070115"

# Each fault has a name, which says what the evaluator ignores then, and the changes that cause it: file, old text, new text.
FAULTS = [
    ("changes of the files of a node", [
        ("src/engine/eval/plan.rs",
         "        let files = graph.nodes()[index].files.iter();\n        files\n            .map",
         "        let files = graph.nodes()[index].files.iter();\n        true || files\n            .map"),
    ]),
    ("changes of the input values of a node", [
        ("src/engine/eval/plan.rs",
         "inputs.eq(parts.inputs.iter().map(|hash| Some(*hash)))",
         "inputs.count() == parts.inputs.len()"),
    ]),
    ("changes of the parameters of a node", [
        ("src/engine/eval/plan.rs",
         "parts.recipe.identity == node.recipe.identity",
         "parts.recipe.kind == node.recipe.kind"),
    ]),
    ("changes of the type of a node", [
        ("src/engine/eval/plan.rs",
         "parts.recipe.identity == node.recipe.identity",
         "(parts.recipe.identity == node.recipe.identity || parts.recipe.kind != node.recipe.kind)"),
    ]),
    ("changes of files if nothing else changed", [
        ("src/engine/eval/plan.rs",
         "readers.all(|&index| {",
         "readers.all(|&index| true || {"),
    ]),
    ("nodes that the last evaluation has not evaluated, if nothing else changed", [
        ("src/engine/eval/plan.rs",
         "all(|(wanted, found)| found | !wanted)",
         "all(|_| true)"),
        ("src/engine/eval/snapshot.rs",
         "self.results[index].as_ref().filter(|_| self.is_current[index])",
         "self.results[index].as_ref()"),
    ]),
    ("changes of the graph", [
        ("src/engine/eval/plan.rs",
         "let same = last.shape == graph.topology().identity;",
         "let same = last.names.len() == graph.nodes().len();"),
    ]),
    ("changes of a node at the same index", [
        ("src/engine/eval/snapshot.rs",
         "self.current(index).filter(|_| *identity == graph.topology().identities[index])",
         "self.current(index).filter(|_| identity.0.len() == graph.topology().identity.0.len())"),
    ]),
    ("changes of the dependencies of an unchanged node", [
        ("src/engine/eval/plan.rs",
         "shape.sources(index).all(|source| same[source])",
         "shape.sources(index).all(|source| same[source] || true)"),
    ]),
    ("changes of the files of an unchanged node", [
        ("src/engine/eval/plan.rs",
         "!shape.reads_files(index) || self.has_files(",
         "!shape.reads_files(index) || true || self.has_files("),
    ]),
    ("the difference between results of this evaluation and older ones", [
        ("src/engine/eval/plan.rs",
         "results.iter().map(Option::is_some).collect();",
         "results.iter().map(|_| true).collect();"),
    ]),
    ("the last results of nodes that are not wanted now", [
        ("src/engine/eval/plan.rs",
         "*result = last.last_result(&shape.names[index], index).cloned();",
         "*result = last.last_result(&shape.names[index], index).filter(|_| false).cloned();"),
    ]),
    ("different names of nodes at the same index", [
        ("src/engine/eval/snapshot.rs",
         "Some(there) if there == name => near,",
         "Some(_) => near,"),
    ]),
    ("the links in a graph's identity", [
        ("src/graph/topology.rs",
         "content.extend_from_slice(&(link.node as u64).to_le_bytes());",
         ""),
    ]),
    ("the outputs of links in a graph's identity", [
        ("src/graph/topology.rs",
         "content.extend_from_slice(&(link.output as u64).to_le_bytes());",
         ""),
    ]),
    ("the recipes in a graph's identity", [
        ("src/graph/topology.rs",
         "content.extend_from_slice(&node.recipe.identity.0);",
         ""),
    ]),
    ("the inputs in a result's key", [
        ("src/engine/eval/key.rs",
         "for input in &self.inputs {\n            content.extend_from_slice(&input.0);",
         "for _ in &self.inputs {\n            content.push(0);"),
    ]),
    ("the order of inputs in a result's key", [
        ("src/engine/eval/key.rs",
         "for input in &self.inputs {",
         "let mut inputs = self.inputs.to_vec();\n        inputs.sort_by_key(|hash| hash.0);\n        for input in &inputs {"),
    ]),
    ("the files in a result's key", [
        ("src/engine/eval/key.rs",
         "file.map_or([0; 32], |hash| hash.0)",
         "file.map_or([0; 32], |_| [0; 32])"),
    ]),
    ("the parameters in a result's key", [
        ("src/graph/recipe.rs",
         "let content = json!([kind, without_paths(&parameters), Vec::from_iter(optional)]);",
         "let content = json!([kind, Vec::from_iter(optional)]);"),
    ]),
    ("the resolution of the clock: even just written files count as unchanged", [
        ("src/graph/file_stat.rs",
         "i128::try_from(now.saturating_sub(grain).as_nanos()).is_ok_and(|limit| last < limit)",
         "i128::try_from(now.saturating_sub(grain).as_nanos()).is_ok_and(|limit| last < limit.max(i128::MAX))"),
    ]),
    ("the modification time of a file", [
        ("src/graph/files.rs",
         "stamp == self.stamp\n",
         "stamp.size() == self.stamp.size()\n"),
    ]),
    ("changes of parameters since the result that is updated", [
        ("src/engine/eval/compute.rs",
         "before.parts.recipe.identity != parts.recipe.identity",
         "before.parts.recipe.kind != parts.recipe.kind"),
    ]),
    ("changes of inputs since the result that is updated", [
        ("src/engine/eval/compute.rs",
         "values.get(link.output).filter(|value| value.hash() == *hash).cloned()",
         "values.get(link.output).filter(|value| value.hash() == *hash || true).cloned()"),
    ]),
    ("the checksum of a file of the cache", [
        ("src/engine/eval/disk/seal.rs",
         "if seal(path, &bytes[..length])[..] != bytes[length..] {",
         "if false && seal(path, &bytes[..length])[..] != bytes[length..] {"),
    ]),
    ("the name of a file of the cache in its checksum", [
        ("src/engine/eval/disk/seal.rs",
         "*hasher.update(content).finalize().as_bytes()",
         "drop(hasher);\n    *blake3::Hasher::new().update(content).finalize().as_bytes()"),
    ]),
]


def law(tree):
    """Runs the test; returns the number of sequences after which it failed (None if it passed) and its message.

    Returns None if the code does not compile.
    """
    command = ["cargo", "test", "--quiet", "--package", "maquette-engine", "--lib"]
    environment = os.environ | {
        "CARGO_PROFILE_DEV_DEBUG": "0",
        "LAW_SEQUENCES": SEQUENCES,
        "PROPTEST_RNG_SEED": SEED,
        "PROPTEST_MAX_SHRINK_ITERS": "0",
    }
    built = subprocess.run([*command, "--no-run"], cwd=tree, capture_output=True, text=True, env=environment)
    if built.returncode != 0:
        return None
    command += ["--", "whatever_is_done_in_whatever_order"]
    result = subprocess.run(command, cwd=tree, capture_output=True, text=True, env=environment)
    found = re.search(r"after some (\d+) sequences: (.*)", result.stdout)
    assert found or result.returncode == 0, result.stdout + result.stderr
    return (int(found[1]), found[2]) if found else (None, "")


def main():
    tree = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp(prefix="mutations-"))
    wanted = [int(number) for number in sys.argv[2:]] or range(1, len(FAULTS) + 1)
    copy(tree)
    for file in {file for _, changes in FAULTS for file, _, _ in changes}:
        # Newer than their build: a copy from an earlier run may have been built with a fault.
        (tree / file).touch()
    start = time.monotonic()
    found = law(tree)
    assert found == (None, ""), f"the test fails without a fault: {found}"
    print(f"passes without a fault, in {time.monotonic() - start:.0f} s with the build", flush=True)
    missed = 0
    for number, (name, changes) in enumerate(FAULTS, 1):
        if number not in wanted:
            continue
        texts = {tree / file: (tree / file).read_text() for file, _, _ in changes}
        for file, old, new in changes:
            text = (tree / file).read_text()
            assert text.split("#[cfg(test)]")[0].count(old) == 1, f"{file}: expected `{old}` once"
            (tree / file).write_text(text.replace(old, new, 1))
        try:
            found = law(tree)
        finally:
            for path, text in texts.items():
                path.write_text(text)
        assert found, f"{number}, {name}, does not compile"
        sequences, words = found
        missed += sequences is None
        word = "MISSED              " if sequences is None else f"noticed after {sequences:6}"
        print(f"{number:2} {word}  {name}: {words[:120]}", flush=True)
    print(f"{len(wanted) - missed} passed, {missed} failed")
    sys.exit(missed > 0)


if __name__ == "__main__":
    main()
