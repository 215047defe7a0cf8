//! Nodes of types that no pack defines. They are kept in the file, but they have no results.
//!
//! Such a node fails, and the nodes that depend on it are skipped, so the evaluator needs no special case. A node with a missing input file
//! is treated in the same way. The check of the graph still reports an error.

use std::sync::Arc;

use maquette_node::{AnyNode, Context, FilePath};
use maquette_syntax::Tree;
use maquette_syntax::error::{Diagnostic, Error, Severity, code};
use maquette_value::AnyValue;
use serde_json::json;

use super::CheckedGraph;
use super::check::Check;
use super::recipe::Recipe;
use crate::definition::BuiltNode;

/// Replaces a node of an unknown type, and fails when it is evaluated. Contains the diagnostic that reported the type, if there is one.
struct UnknownNode(Option<Diagnostic>);

/// The error of evaluating a node of an unknown type. Contains the diagnostic that reported the type, if there is one.
#[derive(Debug, thiserror::Error)]
#[error("no pack has a node of this type")]
pub struct UnknownType(pub Option<Diagnostic>);

impl AnyNode for UnknownNode {
    fn eval(&self, _: &Context<'_>) -> Result<Vec<AnyValue>, Error> {
        Err(UnknownType(self.0.clone()).into())
    }

    fn missing_reason(&self) -> Option<String> {
        Some(match &self.0 {
            Some(Diagnostic { message, help, .. }) if !help.is_empty() => {
                format!("{message}: {help}")
            }
            Some(diagnostic) => diagnostic.message.clone(),
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

/// Creates the node that replaces a node of an unknown type.
pub(super) fn unknown_node(tree: &Tree, diagnostic: Option<Diagnostic>) -> BuiltNode {
    let kind = tree.name().map_or_else(String::new, |kind| kind.text);
    let recipe = Arc::new(Recipe::new(&kind, json!({}), &[]));
    let (node, tree) = (Arc::new(UnknownNode(diagnostic)), Arc::new(tree.clone()));
    BuiltNode { node, pack: "", recipe, files: Vec::new(), tree }
}

impl CheckedGraph {
    /// Converts errors about unknown node types and missing files to warnings. [`graph`](Self::graph) then contains all parts that can be
    /// evaluated. An evaluation reports an error for each such node or file on which an output depends.
    #[must_use]
    pub fn without_unknown_nodes(self) -> Self {
        let mut checked = self.without_missing_files();
        if checked.partial.is_some() {
            checked.graph = checked.partial.take();
            checked.downgrade(code::UNKNOWN_NODE);
        }
        checked
    }

    /// Converts errors about missing files to warnings, so that the graph can be run. The run reports an error for each missing file on
    /// which an output depends.
    #[must_use]
    pub fn without_missing_files(mut self) -> Self {
        if self.partial.is_some() {
            self.downgrade(code::MISSING_FILE);
            if self.diagnostics.iter().all(|diagnostic| diagnostic.severity == Severity::Warning) {
                self.graph = self.partial.take();
            }
        }
        self
    }

    fn downgrade(&mut self, code: &str) {
        let meant = self.diagnostics.iter_mut().filter(|diagnostic| diagnostic.code == code);
        meant.for_each(|diagnostic| diagnostic.severity = Severity::Warning);
    }
}

impl Check<'_, '_> {
    /// Reads the required packs, `packs: {"hair": "0.3"}`. Returns those that the program does not have, with their versions.
    pub(super) fn missing_of_packs(&mut self, entries: &[(Tree, Tree)]) -> Vec<String> {
        let mut missing = Vec::new();
        for (key, value) in entries {
            let (Some(name), Some(version)) = (key.text(), value.text()) else {
                let wrong = if key.text().is_some() { value } else { key };
                if !wrong.is_broken() {
                    let found = wrong.describe();
                    let message = format!("a pack is a name and a version, not {found}");
                    let help = "write `\"hair\": \"0.3\"`";
                    self.report(code::WRONG_VALUE, wrong.span, message, help);
                }
                continue;
            };
            if !self.world.catalog.has_pack(name) {
                missing.push(format!("`{name}` {version}"));
            }
        }
        missing
    }

    /// Returns the help for a node of an unknown type: the required packs that the program does not have. `None` if it has all required
    /// packs.
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
