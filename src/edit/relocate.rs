//! Moves nodes from one graph file to another: moves their entries and comments, adapts paths, and replaces parameters by values.

mod entries;
mod fingerprint;
mod parsed_graph;
mod values;

pub(super) use entries::{
    apply_within, indented_entries, replace_entry, separator_after, take_entries,
};
pub(super) use fingerprint::Fingerprints;
use maquette_graph::load::load_with;
use maquette_graph::tree::is_patch;
use maquette_graph::world::World;
use maquette_graph::{EditError, Files, Options};
use maquette_syntax::error::{Diagnostic, Span, code};
use maquette_syntax::{parse, syntax_diagnostics};
pub(super) use parsed_graph::{ParsedGraph, ResolvedLink};
pub(super) use values::{ParameterValue, expression, substitution_splices};

use super::Editor;

impl Editor<'_> {
    /// Parses a graph whose nodes are to be moved, and computes its fingerprints.
    ///
    /// # Errors
    /// All errors of the graph, if it is not valid.
    pub(super) fn load_valid(
        &self,
        text: &str,
    ) -> Result<(ParsedGraph, Fingerprints), Vec<Diagnostic>> {
        let options = Options { files: Files::Inside, draft: false, ..self.options.clone() };
        let (checked, known) = load_with(
            self.path,
            text.to_owned(),
            self.catalog,
            &options,
            |world: &mut World<'_>, whole| {
                let is_patched = whole.definition.is_patched();
                (!is_patched).then(|| ParsedGraph::from_file(world, whole.clone()))
            },
        );
        let sides = self.fingerprints_of_checked(text, &checked).ok();
        known.flatten().zip(sides).ok_or_else(|| self.errors_of(text))
    }

    /// Returns the reasons why nodes of this graph cannot be moved: its errors, or an error if it is a patch.
    fn errors_of(&self, text: &str) -> Vec<Diagnostic> {
        let (tree, errors) = parse(text);
        if !errors.is_empty() {
            return syntax_diagnostics(self.path, text, errors);
        }
        if is_patch(&tree) {
            let message = "a patch has values of nodes, but no nodes of its own".to_owned();
            let help = "do it in the graph that it is `of`".to_owned();
            let span = tree.name().map_or(tree.span, |name| name.span);
            return self.diagnostics(text, EditError { code: code::SYNTAX, span, message, help });
        }
        self.fingerprints(text).err().unwrap_or_default()
    }

    /// Returns options for parsing a graph without requiring the files that its nodes read.
    pub(super) fn reading_options(&self) -> Options {
        let Options { roots, texts, .. } = self.options.clone();
        Options { roots, texts, files: Files::Ignored, ..Options::default() }
    }

    pub(super) fn diagnostics(&self, text: &str, error: EditError) -> Vec<Diagnostic> {
        vec![self.diagnostic(text, error)]
    }
}

pub(super) fn edit_error(
    code: &'static str,
    span: Span,
    message: impl Into<String>,
    help: impl Into<String>,
) -> EditError {
    EditError { code, span, message: message.into(), help: help.into() }
}

/// Returns the first of the `wanted` names that is free. If none is free, appends a number to the last wanted name.
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
