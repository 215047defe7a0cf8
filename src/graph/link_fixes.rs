//! Edits that fix invalid links. A fix is proposed only if no other fix is possible.

use maquette_syntax::FoundLink;
use maquette_syntax::error::{MAX_REPORTED, Span};
use maquette_value::ValueType;

use super::check::Check;
use super::dependencies::Dependencies;
use super::splice::newline;
use crate::definition::{NodeKind, ParsedNode};

/// An edit of a text: the span to be replaced, and the new text.
type Edit = (Span, String);

impl Check<'_, '_> {
    /// Returns the edits that give a link the required type, if there is exactly one way to do so. Either the link is changed to another
    /// output of the same node, or a conversion node without other required fields is inserted.
    pub(super) fn type_fix(
        &self,
        link: &FoundLink,
        kind: &ValueType,
        parsed_nodes: &[ParsedNode],
        user: &ParsedNode,
    ) -> Option<Vec<Edit>> {
        let node = link.text.split('.').next().unwrap_or_default();
        let source = parsed_nodes.iter().find(|parsed| parsed.name.text == node)?;
        if matches!(source.what, NodeKind::Elements(_)) {
            return None;
        }
        let outputs = source.what.outputs();
        let outputs = outputs.iter().zip(&source.types);
        let outputs = outputs.filter(|(_, kind)| {
            kind.is_some_and(|kind| link.types.iter().any(|wanted| wanted == kind.name))
        });
        let siblings = outputs.map(|(output, _)| vec![(link.span, quote(&[node, output]))]);
        let makers = link.types.iter().flat_map(|wanted| {
            let catalog = &self.world.catalog;
            catalog.converters(kind.name, wanted).into_iter().filter_map(|name| catalog.find(name))
        });
        let between = makers.filter_map(|maker| {
            let port = maker.ports().into_iter().next()?;
            let required = maker.schema().get("required")?.as_array()?;
            let is_all = matches!(&required[..], [only] if only.as_str() == Some(&port.name));
            is_all.then(|| {
                self.insert_converter(link, maker.name.as_str(), &port.name, parsed_nodes, user)
            })?
        });
        let mut answers = siblings.chain(between);
        answers.next().filter(|_| answers.next().is_none())
    }

    /// Returns the edits that insert a node into a link: the new node takes the linked value, and the user of the link takes its result.
    fn insert_converter(
        &self,
        link: &FoundLink,
        maker: &str,
        port: &str,
        parsed_nodes: &[ParsedNode],
        user: &ParsedNode,
    ) -> Option<Vec<Edit>> {
        let (source, at) = self.source_map.locate(user.name.span);
        let start = source.text.get(..at.start)?.rfind(['\n', '\r']).map_or(0, |end| end + 1);
        let indent = source.text.get(start..at.start)?;
        let gap = match indent.trim().is_empty() {
            true => format!("{}{indent}", newline(&source.text, at.start)),
            false => " ".into(),
        };
        let name = format!("{}-{}", link.text.replace(['.', '/'], "-"), maker.to_lowercase());
        if parsed_nodes.iter().any(|parsed| parsed.name.text == name) {
            return None;
        }
        let span = Span { start: user.name.span.start, end: user.name.span.start };
        let entry = format!("{}: {maker}({port}: {}),{gap}", quote(&[&name]), quote(&[&link.text]));
        Some(vec![(span, entry), (link.span, quote(&[&name]))])
    }

    /// Adds a fix to each error about a port without a link, if exactly one value of the graph has the required type and does not depend on
    /// the node with the port. Only errors that will be shown are considered, because each of them is compared with all values.
    pub(super) fn suggest_missing_links(
        &mut self,
        parsed_nodes: &[ParsedNode],
        needs: &Dependencies,
    ) {
        for at in 0..self.diagnostics.len().min(MAX_REPORTED) {
            let diagnostic = &self.diagnostics[at];
            let Some((port, wants)) = diagnostic.help.missing_link() else { continue };
            let user = parsed_nodes.iter().position(|parsed| {
                let tree = parsed.tree.span;
                tree.start <= diagnostic.span.start && diagnostic.span.end <= tree.end
            });
            let Some(user) = user else { continue };
            let mut is_user = vec![false; parsed_nodes.len()];
            let mut open = vec![user];
            while let Some(index) = open.pop() {
                if !std::mem::replace(&mut is_user[index], true) {
                    open.extend(needs.users(index));
                }
            }
            let free = parsed_nodes.iter().zip(is_user).filter(|(parsed, is_user)| {
                !is_user && !parsed.name.text.contains('/') && parsed.repeat.is_none()
            });
            let mut links = free.flat_map(|(parsed, _)| {
                let (name, names) = (&parsed.name.text[..], parsed.what.outputs());
                let outputs = names.into_iter().zip(&parsed.types);
                let outputs = outputs.filter(|(_, kind)| {
                    kind.is_some_and(|kind| wants.iter().any(|wanted| wanted == kind.name))
                });
                let links = outputs.map(|(output, _)| match parsed.types.len() {
                    1 => quote(&[name]),
                    _ => quote(&[name, output]),
                });
                links.collect::<Vec<_>>()
            });
            let Some(link) = links.next().filter(|_| links.next().is_none()) else { continue };
            if let Some(edit) = self.field_edit(diagnostic.span, port, &link) {
                self.diagnostics[at].help.set_edits(vec![edit]);
            }
        }
    }

    /// Returns the edit that inserts a field at the beginning of the call at `span`.
    fn field_edit(&self, span: Span, field: &str, value: &str) -> Option<Edit> {
        let (source, place) = self.source_map.locate(span);
        let text = source.text.get(place.start..place.end)?;
        let open = text.find('(')? + 1;
        let rest = text[open..].trim_start();
        let comma = if rest.starts_with(')') { "" } else { ", " };
        let start = span.start + open;
        Some((Span { start, end: start }, format!("{field}: {value}{comma}")))
    }
}

/// Joins the parts of a link by dots, and puts quotes around the result: `"scan.color"`.
fn quote(parts: &[&str]) -> String {
    format!("\"{}\"", parts.join("."))
}
