//! The manual of the graph language, which is printed by `maquette help TOPIC` and published as `docs/language.md`.

mod plain;
#[cfg(test)]
mod tests;

use maquette_graph::catalog::Catalog;
use maquette_node::{DataKind, Fidelities, Fidelity};
pub use plain::plain;

/// A topic of the manual. Its text is the file `src/lsp/manual/NAME.md`, which begins with a title.
pub struct Topic {
    pub name: &'static str,
    pub text: &'static str,
}

/// All topics, in the order in which the manual presents them.
pub const TOPICS: &[Topic] = &[
    Topic { name: "graph", text: include_str!("manual/graph.md") },
    Topic { name: "params", text: include_str!("manual/params.md") },
    Topic { name: "expr", text: include_str!("manual/expr.md") },
    Topic { name: "units", text: include_str!("manual/units.md") },
    Topic { name: "foreach", text: include_str!("manual/foreach.md") },
    Topic { name: "switch", text: include_str!("manual/switch.md") },
    Topic { name: "use", text: include_str!("manual/use.md") },
    Topic { name: "patch", text: include_str!("manual/patch.md") },
    Topic { name: "promises", text: include_str!("manual/promises.md") },
    Topic { name: "attributes", text: include_str!("manual/attributes.md") },
    Topic { name: "expect", text: include_str!("manual/expect.md") },
    Topic { name: "test", text: include_str!("manual/test.md") },
    Topic { name: "sweep", text: include_str!("manual/sweep.md") },
    Topic { name: "drafts", text: include_str!("manual/drafts.md") },
    Topic { name: "pins", text: include_str!("manual/pins.md") },
    Topic { name: "formats", text: include_str!("manual/formats.md") },
    Topic { name: "limits", text: include_str!("manual/limits.md") },
    Topic { name: "tables", text: include_str!("manual/tables.md") },
    Topic { name: "provenance", text: include_str!("manual/provenance.md") },
    Topic { name: "migrate", text: include_str!("manual/migrate.md") },
    Topic { name: "merge", text: include_str!("manual/merge.md") },
];

/// The placeholder in a text for the table that shows how each node transfers attributes.
const ROWS: &str = "| .. | .. | .. | .. | .. | .. | .. |\n";

/// The placeholders in texts for tables of file formats. Each has the type of values, and a flag: true for formats that are read, false for
/// formats that are written.
const TABLES: [(&str, &str, bool); 4] = [
    ("| meshes, written |\n", "Mesh", false),
    ("| meshes, read |\n", "Mesh", true),
    ("| points, written |\n", "Points", false),
    ("| points, read |\n", "Points", true),
];

impl Topic {
    /// Returns the text of the topic. Tables of nodes and file formats are filled in from the catalog.
    pub fn render(&self, catalog: &Catalog) -> String {
        let text = self.text.replace(ROWS, &rows(catalog));
        TABLES.iter().fold(text, |text, (mark, kind, is_read)| match text.contains(mark) {
            true => text.replace(mark, &fidelity_table(catalog, kind, *is_read)),
            false => text,
        })
    }
}

/// Renders the table of attribute transfers, with a row for each port and output of each node.
fn rows(catalog: &Catalog) -> String {
    let mut rows = String::new();
    for entry in catalog.entries() {
        for carry in entry.carries() {
            let json = carry.to_json();
            let fates = ["vertex", "corner", "edge", "face", "cell"]
                .map(|key| json[key].as_str().unwrap_or("-").to_owned())
                .join(" | ");
            rows +=
                &format!("| {} | `{}`, `{}` | {fates} |\n", entry.name, carry.port, carry.output);
        }
    }
    rows
}

/// Renders a table that shows what each file format preserves of a value of this type. It has a row for each kind of data. Notes on
/// conversions follow the table.
fn fidelity_table(catalog: &Catalog, kind: &str, is_read: bool) -> String {
    let Some(kind) = catalog.value_type(kind) else { return String::new() };
    let formats = catalog.fidelities(kind, is_read);
    let rows = DataKind::ALL.map(|kind| {
        let fates = formats.iter().map(|(_, list)| fidelity(list, kind));
        (kind.name(), Vec::from_iter(fates))
    });
    let longest = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let widths: Vec<_> = formats.iter().map(|(name, _)| name.len().max("changed".len())).collect();
    fn line(
        first: &str,
        cells: &mut dyn Iterator<Item = &str>,
        widths: &[usize],
        longest: usize,
    ) -> String {
        let cells = cells.zip(widths).map(|(cell, width)| format!(" {cell:<width$} |"));
        format!("| {first:<longest$} |{}\n", String::from_iter(cells))
    }
    let mut text = line("", &mut formats.iter().map(|(name, _)| &name[..]), &widths, longest);
    let dashes = widths.iter().map(|width| format!("{}|", "-".repeat(width + 2)));
    text += &format!("|{}|{}\n", "-".repeat(longest + 2), String::from_iter(dashes));
    let mut notes = String::new();
    for (name, fates) in &rows {
        text += &line(
            name,
            &mut fates.iter().map(|fate| match fate {
                Some(Fidelity::Kept) => "kept",
                Some(Fidelity::Changed(_)) => "changed",
                None => "lost",
            }),
            &widths,
            longest,
        );
        for (fate, (format, _)) in fates.iter().zip(&formats) {
            if let Some(Fidelity::Changed(how)) = fate {
                notes += &format!("- {name}, `{format}`: {how}\n");
            }
        }
    }
    if notes.is_empty() { text } else { format!("{text}\n{notes}") }
}

fn fidelity(list: Fidelities, kind: DataKind) -> Option<Fidelity> {
    list.iter().find(|(listed, _)| *listed == kind).map(|(_, fidelity)| *fidelity)
}

/// Returns the topic with this name, ignoring case.
pub fn topic(name: &str) -> Option<&'static Topic> {
    TOPICS.iter().find(|topic| topic.name.eq_ignore_ascii_case(name))
}

/// Returns the names of the topics that explain a keyword such as `Closed`.
pub fn topics_about(word: &str) -> Vec<&'static str> {
    let word = format!("`{word}`");
    TOPICS.iter().filter(|topic| topic.text.contains(&word)).map(|topic| topic.name).collect()
}
