//! Nodes that become a graph of their own, and uses that give way to the nodes inside of them. What is offered is worked out once it is
//! chosen, if the editor can ask then.

use gen_lsp_types::Uri;
use maquette_edit::{Extracted, Extraction};
use maquette_syntax::error::Problem;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};

use super::outline::Symbol;
use super::project::Texts;
use super::{Refused, Server, Subject};

/// What is done to which nodes.
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
    /// What can be done to the nodes at a place. `uses` are the types of nodes that are graphs.
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

    /// An action as an editor shows it; none if it cannot be done, which an editor that asks later is told then. `is_wanted` says that
    /// it may take its time now.
    pub(super) fn refactor(&mut self, action: &Refactor, is_wanted: bool) -> Option<Json> {
        let told = json!({ "title": action.title(), "kind": action.kind(), "data": action });
        match self.client.resolves {
            true => Some(told),
            false if is_wanted => self.resolved(told).ok(),
            false => None,
        }
    }

    /// An action with its edits.
    pub(super) fn resolved(&mut self, mut action: Json) -> Result<Json, Refused> {
        let Ok(refactor) = serde_json::from_value::<Refactor>(action["data"].clone()) else {
            return Ok(action);
        };
        let (Refactor::Extract { uri, .. } | Refactor::Inline { uri, .. }) = &refactor;
        let uri = uri.clone();
        let edits = self.of(&uri, |server, subject| {
            let texts = server.refactored(subject, refactor);
            texts
                .map(|texts| server.edits(&texts))
                .map_err(|problems: Vec<Problem>| Refused::Failed(in_words(&problems)))
        })?;
        action["edit"] = edits;
        Ok(action)
    }

    fn refactored(&self, subject: &Subject<'_>, refactor: Refactor) -> Result<Texts, Vec<Problem>> {
        let (path, text) = (&subject.path, subject.lines.text());
        let (catalog, options) = (&self.catalog, &subject.options);
        Ok(match refactor {
            Refactor::Extract { nodes, .. } => {
                let extraction = Extraction { nodes, ..Extraction::default() };
                let done = maquette_edit::extract(path, text, &extraction, catalog, options)?;
                let Extracted { edited, path: new, text: file, .. } = done;
                Texts::from([(path.clone(), edited.text), (new, file)])
            }
            Refactor::Inline { node, .. } => {
                let edited = maquette_edit::inline(path, text, &node, catalog, options)?;
                Texts::from([(path.clone(), edited.text)])
            }
        })
    }
}

fn in_words(problems: &[Problem]) -> String {
    problems
        .iter()
        .map(|problem| match problem.help.is_empty() {
            true => problem.message.clone(),
            false => format!("{}: {}", problem.message, problem.help),
        })
        .collect::<Vec<_>>()
        .join("; ")
}
