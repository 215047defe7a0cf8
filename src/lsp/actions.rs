//! Code actions: fix one diagnostic, fix all diagnostics, refactor, and inspect a node.

use maquette_edit::resolve_path;
use maquette_golden::suite::FileKind;
use maquette_syntax::error::{Diagnostic, Severity, Span};
use maquette_syntax::first_word;
use serde_json::{Value as Json, json};

use super::checker::diagnostic;
use super::commands::APPLY;
use super::missing::additions;
use super::outline::{self};
use super::params::range;
use super::project::Texts;
use super::{RequestError, Server, Subject};

impl Server {
    pub(super) fn actions(
        &mut self,
        subject: &Subject<'_>,
        params: &Json,
    ) -> Result<Json, RequestError> {
        let text = subject.lines.text();
        let range = range(&params["range"])?;
        let (start, end) = (subject.lines.offset(range.start), subject.lines.offset(range.end));
        let only = params["context"]["only"].as_array();
        fn wants(kind: &str, only: &Option<&Vec<Json>>) -> bool {
            only.is_none_or(|only| {
                only.iter().any(|wanted| {
                    wanted.as_str().is_some_and(|wanted| {
                        wanted.is_empty()
                            || kind == wanted
                            || kind.starts_with(&format!("{wanted}."))
                    })
                })
            })
        }
        let mut found = Vec::new();
        let kind = FileKind::detect(&subject.path, text);
        if wants("quickfix", &only) {
            let (problems, _) =
                kind.diagnostics(&subject.path, text.to_owned(), &self.catalog, &subject.options);
            let library = self.library(&subject.path, &subject.options);
            // Offer a text for a missing field only if it reduces the number of errors. For example, do not offer a link that would cause a
            // cycle.
            fn errors(all: &[Diagnostic]) -> usize {
                all.iter().filter(|problem| problem.severity == Severity::Error).count()
            }
            for problem in problems
                .iter()
                .filter(|problem| {
                    resolve_path(&problem.source.name) == subject.path
                        && *problem.source.text == *text
                })
                .filter(|problem| problem.span.start <= end && start <= problem.span.end)
            {
                let mut fix = |title: String, edits: &[(Span, String)], is_only: bool| {
                    let edits =
                        edits.iter().map(|(span, new)| subject.lines.edit(*span, new.clone()));
                    let changes = json!({ &subject.uri.0: edits.collect::<Vec<_>>() });
                    found.push(json!({
                        "title": title,
                        "kind": "quickfix",
                        "isPreferred": is_only,
                        "diagnostics": [diagnostic(problem, self.client)],
                        "edit": { "changes": changes },
                    }));
                };
                if !problem.fix.is_empty() {
                    fix(title(problem), &problem.fix, true);
                } else if let Some((span, texts)) = additions(&library, problem, |text| {
                    let text = text.to_owned();
                    let left =
                        kind.diagnostics(&subject.path, text, &self.catalog, &subject.options);
                    errors(&left.0) < errors(&problems)
                }) {
                    for text in texts {
                        let title = format!("Write `{}`", short(text.trim_end_matches(", ")));
                        fix(title, &[(span, text)], false);
                    }
                }
            }
        }
        // Offer the action that fixes all errors only if the editor explicitly requests this kind of action, as editors do on save.
        let is_all = only.is_some() && wants("source.fixAll", &only);
        if is_all && kind == FileKind::Graph {
            let (mended, problems) =
                maquette_edit::apply_fixes(&subject.path, text, &self.catalog, &subject.options);
            if !problems.is_empty() {
                let edits = self.edits(&Texts::from([(subject.path.clone(), mended)]));
                let title = "Fix all errors that have a single fix";
                found.push(json!({ "title": title, "kind": "source.fixAll", "edit": edits }));
            }
        }
        if first_word(text) != "Graph" {
            return Ok(self.encode_actions(found));
        }
        let sections = outline::sections(text);
        let entries = |name: &'static str| {
            sections.iter().filter(move |it| it.name == name).flat_map(|it| &it.entries)
        };
        let nodes: Vec<_> =
            entries("nodes").filter(|it| it.span.start <= end && start <= it.span.end).collect();
        for action in self.refactors(subject, &nodes, &Vec::from_iter(entries("use"))) {
            if wants(action.kind(), &only) {
                let is_automatic = params["context"]["triggerKind"] == AUTOMATIC;
                found.extend(self.refactor(&action, !is_automatic));
            }
        }
        if only.is_none()
            && let [node] = &nodes[..]
        {
            for (title, command) in
                [("Inspect", "maquette.inspect"), ("Why does it run:", "maquette.why")]
            {
                let title = format!("{title} `{}`", node.name);
                let command = json!({ "title": title, "command": command, "arguments": [subject.uri.0, node.name] });
                found.push(json!({ "title": title, "command": command }));
            }
        }
        Ok(self.encode_actions(found))
    }

    /// Encodes code actions for the editor. An editor that does not support literal code actions gets commands instead.
    fn encode_actions(&self, actions: Vec<Json>) -> Json {
        if self.client.has_action_literals {
            return actions.into();
        }
        actions
            .into_iter()
            .map(|action: Json| match action.get("edit") {
                Some(edit) => {
                    json!({ "title": action["title"], "command": APPLY, "arguments": [edit] })
                }
                None => action["command"].clone(),
            })
            .filter(Json::is_object)
            .collect()
    }
}

/// The value `CodeActionTriggerKind.Automatic` of the protocol: the editor sent the request without the user asking for it.
const AUTOMATIC: u8 = 2;

/// Returns the title of the code action that applies the fix of a diagnostic.
fn title(problem: &Diagnostic) -> String {
    match &problem.fix[..] {
        [(span, new)] if span.start == span.end => format!("Write `{}`", short(new)),
        [(_, new)] if new.is_empty() => "Remove it".into(),
        [(span, new)] => {
            let old = problem.source.text.get(span.start..span.end).unwrap_or_default();
            format!("Replace `{}` by `{}`", short(old), short(new))
        }
        _ => "Fix it".into(),
    }
}

/// Shortens a text so that it fits into the title of a code action.
fn short(text: &str) -> String {
    const MAX_CHARS: usize = 40;
    let line = text.trim().lines().next().unwrap_or_default();
    match line.chars().count() {
        ..=MAX_CHARS => line.to_owned(),
        _ => line.chars().take(MAX_CHARS).chain("..".chars()).collect(),
    }
}
