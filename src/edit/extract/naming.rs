//! What a new graph is called: its file, its type and the node that uses it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maquette_graph::Refusal;
use maquette_graph::options::folder_of;
use maquette_syntax::error::{Span, code};
use maquette_syntax::paths::{folder_of_new, path_between};
use maquette_syntax::with_article;

use super::{Extraction, Judge, Known, free_name, refusal};
use crate::may_name;

/// What the new graph is called.
pub(super) struct New {
    pub(super) path: PathBuf,
    /// The path by which the graph names it.
    pub(super) given: String,
    pub(super) kind: String,
    pub(super) name: String,
}

impl New {
    /// # Errors
    /// A name is taken, or cannot be one.
    pub(super) fn of(
        judge: &Judge<'_>,
        known: &Known,
        set: &BTreeSet<usize>,
        extraction: &Extraction,
    ) -> Result<Self, Refusal> {
        let Extraction { to, kind, name, .. } = extraction;
        fn bad(message: String, help: &str) -> Result<New, Refusal> {
            Err(refusal(code::BAD_NAME, Span::default(), message, help))
        }
        let nodes = known.entries("nodes");
        let last = set.last().and_then(|&at| nodes[at].0.text()).unwrap_or_default();
        let of_file = to.as_ref().and_then(|to| to.file_stem()).map(|stem| stem.to_string_lossy());
        let stem = of_file.map(|stem| stem.into_owned()).or_else(|| name.clone());
        let stem =
            stem.or_else(|| kind.as_deref().map(hyphened)).unwrap_or_else(|| last.to_owned());
        let is_there =
            |path: &Path| judge.options.has_text(path) || path.symlink_metadata().is_ok();
        fn beside(stem: &str, judge_path: &Path) -> PathBuf {
            judge_path.with_file_name(format!("{stem}.ron"))
        }
        let stem = match to {
            Some(_) => stem,
            None => free_name(
                [stem],
                |stem, nth| format!("{stem}-{nth}"),
                |stem| !is_there(&beside(stem, judge.path)),
            ),
        };
        let path = to.clone().unwrap_or_else(|| beside(&stem, judge.path));
        if path.extension().is_none_or(|ending| ending != "ron") {
            let message = format!("`{}` cannot be the file of a graph", path.display());
            return bad(message, "its name ends in .ron");
        }
        let file = folder_of_new(&path).join(path.file_name().unwrap_or_default());
        let given = path_between(&folder_of_new(judge.path), &file);
        let in_place = folder_of(judge.path).join(&given);
        let own = folder_of_new(judge.path).join(judge.path.file_name().unwrap_or_default());
        if file == own || [&path, &file, &in_place].into_iter().any(|path| is_there(path)) {
            let message = format!("`{}` is there already", path.display());
            return bad(message, "name a file that is not there yet");
        }
        fn is_word(kind: &str) -> bool {
            matches!(kind, "ForEach" | "Switch" | "Graph" | "Patch")
        }
        let is_free = |kind: &str| {
            !is_word(kind) && !judge.catalog.has(kind) && known.position("use", kind).is_none()
        };
        let kind = match kind {
            Some(kind) if !is_type(kind) => {
                let message = format!("`{kind}` cannot name a type of nodes");
                return bad(
                    message,
                    "such names begin with a capital letter; letters and digits follow",
                );
            }
            Some(kind) if !is_free(kind) => {
                let message = format!("there is already a node type `{kind}`");
                return bad(message, "give it another name");
            }
            Some(kind) => kind.clone(),
            None => free_name([joined(&stem)], |kind, nth| format!("{kind}{nth}"), is_free),
        };
        let is_free = |name: &str| {
            let at = known.position("nodes", name);
            at.is_none_or(|at| set.contains(&at)) && known.position("inputs", name).is_none()
        };
        let name = match name {
            Some(name) => {
                may_name(name, "a node")?;
                if !is_free(name) {
                    let what =
                        if known.position("nodes", name).is_some() { "node" } else { "input" };
                    let message = format!("there is already {} `{name}`", with_article(what));
                    return bad(message, "give the new node another name");
                }
                name.clone()
            }
            None => free_name([hyphened(&kind)], |name, nth| format!("{name}-{nth}"), is_free),
        };
        Ok(Self { path, given, kind, name })
    }
}

fn is_type(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_uppercase())
        && word.chars().all(|c| c.is_ascii_alphanumeric())
}

/// `NoseBump` of `nose-bump`.
fn joined(name: &str) -> String {
    let words = name.split(|c: char| !c.is_ascii_alphanumeric());
    let words = words.filter_map(|word| {
        let first = word.get(..1)?;
        Some(first.to_ascii_uppercase() + &word[1..])
    });
    let kind = String::from_iter(words);
    if is_type(&kind) { kind } else { format!("Part{kind}") }
}

/// `nose-bump` of `NoseBump`.
fn hyphened(kind: &str) -> String {
    let mut name = String::new();
    for (at, c) in kind.char_indices() {
        if at > 0 && c.is_ascii_uppercase() {
            name.push('-');
        }
        name.push(c.to_ascii_lowercase());
    }
    name
}
