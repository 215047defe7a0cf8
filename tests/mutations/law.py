"""Puts faults into what the evaluator remembers, one at a time, and asks the law (src/engine/eval/law.rs) whether it notices.

usage: law.py [COPY] [NUMBER]...

Works in a copy of the tree (made in COPY, a new folder of the system's if left out) that needs no node packs. Tries the faults of
these numbers; all if left out. Before the faults the tree is tried as it is, and must keep the law. Prints for each fault after
how many of SEQUENCES random sequences (environment; 20 000 if it says nothing) it was noticed; exits 1 if one was not. About
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

# What is forgotten, and the changes that make it so: file, what stands there, what is put there.
FAULTS = [
    ("whether the files of a node are as they were", [
        ("src/engine/eval/plan.rs",
         "        let files = graph.nodes()[index].files.iter();\n        files.map",
         "        let files = graph.nodes()[index].files.iter();\n        true || files.map"),
    ]),
    ("whether a node's inputs are the same values", [
        ("src/engine/eval/plan.rs",
         "inputs.eq(parts.inputs.iter().map(|hash| Some(*hash)))",
         "inputs.count() == parts.inputs.len()"),
    ]),
    ("whether a node has the same parameters", [
        ("src/engine/eval/plan.rs",
         "parts.recipe.identity == node.recipe.identity",
         "parts.recipe.kind == node.recipe.kind"),
    ]),
    ("whether a node is of the same type", [
        ("src/engine/eval/plan.rs",
         "parts.recipe.identity == node.recipe.identity",
         "(parts.recipe.identity == node.recipe.identity || parts.recipe.kind != node.recipe.kind)"),
    ]),
    ("the files, where nothing else changed", [
        ("src/engine/eval/plan.rs",
         "readers.all(|&index| {",
         "readers.all(|&index| true || {"),
    ]),
    ("which nodes the last evaluation found, where nothing else changed", [
        ("src/engine/eval/plan.rs",
         "all(|(wanted, found)| found | !wanted)",
         "all(|_| true)"),
        ("src/engine/eval/snapshot.rs",
         "self.results[index].as_ref().filter(|_| self.found[index])",
         "self.results[index].as_ref()"),
    ]),
    ("whether the graph is the same", [
        ("src/engine/eval/plan.rs",
         "let same = last.shape == graph.shape().identity;",
         "let same = last.names.len() == graph.nodes().len();"),
    ]),
    ("whether a node is the same as the one that was at its place", [
        ("src/engine/eval/snapshot.rs",
         "self.current(index).filter(|_| *identity == graph.shape().identities[index])",
         "self.current(index).filter(|_| identity.0.len() == graph.shape().identity.0.len())"),
    ]),
    ("whether all that it hangs on is the same, where a node is", [
        ("src/engine/eval/plan.rs",
         "shape.sources(index).all(|source| same[source])",
         "shape.sources(index).all(|source| same[source] || true)"),
    ]),
    ("the files of a node that is the same", [
        ("src/engine/eval/plan.rs",
         "!shape.reads_files(index) || self.has_files(",
         "!shape.reads_files(index) || true || self.has_files("),
    ]),
    ("which results are of this evaluation", [
        ("src/engine/eval/plan.rs",
         "Vec::from_iter(results.iter().map(Option::is_some));",
         "Vec::from_iter(results.iter().map(|_| true));"),
    ]),
    ("the last results of nodes that nobody wants now", [
        ("src/engine/eval/plan.rs",
         "*result = last.before(&shape.names[index], index).cloned();",
         "*result = last.before(&shape.names[index], index).filter(|_| false).cloned();"),
    ]),
    ("that nodes of one place may have different names", [
        ("src/engine/eval/snapshot.rs",
         "Some(there) if there == name => near,",
         "Some(_) => near,"),
    ]),
    ("the links in a graph's identity", [
        ("src/graph/shape.rs",
         "content.extend_from_slice(&(link.node as u64).to_le_bytes());",
         ""),
    ]),
    ("the outputs that links take, in a graph's identity", [
        ("src/graph/shape.rs",
         "content.extend_from_slice(&(link.output as u64).to_le_bytes());",
         ""),
    ]),
    ("the recipes in a graph's identity", [
        ("src/graph/shape.rs",
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
    ("the clock's grain: a file is believed however new it is", [
        ("src/graph/stamp.rs",
         "i128::try_from(now.saturating_sub(grain).as_nanos()).is_ok_and(|limit| last < limit)",
         "i128::try_from(now.saturating_sub(grain).as_nanos()).is_ok_and(|limit| last < limit.max(i128::MAX))"),
    ]),
    ("a file's time", [
        ("src/graph/files.rs",
         "stamp == self.stamp && ",
         "stamp.size() == self.stamp.size() && "),
        ("src/graph/stamp.rs",
         "    /// Whether a write after this moment",
         "    pub(crate) fn size(&self) -> u64 {\n        self.size\n    }\n\n    /// Whether a write after this moment"),
    ]),
    ("whether a node had the same parameters when it gave what is updated", [
        ("src/engine/eval/compute.rs",
         "before.parts.recipe.identity != parts.recipe.identity",
         "before.parts.recipe.kind != parts.recipe.kind"),
    ]),
    ("whether the values before are those of which a node made what is updated", [
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
    """What the law says: whether it was kept, after how many sequences, and in what words; none if it does not compile."""
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
        # Newer than what was built of it: a copy that was used before may have been left with a fault.
        (tree / file).touch()
    start = time.monotonic()
    found = law(tree)
    assert found == (None, ""), f"the law is broken without a fault: {found}"
    print(f"kept without a fault, in {time.monotonic() - start:.0f} s with the build", flush=True)
    missed = 0
    for number, (name, changes) in enumerate(FAULTS, 1):
        if number not in wanted:
            continue
        texts = {tree / file: (tree / file).read_text() for file, _, _ in changes}
        for file, old, new in changes:
            text = (tree / file).read_text()
            assert text.split("#[cfg(test)]")[0].count(old) == 1, f"{file}: `{old}` does not stand there once"
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
