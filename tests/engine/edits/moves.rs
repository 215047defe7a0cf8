//! Extracts random sets of nodes from all graphs and inlines them again. Checks the laws that both edits must satisfy. The environment
//! variable `LAW_SETS` sets the number of sets per graph, and `PROPTEST_RNG_SEED` sets the seed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use maquette::{Diagnostic, ExtractedGraph, Extraction, Files, Graph, Options, Position};
use proptest::prelude::RngExt;
use proptest::test_runner::{RngAlgorithm, TestRng};
use rayon::prelude::*;

use super::sketch::{self, Sketch};
use super::{catalog, differences, law};

/// The number of sets of nodes per graph if `LAW_SETS` is not set.
const SETS: u64 = 6;

fn options() -> Options {
    Options { files: Files::Ignored, ..Options::default() }
}

/// Returns some nodes of a graph: consecutive nodes in the text, nodes that depend on each other, or arbitrary nodes.
fn random_nodes(sketch: &Sketch, rng: &mut impl RngExt) -> Vec<String> {
    let names: Vec<_> = sketch.nodes.iter().map(|node| node.name.clone()).collect();
    let count = rng.random_range(1..=names.len().min(6));
    let first = rng.random_range(0..names.len());
    match rng.random_range(0..3) {
        0 => names.iter().skip(first).take(count).cloned().collect::<Vec<_>>(),
        1 => {
            let mut set = BTreeSet::from([names[first].clone()]);
            for _ in 0..4 * count {
                let (port, link) = match &sketch.links[..] {
                    [] => break,
                    links => &links[rng.random_range(0..links.len())],
                };
                fn node(text: &str) -> String {
                    text.split(['.', '/']).next().unwrap_or("").to_owned()
                }
                let ends = [node(port), node(link)];
                let is_near = ends.iter().any(|end| set.contains(end));
                if is_near && set.len() < count && ends.iter().all(|end| names.contains(end)) {
                    set.extend(ends);
                }
            }
            set.into_iter().collect()
        }
        _ => {
            (0..count).map(|_| names[rng.random_range(0..names.len())].clone()).collect::<Vec<_>>()
        }
    }
}

/// Returns true if the nodes are next to each other in the text.
fn is_run(sketch: &Sketch, nodes: &[String]) -> bool {
    let places = BTreeSet::from_iter(
        nodes.iter().filter_map(|name| sketch.nodes.iter().position(|node| node.name == *name)),
    );
    places.last().zip(places.first()).is_some_and(|(last, first)| last - first < places.len())
}

/// Returns a text in canonical form in which each of the links `outputs` is shortened from `node.output` to `node`. Both forms mean the
/// first output of the node.
fn one_spelling(path: &Path, text: &str, outputs: &BTreeSet<String>) -> String {
    let mut text = maquette::edit::format_text(path, text).unwrap();
    for output in outputs {
        let node = output.split('.').next().unwrap_or("");
        text = text.replace(&format!("\"{output}\""), &format!("\"{node}\""));
    }
    text
}

/// Returns the links of the form `node.output` whose node is elsewhere linked as `node`.
fn twice_spelled(text: &str, sketch: &Sketch) -> BTreeSet<String> {
    let links = sketch.links.iter().map(|(_, link)| link.clone());
    let links = links.filter(|link| {
        let node = link.split('.').next().unwrap_or("");
        link.contains('.') && text.contains(&format!("\"{node}\""))
    });
    links.collect()
}

/// Formats diagnostics with their files and positions.
pub(super) fn diagnostics_text(problems: &[Diagnostic]) -> String {
    problems
        .iter()
        .map(|problem| {
            let place = Position::from_offset(&problem.source.text, problem.span.start);
            let Diagnostic { code, message, help, source, .. } = problem;
            let file = source.name.file_name().unwrap_or_default().to_string_lossy();
            format!("{code} {file}:{}:{} {message} ({help})", place.line, place.column)
        })
        .collect::<Vec<_>>()
        .join("\n")
}

fn graph(path: &Path, text: &str, options: &Options) -> Graph {
    let checked = Graph::load_text(path, text.to_owned(), catalog(), options);
    checked.graph.unwrap_or_else(|| panic!("{}\n{text}", diagnostics_text(&checked.diagnostics)))
}

/// Checks the laws that an extraction of nodes must satisfy.
fn judge(path: &Path, text: &str, nodes: &[String], new: &ExtractedGraph) -> Result<(), String> {
    fn holds(what: bool, words: String) -> Result<(), String> {
        if what { Ok(()) } else { Err(words) }
    }
    let after = &new.edited.text;
    let texts = || format!("{after}\n--- {}\n{}", new.path.display(), new.text);
    fn form(text: &str, path: &Path) -> String {
        maquette::edit::format_text(path, text).unwrap()
    }
    holds(form(&new.text, path) == new.text, format!("the new graph has no form:\n{}", texts()))?;
    // Check only that the entry of the new node is in canonical form. Links to the new node are longer than those that they replace, so
    // other entries may no longer fit on one line.
    fn own_text(text: &str, name: &str, kind: &str) -> (usize, String) {
        let start = text.find(&format!("        \"{name}\": {kind}(")).unwrap();
        let first = text[start..].lines().next().unwrap();
        let close = if first.ends_with('(') { "\n        ),\n" } else { "),\n" };
        let length = text[start..].find(close).unwrap() + close.len() - 3;
        (start, text[start..start + length].to_owned())
    }
    if form(text, path) == text {
        holds(
            own_text(&form(after, path), &new.name, &new.kind).1
                == own_text(after, &new.name, &new.kind).1,
            format!("has no form:\n{}", texts()),
        )?;
    }
    // No comment may be lost or duplicated by the extraction.
    let mut comments = Vec::from_iter(sketch::comments(after));
    comments.extend(sketch::comments(&new.text));
    comments.sort_unstable();
    let mut known = Vec::from_iter(sketch::comments(text));
    known.sort_unstable();
    holds(comments == known, format!("other comments:\n{}", texts()))?;
    // All lines outside of the moved nodes must be unchanged.
    let lines = BTreeSet::<&str>::from_iter(text.lines());
    let (start, entry) = own_text(after, &new.name, &new.kind);
    let after_others = [&after[..start], &after[start + entry.len() + 3..]].concat();
    let other = after_others.lines().filter(|line| !lines.contains(line));
    let is_link =
        |line: &str| line.contains(&format!("\"{}", new.name)) || line.contains(&new.kind);
    let odd: Vec<_> = other.filter(|line| !is_link(line)).collect();
    holds(odd.is_empty(), format!("{odd:?} is new in\n{}", texts()))?;

    let inside = options().with_text(&new.path, new.text.clone());
    let inlined = maquette::edit::inline(path, after, &new.name, catalog(), &inside);
    let back = inlined.map_err(|found| format!("{}\n{}", diagnostics_text(&found), texts()))?.text;
    let sketch = Sketch::parse(text);
    let twice = twice_spelled(text, &sketch);
    fn normalize_names(text: &str, twice: &BTreeSet<String>, path: &Path) -> String {
        one_spelling(path, text, twice)
    }
    if is_run(&sketch, nodes) {
        let same = normalize_names(&back, &twice, path) == normalize_names(text, &twice, path);
        holds(same, format!("is not what it was:\n{back}\n--- was\n{text}\n---{}", texts()))?;
        fn identity(text: &str, path: &Path) -> maquette::Hash {
            graph(path, text, &options()).identity()
        }
        holds(
            identity(&back, path) == identity(text, path),
            format!("says something else:\n{back}"),
        )?;
    } else {
        let found = differences(path, text, &back);
        holds(found.is_empty(), format!("{found:?}\n{back}\n--- was\n{text}"))?;
        fn sort_lines(text: &str) -> Vec<String> {
            let mut lines: Vec<_> = text.lines().map(str::to_owned).collect();
            lines.retain(|line| !line.is_empty());
            lines.sort_unstable();
            lines
        }
        let same = sort_lines(&normalize_names(&back, &twice, path))
            == sort_lines(&normalize_names(text, &twice, path));
        holds(same, format!("other lines:\n{back}\n--- was\n{text}\n---{}", texts()))?;
    }
    Ok(())
}

#[test]
fn what_is_extracted_comes_back_by_inlining() {
    fn number(name: &str) -> Option<u64> {
        std::env::var(name).ok()?.parse::<u64>().ok()
    }
    let sets = number("LAW_SETS").unwrap_or(SETS);
    let seed = number("PROPTEST_RNG_SEED").unwrap_or(20_070_115);
    let graphs = law::graphs();
    fn sound((path, text): &&(PathBuf, String)) -> bool {
        Graph::load_text(path, text.clone(), catalog(), &options()).graph.is_some()
            && text.contains("nodes:")
            && !text.trim_start().starts_with("Patch(")
    }
    let graphs: Vec<_> = graphs
        .iter()
        .filter(sound)
        .map(|(path, text)| (path.canonicalize().unwrap(), text.clone()))
        .collect();
    let counts = Mutex::new((0, 0));
    let of_graph = |(index, (path, text)): (usize, &(PathBuf, String))| {
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&(seed + index as u64).to_le_bytes());
        let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
        let sketch = Sketch::parse(text);
        for set in 0..if sketch.nodes.is_empty() { 0 } else { sets } {
            let nodes = random_nodes(&sketch, &mut rng);
            let to = match set % 3 {
                0 => path.with_file_name("zz-part.ron"),
                1 => path.with_file_name("zz-new").join("zz-part.ron"),
                _ => path.parent().unwrap().with_file_name("zz-part.ron"),
            };
            let extraction = Extraction { nodes, to: Some(to), ..Extraction::default() };
            let done = maquette::edit::extract(path, text, &extraction, catalog(), &options());
            let judged = match &done {
                Ok(new) => {
                    counts.lock().unwrap().0 += 1;
                    judge(path, text, &extraction.nodes, new)
                }
                Err(found) => {
                    counts.lock().unwrap().1 += 1;
                    let is_told =
                        !found.is_empty() && !found.iter().any(|it| it.help.contains("fault"));
                    if is_told { Ok(()) } else { Err(diagnostics_text(found)) }
                }
            };
            judged.map_err(|why| format!("{} {:?}: {why}", path.display(), extraction.nodes))?;
        }
        Ok(())
    };
    let judged = graphs.par_iter().enumerate().map(of_graph);
    let failures: Vec<String> = judged.filter_map(Result::err).collect();
    assert!(failures.is_empty(), "{} graphs:\n{}", failures.len(), failures.join("\n======\n"));
    let (done, refused) = counts.into_inner().unwrap();
    assert!(done > 2 * refused && refused > 20, "{done} done, {refused} refused");
}
