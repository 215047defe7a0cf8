//! What it takes to move nodes from one graph file into another: entries with their comments, paths, values in place of parameters.

mod entries;
mod known;
mod paths;
mod same;
mod values;

pub(super) use crate::paths::{folder_of_new, path_between};
pub(super) use entries::{gap_behind, indented_entries, moved, part_with, put_in_place};
pub(super) use known::{Known, Linked};
pub(super) use paths::{path_of_use, seen_from};
pub(super) use same::Sides;
pub(super) use values::{Given, put_values};

use super::edit::{Judge, Refusal};
use super::patch::is_patch;
use super::{Files, Options};
use crate::error::{Problem, Span, code};
use crate::text::{parse, syntax_problems};

impl Judge<'_> {
    /// What a graph computes whose nodes are to be moved.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub(super) fn sound(&self, text: &str) -> Result<Sides, Vec<Problem>> {
        let (tree, mistakes) = parse(text);
        if !mistakes.is_empty() {
            return Err(syntax_problems(self.path, text, mistakes));
        }
        if is_patch(&tree) {
            let message = "a patch has values of nodes, but no nodes of its own".to_owned();
            let help = "do it in the graph that it is `of`".to_owned();
            let span = tree.name().map_or(tree.span, |name| name.span);
            return Err(self.refuse(text, Refusal { code: code::SYNTAX, span, message, help }));
        }
        self.computed(text)
    }

    /// The options by which a text is understood: no file that its nodes read is looked at.
    pub(super) fn reading(&self) -> Options {
        let Options { roots, texts, .. } = self.options.clone();
        Options { roots, texts, files: Files::Ignored, ..Options::default() }
    }

    pub(super) fn refuse(&self, text: &str, refusal: Refusal) -> Vec<Problem> {
        vec![self.refused(text, refusal)]
    }
}

pub(super) fn refusal(
    code: &'static str,
    span: Span,
    message: impl Into<String>,
    help: impl Into<String>,
) -> Refusal {
    Refusal { code, span, message: message.into(), help: help.into() }
}

/// A name that is free: the first of these, or else the last one with a number behind it.
pub(super) fn free_name(
    wanted: impl IntoIterator<Item = String>,
    number: impl Fn(&str, usize) -> String,
    is_free: impl Fn(&str) -> bool,
) -> String {
    let mut last = String::new();
    for name in wanted {
        if is_free(&name) {
            return name;
        }
        last = name;
    }
    let mut numbered = (2..).map(|count| number(&last, count));
    numbered.find(|name| is_free(name)).unwrap_or(last)
}
