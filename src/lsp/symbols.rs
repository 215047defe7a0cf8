//! The names of a text, or of all texts of a project, as editors list them.

use std::path::PathBuf;

use gen_lsp_types::Uri;
use maquette_syntax::error::Span;
use serde_json::{Value as Json, json};

use super::outline::{self, Section};
use super::place::Lines;
use super::project::files_of;
use super::{Server, is_ours};

/// More symbols of a project are not listed: a longer query has fewer.
const MAX_SYMBOLS: usize = 2_000;

/// What the entries of a section are to an editor.
fn kind_of(section: &Section) -> u8 {
    match &section.name[..] {
        "nodes" => 12,
        "params" => 14,
        "inputs" => 13,
        "outputs" => 17,
        _ => 5,
    }
}

/// The sections of a text, each with its entries.
pub(super) fn symbols(lines: &Lines<'_>) -> Json {
    let symbol = |section: &Section| {
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
    };
    outline::sections(lines.text()).iter().map(symbol).collect()
}

/// The entries of all sections whose names have the letters of a query in them, in their order.
pub(super) fn flat_symbols(lines: &Lines<'_>, uri: &Uri, query: &str) -> Vec<Json> {
    let mut found = Vec::new();
    for section in outline::sections(lines.text()) {
        let kind = kind_of(&section);
        let mut add = |name: &str, kind: u8, span: Span, within: &str| {
            if !name.is_empty() && has_letters(name, query) {
                let location = json!({ "uri": uri, "range": lines.range(span) });
                let symbol = json!({ "name": name, "kind": kind, "location": location, "containerName": within });
                found.push(symbol);
            }
        };
        if section.entries.is_empty() {
            add(&section.name, 8, section.span, "");
        }
        for entry in &section.entries {
            add(&entry.name, kind, entry.span, &section.name);
        }
    }
    found
}

/// Returns true if the letters of a query are in a name, in their order, whatever their case.
pub(super) fn has_letters(name: &str, query: &str) -> bool {
    let mut rest = name.chars().flat_map(char::to_lowercase);
    query.chars().flat_map(char::to_lowercase).all(|c| rest.any(|other| other == c))
}

impl Server {
    /// The names in all texts of the projects that are open.
    pub(super) fn workspace_symbols(&self, query: &str) -> Json {
        let options = self.options();
        // A file of a folder stands for its project.
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
    fn letters_in_their_order_find_a_name() {
        assert!(has_letters("left-eye", "LE"));
        assert!(has_letters("left-eye", ""));
        assert!(!has_letters("left-eye", "yl"));
    }
}
