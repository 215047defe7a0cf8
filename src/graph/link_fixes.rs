//! Edits that make problems of links go away, where there is one answer.

use maquette_syntax::FoundLink;
use maquette_syntax::error::{MOST_TOLD, Span};
use maquette_value::ValueType;

use super::check::Check;
use super::needs::Needs;
use super::splice::newline;
use crate::definition::{Draft, What};

/// What stands at a span becomes the text.
type Edit = (Span, String);

impl Check<'_, '_> {
    /// How what comes in at a link of this draft gets the type that is wanted: as another output of the same node, or by a node
    /// between both that needs nothing else.
    pub(super) fn fitted(
        &self,
        link: &FoundLink,
        kind: &ValueType,
        drafts: &[Draft],
        user: &Draft,
    ) -> Option<Vec<Edit>> {
        let node = link.text.split('.').next().unwrap_or_default();
        let source = drafts.iter().find(|draft| draft.name.text == node)?;
        if matches!(source.what, What::Elements(_)) {
            return None;
        }
        let outputs = source.what.outputs();
        let outputs = outputs.iter().zip(&source.types);
        let outputs = outputs.filter(|(_, kind)| {
            kind.is_some_and(|kind| link.types.iter().any(|wanted| wanted == kind.name))
        });
        let siblings = outputs.map(|(output, _)| vec![(link.span, quoted(&[node, output]))]);
        let makers = link.types.iter().flat_map(|wanted| {
            let catalog = &self.world.catalog;
            catalog.converters(kind.name, wanted).into_iter().filter_map(|name| catalog.find(name))
        });
        let between = makers.filter_map(|maker| {
            let port = maker.ports().into_iter().next()?;
            let required = maker.schema().get("required")?.as_array()?;
            let is_all = matches!(&required[..], [only] if only.as_str() == Some(&port.name));
            is_all.then(|| self.between(link, maker.name.as_str(), &port.name, drafts, user))?
        });
        let mut answers = siblings.chain(between);
        answers.next().filter(|_| answers.next().is_none())
    }

    /// A new node before the draft, which takes what the link leads to; the link leads to it.
    fn between(
        &self,
        link: &FoundLink,
        maker: &str,
        port: &str,
        drafts: &[Draft],
        user: &Draft,
    ) -> Option<Vec<Edit>> {
        let (source, at) = self.sheet.place(user.name.span);
        let start = source.text.get(..at.start)?.rfind(['\n', '\r']).map_or(0, |end| end + 1);
        let indent = source.text.get(start..at.start)?;
        let gap = match indent.trim().is_empty() {
            true => format!("{}{indent}", newline(&source.text, at.start)),
            false => " ".into(),
        };
        let name = format!("{}-{}", link.text.replace(['.', '/'], "-"), maker.to_lowercase());
        if drafts.iter().any(|draft| draft.name.text == name) {
            return None;
        }
        let span = Span { start: user.name.span.start, end: user.name.span.start };
        let entry =
            format!("{}: {maker}({port}: {}),{gap}", quoted(&[&name]), quoted(&[&link.text]));
        Some(vec![(span, entry), (link.span, quoted(&[&name]))])
    }

    /// Links at ports that lack one, if one value of the graph has the type that is wanted and does not hang on the node. Of problems
    /// that are told, alone: each looks at all that there is.
    pub(super) fn link_lacking(&mut self, drafts: &[Draft], needs: &Needs) {
        for at in 0..self.findings.len().min(MOST_TOLD) {
            let finding = &self.findings[at];
            let Some((port, wants)) = finding.help.lacking() else { continue };
            let holds =
                |tree: Span| tree.start <= finding.span.start && finding.span.end <= tree.end;
            let Some(user) = drafts.iter().position(|draft| holds(draft.tree.span)) else {
                continue;
            };
            let mut hangs_on_it = vec![false; drafts.len()];
            let mut open = vec![user];
            while let Some(index) = open.pop() {
                if !std::mem::replace(&mut hangs_on_it[index], true) {
                    open.extend(needs.users(index));
                }
            }
            let free = drafts.iter().zip(hangs_on_it).filter(|(draft, hangs_on_it)| {
                !hangs_on_it && !draft.name.text.contains('/') && draft.repeat.is_none()
            });
            let mut links = free.flat_map(|(draft, _)| {
                let (name, names) = (&draft.name.text[..], draft.what.outputs());
                let outputs = names.into_iter().zip(&draft.types);
                let outputs = outputs.filter(|(_, kind)| {
                    kind.is_some_and(|kind| wants.iter().any(|wanted| wanted == kind.name))
                });
                fn link(
                    output: &str,
                    name: &str,
                    draft_types: &[Option<&'static ValueType>],
                ) -> String {
                    match draft_types.len() {
                        1 => quoted(&[name]),
                        _ => quoted(&[name, output]),
                    }
                }
                outputs.map(|(output, _)| link(output, name, &draft.types)).collect::<Vec<_>>()
            });
            let Some(link) = links.next().filter(|_| links.next().is_none()) else { continue };
            if let Some(edit) = self.field_edit(finding.span, port, &link) {
                self.findings[at].help.with_edits(vec![edit]);
            }
        }
    }

    /// A new first field of the call at a span.
    fn field_edit(&self, span: Span, field: &str, value: &str) -> Option<Edit> {
        let (source, place) = self.sheet.place(span);
        let text = source.text.get(place.start..place.end)?;
        let open = text.find('(')? + 1;
        let rest = text[open..].trim_start();
        let comma = if rest.starts_with(')') { "" } else { ", " };
        let start = span.start + open;
        Some((Span { start, end: start }, format!("{field}: {value}{comma}")))
    }
}

/// A link, `"scan.color"`, or a name.
fn quoted(parts: &[&str]) -> String {
    format!("\"{}\"", parts.join("."))
}
