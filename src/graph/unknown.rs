//! Nodes of types that no pack has: they keep their data in the file, and give nothing.
//!
//! Such a node fails, the nodes that depend on it are skipped, and the evaluator knows nothing else of it. A node whose file is missing is
//! treated alike. The check still reports an error, because it is asked about the whole graph.

use std::sync::Arc;

use maquette_node::{AnyNode, Context, FilePath};
use maquette_syntax::Tree;
use maquette_syntax::error::{Error, Problem, Severity, code};
use maquette_value::AnyValue;
use serde_json::json;

use super::Checked;
use super::check::Check;
use super::recipe::Recipe;
use crate::definition::Built;

/// What stands for a node of an unknown type, with what the check tells of it.
struct Unknown(Option<Problem>);

/// What such a node answers when it is asked for its values: what the check tells of it.
#[derive(Debug, thiserror::Error)]
#[error("no pack has a node of this type")]
pub struct UnknownType(pub Option<Problem>);

impl AnyNode for Unknown {
    fn eval(&self, _: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        Err(UnknownType(self.0.clone()).into())
    }

    fn lacks(&self) -> Option<String> {
        Some(match &self.0 {
            Some(Problem { message, help, .. }) if !help.is_empty() => format!("{message}: {help}"),
            Some(problem) => problem.message.clone(),
            None => UnknownType(None).to_string(),
        })
    }

    fn parameters(&self) -> Result<serde_json::Value, serde_json::Error> {
        Ok(json!({}))
    }

    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }
}

/// The node that stands for one of an unknown type.
pub(super) fn unknown_node(tree: &Tree, told: Option<Problem>) -> Built {
    let kind = tree.name().map_or_else(String::new, |kind| kind.text);
    let recipe = Arc::new(Recipe::new(&kind, json!({}), &[]));
    let (node, tree) = (Arc::new(Unknown(told)), Arc::new(tree.clone()));
    Built { node, pack: "", recipe, files: Vec::new(), tree }
}

impl Checked {
    /// The same for who wants what of a graph can be had: its [`graph`](Self::graph) may have nodes of unknown types and missing files
    /// then, which are no more than warnings. A run reports each that something depends on as an error.
    #[must_use]
    pub fn as_far_as_known(self) -> Self {
        let mut checked = self.without_missing_files();
        if checked.partial.is_some() {
            checked.graph = checked.partial.take();
            checked.warn_of(code::UNKNOWN_NODE);
        }
        checked
    }

    /// The same for who runs a graph: files that nodes miss are no more than warnings. A run reports each that something depends on as
    /// an error.
    #[must_use]
    pub fn without_missing_files(mut self) -> Self {
        if self.partial.is_some() {
            self.warn_of(code::MISSING_FILE);
            if self.problems.iter().all(|problem| problem.severity == Severity::Warning) {
                self.graph = self.partial.take();
            }
        }
        self
    }

    fn warn_of(&mut self, code: &str) {
        let meant = self.problems.iter_mut().filter(|problem| problem.code == code);
        meant.for_each(|problem| problem.severity = Severity::Warning);
    }
}

impl Check<'_, '_> {
    /// Reads `packs: {"hair": "0.3"}`: those that the program does not have, in words.
    pub(super) fn packs(&mut self, entries: &[(Tree, Tree)]) -> Vec<String> {
        let mut missing = Vec::new();
        for (key, value) in entries {
            let (Some(name), Some(version)) = (key.text(), value.text()) else {
                let wrong = if key.text().is_some() { value } else { key };
                if !wrong.is_broken() {
                    let found = wrong.in_words();
                    let message = format!("a pack is a name and a version, not {found}");
                    let help = "write `\"hair\": \"0.3\"`";
                    self.find(code::WRONG_VALUE, wrong.span, message, help);
                }
                continue;
            };
            if !self.world.catalog.has_pack(name) {
                missing.push(format!("`{name}` {version}"));
            }
        }
        missing
    }

    /// Where nodes of an unknown type may come from, if the file says what it needs.
    pub(super) fn missing_packs(&self) -> Option<String> {
        match &self.missing_packs[..] {
            [] => None,
            [pack] => {
                Some(format!("it may be of the pack {pack}, which this program does not have"))
            }
            packs => Some(format!(
                "it may be of a pack that this program does not have: {}",
                packs.join(", ")
            )),
        }
    }
}
