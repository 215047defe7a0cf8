//! Refactorings: extract nodes into a new graph, and inline a used graph. If the editor supports it, the edits are computed only after the
//! user has chosen a refactoring.

use gen_lsp_types::Uri;
use maquette_edit::{ExtractedGraph, Extraction};
use maquette_syntax::error::Diagnostic;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};

use super::outline::Symbol;
use super::project::Texts;
use super::{RequestError, Server, Subject};

/// A refactoring, and the nodes to which it is applied.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Refactor {
    Extract { uri: Uri, nodes: Vec<String> },
    Inline { uri: Uri, node: String },
}

impl Refactor {
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Self::Extract { .. } => "refactor.extract",
            Self::Inline { .. } => "refactor.inline",
        }
    }

    fn title(&self) -> String {
        match self {
            Self::Extract { nodes, .. } => match &nodes[..] {
                [node] => format!("Extract `{node}` into a graph"),
                _ => format!("Extract {} nodes into a graph", nodes.len()),
            },
            Self::Inline { node, .. } => format!("Inline `{node}`"),
        }
    }
}

impl Server {
    /// Returns the refactorings that are possible for the nodes in a span. `uses` are the names of the graphs that the file uses as node
    /// types.
    pub(super) fn refactors(
        &self,
        subject: &Subject<'_>,
        nodes: &[&Symbol],
        uses: &[&Symbol],
    ) -> Vec<Refactor> {
        fn uri(subject_uri: &Uri) -> Uri {
            subject_uri.clone()
        }
        let mut found = Vec::new();
        if self.client.creates_files && !nodes.is_empty() {
            let nodes = nodes.iter().map(|node| node.name.clone()).collect();
            found.push(Refactor::Extract { uri: uri(&subject.uri), nodes });
        }
        if let [node] = nodes
            && uses.iter().any(|it| it.name == node.kind)
        {
            found.push(Refactor::Inline { uri: uri(&subject.uri), node: node.name.clone() });
        }
        found
    }

    /// Returns the code action for a refactoring. If the editor can resolve actions later, the action has no edits yet. For other editors,
    /// the action includes its edits. For these, returns `None` if `is_wanted` is false or the refactoring is impossible.
    pub(super) fn refactor(&mut self, action: &Refactor, is_wanted: bool) -> Option<Json> {
        let json = json!({ "title": action.title(), "kind": action.kind(), "data": action });
        match self.client.resolves_actions {
            true => Some(json),
            false if is_wanted => self.resolve(json).ok(),
            false => None,
        }
    }

    /// Computes the edits of a code action that the user has chosen, and adds them to the action.
    pub(super) fn resolve(&mut self, mut action: Json) -> Result<Json, RequestError> {
        let Ok(refactor) = serde_json::from_value::<Refactor>(action["data"].clone()) else {
            return Ok(action);
        };
        let (Refactor::Extract { uri, .. } | Refactor::Inline { uri, .. }) = &refactor;
        let uri = uri.clone();
        let edits = self.answer_document(&uri, |server, subject| {
            let texts = server.apply(subject, refactor);
            texts
                .map(|texts| server.edits(&texts))
                .map_err(|problems: Vec<Diagnostic>| RequestError::Failed(in_words(&problems)))
        })?;
        action["edit"] = edits;
        Ok(action)
    }

    fn apply(&self, subject: &Subject<'_>, refactor: Refactor) -> Result<Texts, Vec<Diagnostic>> {
        let (path, text) = (&subject.path, subject.lines.text());
        let (catalog, options) = (&self.catalog, &subject.options);
        Ok(match refactor {
            Refactor::Extract { nodes, .. } => {
                let extraction = Extraction { nodes, ..Extraction::default() };
                let done = maquette_edit::extract(path, text, &extraction, catalog, options)?;
                let ExtractedGraph { edited, path: new, text: file, .. } = done;
                Texts::from([(path.clone(), edited.text), (new, file)])
            }
            Refactor::Inline { node, .. } => {
                let edited = maquette_edit::inline(path, text, &node, catalog, options)?;
                Texts::from([(path.clone(), edited.text)])
            }
        })
    }
}

fn in_words(problems: &[Diagnostic]) -> String {
    problems
        .iter()
        .map(|problem| match problem.help.is_empty() {
            true => problem.message.clone(),
            false => format!("{}: {}", problem.message, problem.help),
        })
        .collect::<Vec<_>>()
        .join("; ")
}
