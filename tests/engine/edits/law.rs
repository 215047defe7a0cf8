//! Applies random edits to all graphs, and checks the laws that every edit must satisfy. The environment variable `LAW_EDITS` sets the
//! number of edits per graph, and `PROPTEST_RNG_SEED` sets the seed.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use maquette::{Change, Difference, Edit, EditedText, Files, Graph, Options};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};
use rayon::prelude::*;

use super::sketch::{self, Sketch};
use super::{catalog, differences, edit, schemas};
use crate::beside::shared_folder;
use crate::ron_files::ron_files;

/// The number of edits per graph if `LAW_EDITS` is not set.
const EDITS: u32 = 20;

/// The number of edits in a sequence. Each sequence begins with the original graph.
const WALK: usize = 8;

/// Returns all graphs of the project. Also returns those in the folder `../shared/graphs` next to the project, if it exists.
pub(super) fn graphs() -> Vec<(PathBuf, String)> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs");
    let folders = [own].into_iter().chain(shared_folder("graphs"));
    let mut files: Vec<_> = folders.flat_map(|folder| ron_files(&folder)).collect();
    files.sort();
    // Leave out lock files: they contain the texts of graphs, but are not graphs.
    files.retain(|path| !path.to_string_lossy().ends_with(".lock.ron"));
    let graphs = files
        .into_iter()
        .map(|path: PathBuf| {
            let text = std::fs::read_to_string(&path).unwrap();
            (path, text)
        })
        .filter(|(_, text)| text.contains("Graph("));
    graphs.collect()
}

fn problems(path: &Path, text: &str) -> Vec<(&'static str, String)> {
    let options = Options { files: Files::Ignored, ..Options::default() };
    let problems = Graph::load_text(path, text.to_owned(), catalog(), &options).diagnostics;
    problems.into_iter().map(|problem| (problem.code, problem.message)).collect()
}

/// Returns a random edit that mentions names in the graph. Many of these edits are invalid.
fn random_edit(sketch: &Sketch, kind: usize, dice: &[Index; 4]) -> Edit {
    const NEW: [&str; 6] = ["new", "zz-top", "b-2", "nose", "grow", "Wrong"];
    let [a, b, c, d] = dice;
    let nodes: Vec<_> = sketch.nodes.iter().map(|node| node.name.clone()).collect();
    fn name(from: &[String], dice: &Index) -> String {
        match from {
            [] => "nothing".to_owned(),
            from => dice.get(from).clone(),
        }
    }
    fn link(dice: &Index, nodes: &[String], sketch_links: &[(String, String)]) -> String {
        match (sketch_links.is_empty(), dice.index(4)) {
            (false, 0..3) => dice.get(sketch_links).1.clone(),
            _ => name(nodes, dice),
        }
    }
    fn output(dice: &Index, sketch_outputs: &[String]) -> String {
        match (sketch_outputs.is_empty(), dice.index(3)) {
            (false, 0 | 1) => dice.get(sketch_outputs).clone(),
            _ => dice.get(&["new.ply", "new.png", "x.json", "mesh", "../x.ply"]).to_string(),
        }
    }
    match kind {
        0 => {
            let node = (!sketch.nodes.is_empty()).then(|| a.get(&sketch.nodes));
            let mut fields = node.map_or_else(Vec::new, |node| node.fields.clone());
            if d.index(3) == 0 && !fields.is_empty() {
                fields.remove(d.index(fields.len()));
            }
            Edit::Add {
                name: b.get(&NEW).to_string(),
                node: node.map_or("ReadMesh".to_owned(), |node| node.kind.clone()),
                fields,
                after: (c.index(2) == 0).then(|| name(&nodes, c)),
            }
        }
        1 => {
            // In half of the cases, remove a node that no other node needs.
            fn is_needed(name: &str, sketch_links: &[(String, String)]) -> bool {
                fn is_it(link: &str, name: &str) -> bool {
                    link.split('.').next() == Some(name)
                }
                sketch_links.iter().any(|(_, link)| is_it(link, name))
            }
            let ends = sketch
                .nodes
                .iter()
                .map(|node| &node.name)
                .filter(|name| !is_needed(name, &sketch.links));
            let ends: Vec<_> = ends.map(|name| format!("nodes.{name}")).collect();
            let among = if c.index(2) == 0 { &ends } else { &sketch.names };
            Edit::Remove { name: name(among, a), and_links: b.index(3) > 0 }
        }
        2 => {
            let to = match b.index(8) {
                0 => name(&sketch.names, c),
                _ => c.get(&NEW).to_string(),
            };
            Edit::Rename { from: name(&sketch.names, a), to }
        }
        3 if sketch.links.is_empty() => Edit::Unlink { port: "nothing.at-all".into() },
        3 => {
            let (port, _) = a.get(&sketch.links);
            // In half of the cases, use the link of a port with the same field name, because it probably has the right type.
            fn field(port: &str) -> Option<String> {
                port.split('.').nth(1).map(str::to_owned)
            }
            let alike = sketch.links.iter().filter(|(other, _)| field(other) == field(port));
            let alike: Vec<_> = alike.map(|(_, link)| link.clone()).collect();
            let to = if b.index(2) == 0 { name(&alike, c) } else { link(c, &nodes, &sketch.links) };
            Edit::Link { port: port.clone(), to }
        }
        4 => {
            let free = schemas::free_ports(sketch);
            match d.index(8) {
                0 if !sketch.links.is_empty() => {
                    Edit::Unlink { port: a.get(&sketch.links).0.clone() }
                }
                _ if !free.is_empty() => Edit::Unlink { port: a.get(&free).clone() },
                // All links of this graph are required, so no link can be removed. Set a value instead.
                _ => random_edit(sketch, 5, dice),
            }
        }
        5 => {
            const ANY: [&str; 5] = ["2.5", "\"#123456\"", "None", "(1, 2, 3)", "Param(\"levels\")"];
            let Some((target, old)) = (!sketch.fields.is_empty()).then(|| a.get(&sketch.fields))
            else {
                return Edit::Set { target: "nothing".into(), value: "1".into() };
            };
            let fitting = schemas::values(sketch, target, old);
            let value = if d.index(4) > 0 { &c.get(&fitting)[..] } else { b.get(&ANY) };
            Edit::Set { target: target.clone(), value: value.to_owned() }
        }
        _ => Edit::Output {
            name: output(a, &sketch.outputs),
            to: (b.index(2) > 0).then(|| link(c, &nodes, &sketch.links)),
        },
    }
}

const KINDS: [&str; 7] = ["add", "remove", "rename", "link", "unlink", "set", "output"];

/// A step that reverts the last edit. The next edit then starts from the restored text.
const UNDO: usize = KINDS.len();

fn kind_of(edit: &Edit) -> &'static str {
    KINDS[match edit {
        Edit::Add { .. } => 0,
        Edit::Remove { .. } => 1,
        Edit::Rename { .. } => 2,
        Edit::Link { .. } => 3,
        Edit::Unlink { .. } => 4,
        Edit::Set { .. } => 5,
        Edit::Output { .. } => 6,
    }]
}

/// Returns true if the bytes of `part` occur in `whole` in the same order, possibly with others between them.
fn is_within(part: &str, whole: &str) -> bool {
    let mut whole = whole.bytes();
    part.bytes().all(|byte| whole.any(|other| other == byte))
}

/// Returns the total length in bytes of the common beginning and the common end of two texts. It is at most the length of the shorter text.
fn in_common(old: &str, new: &str) -> usize {
    let start = old.bytes().zip(new.bytes()).take_while(|(a, b)| a == b).count();
    let end = old.bytes().rev().zip(new.bytes().rev()).take_while(|(a, b)| a == b).count();
    (start + end).min(old.len()).min(new.len())
}

/// Returns the text with the content of all strings removed.
fn skeleton(text: &str) -> String {
    let pieces = text.split('"').enumerate();
    let outside = pieces.filter(|(index, _)| index % 2 == 0);
    outside.map(|(_, piece)| piece).collect::<Vec<_>>().join("\"\"")
}

macro_rules! holds {
    ($what:expr, $($words:tt)*) => {
        if !$what {
            return Err(TestCaseError::fail(format!($($words)*)));
        }
    };
}

/// Checks the laws that an edit must satisfy if it was successful.
fn judge(path: &Path, old: &str, edit: &Edit, edited: &EditedText) -> Result<(), TestCaseError> {
    let new = &edited.text;
    holds!(edited.before == old, "the old text is another one");
    let known = problems(path, old);
    let found = problems(path, new);
    // Compare only the codes of diagnostics after a rename, because the message of a known diagnostic may contain the new name.
    let renames = matches!(edit, Edit::Rename { .. }) && found.len() <= known.len();
    let is_known = |(code, message): &(&str, String)| {
        known.iter().any(|known| known.0 == *code && (renames || known.1 == *message))
    };
    holds!(found.iter().all(is_known), "new problems: {found:?}\n{new}");
    let comments = (sketch::comments(old), sketch::comments(new));
    match edit {
        Edit::Remove { .. } | Edit::Unlink { .. } | Edit::Output { to: None, .. } => {
            holds!(is_within(new, old), "more than taken away:\n{new}");
            let kept = HashSet::<&str>::from_iter(comments.1);
            let lines = HashSet::<&str>::from_iter(new.lines());
            for gone in comments.0.iter().filter(|comment| !kept.contains(*comment)) {
                let whole = old.lines().any(|line| line.trim() == *gone && lines.contains(line));
                let own = old.lines().any(|line| line.trim() == *gone);
                let is_inside = matches!(edit, Edit::Remove { .. });
                holds!(!whole && (is_inside || !own), "a comment is gone: {gone}\n{new}");
            }
        }
        Edit::Rename { .. } => {
            holds!(skeleton(old) == skeleton(new), "more than names:\n{new}");
        }
        Edit::Add { .. } | Edit::Output { .. } | Edit::Link { .. } | Edit::Set { .. } => {
            holds!(comments.0 == comments.1, "other comments:\n{new}");
            let is_new = matches!(edit, Edit::Add { .. });
            if is_new {
                let common = in_common(old, new);
                // Returns true if the text that the edit has added consists of a comma before a comment, and a new entry after this
                // comment.
                fn comma(common: usize, old: &str, new: &str) -> bool {
                    is_within(old, new) && in_common(&old[common..], new) > 0
                }
                holds!(common == old.len() || comma(common, old, new), "more than added:\n{new}");
            }
        }
    }
    // If a graph is in canonical form and each entry has its own line, adding or removing a node must keep the canonical form.
    fn form(text: &str, path: &Path) -> Option<String> {
        maquette::edit::format_text(path, text).ok()
    }
    let of_nodes = match edit {
        Edit::Add { .. } => true,
        Edit::Remove { and_links, .. } => !and_links,
        _ => false,
    };
    fn is_joined(text: &str) -> bool {
        text.contains("params: { ") || text.contains("inputs: { ")
    }
    if of_nodes && form(old, path).as_deref() == Some(old) && !is_joined(old) {
        let formed = form(new, path).unwrap_or_default();
        // If the list of parameters or inputs becomes shorter, the canonical form may join it to one line, but the edit keeps its lines.
        // Then compare only the text from `nodes` on.
        let is_joined = is_joined(&formed);
        fn from(text: &str, is_joined: bool) -> usize {
            text.find("\n    nodes:").filter(|_| is_joined).unwrap_or(0)
        }
        let (formed, new) = (&formed[from(&formed, is_joined)..], &new[from(new, is_joined)..]);
        holds!(formed == new, "no longer canonical:\n{new}");
    }
    judge_meaning(edit, old, &differences(path, old, new))
}

/// Checks that the meaning of the graph has changed exactly as the edit requires.
fn judge_meaning(edit: &Edit, old: &str, found: &[Difference]) -> Result<(), TestCaseError> {
    let told = found.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    fn plain(name: &str) -> String {
        name.rsplit('.').next().unwrap_or_default().to_owned()
    }
    // Expectations are compared as texts, so a new name in one counts as a difference.
    fn is_expected(found: &&Difference, old: &str) -> bool {
        found.field == "expect" && old.contains("expect:")
    }
    // If an edit removes or renames an output, the promises about this output change, too.
    let outputs_go = matches!(edit, Edit::Remove { .. } | Edit::Rename { .. });
    let is_promised =
        |found: &&Difference| outputs_go && found.field == "promises" && old.contains("promises:");
    let found = found
        .iter()
        .filter(|found| !is_expected(found, old) && !is_promised(found))
        .collect::<Vec<_>>();
    fn is_one(change: Change, name: &str, found: &[&Difference]) -> bool {
        match found {
            [one] => one.change == change && one.name == name,
            _ => false,
        }
    }
    let is_right = match edit {
        Edit::Add { name, .. } => is_one(Change::Added, name, &found) && found[0].what == "node",
        Edit::Remove { name, and_links } => {
            let name = plain(name);
            let (own, others): (Vec<&Difference>, Vec<&Difference>) = found
                .iter()
                .partition(|f| f.what != "output" && f.change == Change::Removed && f.name == name);
            let others_go = others
                .iter()
                .filter(|f| {
                    f.change == Change::Rewired || (f.what, f.change) == ("output", Change::Removed)
                })
                .count()
                == others.len();
            own.len() == 1 && if *and_links { others_go } else { others.is_empty() }
        }
        Edit::Rename { from, to } => {
            // A link whose target did not exist may have used the new name before. Now it refers to the renamed node, although its text is
            // the same.
            fn is_in_vain(f: &Difference) -> bool {
                f.before.is_some() && f.before == f.after
            }
            match found.iter().filter(|f| !is_in_vain(f)).collect::<Vec<_>>()[..] {
                [] => plain(from) == *to,
                [one] => one.change == Change::Renamed && one.name == *to,
                _ => false,
            }
        }
        Edit::Link { port, .. } | Edit::Unlink { port } => {
            let (node, field) = port.split_once('.').unwrap_or_default();
            let field = field.split('.').next().unwrap_or_default();
            found.is_empty() && matches!(edit, Edit::Link { .. })
                || is_one(Change::Rewired, node, &found) && found[0].field.contains(field)
        }
        Edit::Set { target, .. } => {
            let (node, field) = target.split_once('.').unwrap_or((target, "default"));
            let field = field.split('.').next().unwrap_or_default();
            found.iter().all(|f| f.name == node && f.field.starts_with(field))
        }
        Edit::Output { name, .. } => {
            found.is_empty()
                || found.len() == 1 && found[0].what == "output" && found[0].name == *name
        }
    };
    holds!(is_right, "the graph says something else:\n{told}");
    Ok(())
}

/// Applies a sequence of edits to a graph, each to the result of the previous one.
fn follow(
    path: &Path,
    text: &str,
    steps: &[(usize, [Index; 4])],
    counts: &Mutex<BTreeMap<(&str, bool), usize>>,
) -> Result<(), TestCaseError> {
    let mut text = text.to_owned();
    let mut undo = Vec::new();
    for (kind, dice) in steps {
        if *kind == UNDO {
            text = undo.pop().unwrap_or(text);
            continue;
        }
        let next = random_edit(&Sketch::parse(&text), *kind, dice);
        let told = |error: TestCaseError| {
            TestCaseError::fail(format!("{next:?} of {}: {error}\n--- was\n{text}", path.display()))
        };
        let done = edit(path, &text, std::slice::from_ref(&next));
        *counts.lock().unwrap().entry((kind_of(&next), done.is_ok())).or_default() += 1;
        match done {
            Ok(edited) => {
                judge(path, &text, &next, &edited).map_err(told)?;
                undo.push(edited.before);
                text = edited.text;
            }
            Err(problems) => {
                let all = !problems.is_empty()
                    && problems.iter().all(|problem| {
                        !problem.message.is_empty()
                            && problem.code.starts_with('G')
                            && problem.span.end <= problem.source.text.len()
                    });
                if !all {
                    return Err(told(TestCaseError::fail(format!("no reason: {problems:?}"))));
                }
            }
        }
    }
    Ok(())
}

#[test]
fn a_random_edit_does_what_it_says_and_nothing_else_or_is_refused() {
    fn number(name: &str) -> Option<u64> {
        std::env::var(name).ok()?.parse::<u64>().ok()
    }
    let edits = number("LAW_EDITS").unwrap_or(EDITS.into());
    let seed = number("PROPTEST_RNG_SEED").unwrap_or(20_070_115);
    let graphs = graphs();
    assert!(graphs.len() > 80, "{}", graphs.len());
    let counts = Mutex::new(BTreeMap::new());
    let failures = graphs.par_iter().enumerate().filter_map(|(index, (path, text))| {
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&(seed + index as u64).to_le_bytes());
        let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
        let cases = edits.div_ceil(WALK as u64) as u32;
        let config = Config { cases, failure_persistence: None, ..Config::default() };
        let step = (0..=UNDO, any::<[Index; 4]>());
        let walk = prop::collection::vec(step, WALK);
        let mut runner = TestRunner::new_with_rng(config, rng);
        runner.run(&walk, |steps| follow(path, text, &steps, &counts)).err()
    });
    // Keep only the part of the message about the failing edit. The part after `minimal failing` only repeats the steps before it.
    fn short_failure(failure: String) -> Option<String> {
        failure.split("minimal failing").next().map(str::to_owned)
    }
    let failures: Vec<String> =
        failures.filter_map(|failure| short_failure(failure.to_string())).collect();
    assert!(failures.is_empty(), "{} graphs:\n{}", failures.len(), failures.join("\n"));
    let counts = counts.into_inner().unwrap();
    for kind in KINDS {
        let [done, refused] =
            [true, false].map(|done| counts.get(&(kind, done)).copied().unwrap_or(0));
        let told = format!("{kind}: {done} done, {refused} refused");
        assert!(done > graphs.len() / 8 && refused > 0, "{told}");
        assert!(3 * done >= done + refused, "fewer than a third: {told}");
    }
}
