//! Document symbols and workspace symbols.

use std::path::PathBuf;

use gen_lsp_types::Uri;
use maquette_syntax::error::Span;
use serde_json::{Value as Json, json};

use super::outline::{self, Section};
use super::position::Lines;
use super::project::files_of;
use super::{Server, is_ours};

/// The maximum number of workspace symbols in an answer.
const MAX_SYMBOLS: usize = 2_000;

/// Returns the symbol kind of the entries of a section.
fn kind_of(section: &Section) -> u8 {
    match &section.name[..] {
        "nodes" => 12,
        "params" => 14,
        "inputs" => 13,
        "outputs" => 17,
        _ => 5,
    }
}

/// Returns the document symbols of a text: its sections, each with its entries as children.
pub(super) fn symbols(lines: &Lines<'_>) -> Json {
    let sections = outline::sections(lines.text());
    let symbols = sections.iter().map(|section| {
        let kind = kind_of(section);
        let children = section
            .entries
            .iter()
            .map(|entry| {
                json!({
                    "name": if entry.name.is_empty() { "\"\"" } else { &entry.name },
                    "detail": entry.kind,
                    "kind": kind,
                    "range": lines.range(entry.span),
                    "selectionRange": lines.range(entry.at),
                })
            })
            .collect::<Json>();
        json!({
            "name": section.name,
            "kind": if section.entries.is_empty() { 8 } else { 3 },
            "range": lines.range(section.span),
            "selectionRange": lines.range(section.at),
            "children": children,
        })
    });
    symbols.collect()
}

/// Returns the entries of all sections whose names match the query, that is, contain its letters in order.
pub(super) fn flat_symbols(lines: &Lines<'_>, uri: &Uri, query: &str) -> Vec<Json> {
    let mut found = Vec::new();
    for section in outline::sections(lines.text()) {
        let kind = kind_of(&section);
        let mut symbols: Vec<(&str, u8, Span, &str)> = Vec::new();
        if section.entries.is_empty() {
            symbols.push((&section.name, 8, section.span, ""));
        }
        for entry in &section.entries {
            symbols.push((&entry.name, kind, entry.span, &section.name));
        }
        for (name, kind, span, container) in symbols {
            if !name.is_empty() && has_letters(name, query) {
                let location = json!({ "uri": uri, "range": lines.range(span) });
                found.push(json!({ "name": name, "kind": kind, "location": location, "containerName": container }));
            }
        }
    }
    found
}

/// Returns true if a name contains the letters of a query in this order, ignoring case.
pub(super) fn has_letters(name: &str, query: &str) -> bool {
    let mut rest = name.chars().flat_map(char::to_lowercase);
    query.chars().flat_map(char::to_lowercase).all(|c| rest.any(|other| other == c))
}

impl Server {
    /// Returns the names that match the query, from all files of the open projects.
    pub(super) fn workspace_symbols(&self, query: &str) -> Json {
        let options = self.options();
        // Pass the path of a file, because functions expect one. It need not exist: any path in a folder identifies the folder's project.
        let folders = self.folders.iter().map(|folder| folder.join("maquette.toml"));
        let mut files = Vec::<PathBuf>::new();
        for path in folders.chain(self.documents.keys().cloned()) {
            if !files.contains(&path) {
                files.extend(files_of(&path, &options));
            }
        }
        files.sort();
        files.dedup();
        let mut found = Vec::new();
        for file in files {
            let text = self.text(&file);
            if found.len() < MAX_SYMBOLS && is_ours(&file, &text) && !self.is_large(&text) {
                let lines = Lines::new(&text, self.client.columns);
                found.extend(flat_symbols(&lines, &self.uri(&file), query));
            }
        }
        found.truncate(MAX_SYMBOLS);
        found.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_match_letters_in_order() {
        assert!(has_letters("left-eye", "LE"));
        assert!(has_letters("left-eye", ""));
        assert!(!has_letters("left-eye", "yl"));
    }
}
