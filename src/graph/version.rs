//! Versions of graphs, and the minimum versions that graphs require of the graphs they use.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Help, Kind, Tree, nearest_or_all};
use semver::{Version, VersionReq};

use super::check::Check;
use super::definition::Definition;

/// An entry of the section `use`.
pub(super) struct UseEntry<'t> {
    pub(super) path: &'t str,
    /// The position of `path` in the file that contains the entry.
    pub(super) span: Span,
    pub(super) version: Option<VersionRequirement<'t>>,
}

/// The minimum version of the used graph, as the file contains it.
pub(super) struct VersionRequirement<'t> {
    text: &'t str,
    span: Span,
    requirement: VersionReq,
}

/// The names of the fields of `Graph(..)` under `use`.
const FIELDS: [&str; 2] = ["path", "version"];

impl Check<'_, '_> {
    /// Reads the field `version` of a graph.
    pub(super) fn read_version(&mut self, tree: &Tree) -> Option<Version> {
        let version = tree.text().and_then(|text| text.parse().ok());
        if version.is_none() && !tree.is_broken() {
            let found = tree.describe();
            let message =
                format!("field `version` of Graph: expected three numbers, found {found}");
            // To suggest a correction, complete a version of only one or two numbers by zeros.
            let whole = tree.text().and_then(|text| {
                let zeros = [".0.0", ".0"].map(|zeros| format!("{text}{zeros}"));
                zeros.into_iter().find(|whole| whole.parse::<Version>().is_ok())
            });
            let help = match whole {
                Some(whole) => Help::edit("write \"2.1.0\"", tree.span, format!("\"{whole}\"")),
                None => "write \"2.1.0\"".into(),
            };
            self.report(code::WRONG_VALUE, tree.span, message, help);
        }
        version
    }

    /// Reads the entry `name` of the section `use`, which is `"lib/skirt.ron"` or `Graph("lib/skirt.ron", version: "2.1")`.
    pub(super) fn read_use<'t>(&mut self, name: &str, value: &'t Tree) -> Option<UseEntry<'t>> {
        const HELP: &str = "write \"lib/name.ron\" or Graph(\"lib/name.ron\", version: \"2.1\")";
        let only = value.call_of("Graph").unwrap_or(value);
        if let Some(path) = only.text() {
            return Some(UseEntry { path, span: only.span, version: None });
        }
        let is_graph = value.name().is_some_and(|name| name.text == "Graph");
        let Some(fields) = value.fields().filter(|_| is_graph) else {
            if !value.is_broken() {
                let found = value.describe();
                let message = format!("`{name}`: expected the path of a graph, found {found}");
                self.report(code::WRONG_VALUE, value.span, message, HELP);
            }
            return None;
        };
        let mut wanted: Option<UseEntry<'_>> = None;
        let mut version = None;
        for (nth, field) in fields.iter().enumerate() {
            let (word, at) = (&field.name.text[..], &field.value);
            let is_twice = fields[..nth].iter().any(|before| before.name.text == word);
            match (word, &at.kind) {
                _ if is_twice => {
                    let message = format!("field `{word}` is given twice");
                    self.report(code::BAD_NAME, field.name.span, message, "keep one of them");
                }
                ("path", Kind::Text(path)) => {
                    wanted = Some(UseEntry { path, span: at.span, version: None });
                }
                ("version", _) => version = self.read_requirement(at),
                ("path", _) => {
                    let message = format!("the path of a graph is a text, not {}", at.describe());
                    self.report(code::WRONG_VALUE, at.span, message, HELP);
                }
                _ => {
                    let message = format!("Graph has no field `{word}` here");
                    let help = nearest_or_all(word, "its fields", &FIELDS);
                    self.report(code::UNKNOWN_FIELD, field.name.span, message, help);
                }
            }
        }
        if fields.iter().all(|field| field.name.text != "path") {
            let message = format!("`{name}` wants the path of a graph");
            self.report(code::MISSING_FIELD, value.span, message, HELP);
        }
        Some(UseEntry { version, ..wanted? })
    }

    /// Reads a version requirement such as `2.1`, which accepts version 2.1 and every later compatible version.
    fn read_requirement<'t>(&mut self, tree: &'t Tree) -> Option<VersionRequirement<'t>> {
        let text = tree.text().filter(|text| text.starts_with(|c: char| c.is_ascii_digit()));
        let fitting = text.filter(|text| !text.contains([',', '*'])).and_then(|t| t.parse().ok());
        if fitting.is_none() && !tree.is_broken() {
            let message = format!("expected a version in numbers, found {}", tree.describe());
            let help = "write \"2.1\": 2.1.0 or later, but not 3.0.0";
            self.report(code::WRONG_VALUE, tree.span, message, help);
        }
        Some(VersionRequirement { text: text?, span: tree.span, requirement: fitting? })
    }

    /// Reports a used graph that does not have the required version.
    pub(super) fn check_version(
        &mut self,
        name: &str,
        file: &str,
        wanted: &VersionRequirement<'_>,
        graph: &Definition,
    ) {
        let text = wanted.text;
        let (message, help) = match &graph.version {
            Some(version) if wanted.requirement.matches(version) => return,
            Some(version) if !version.pre.is_empty() => (
                format!("`{name}` wants version {text}, but {file} is version {version}"),
                "name a pre-release version, such as 1.4.0-beta, in full",
            ),
            Some(version) => (
                format!("`{name}` wants version {text}, but {file} is version {version}"),
                "use a file of a matching version, or review the changes and require this version",
            ),
            // An invalid version is reported in the used graph's own file.
            None if has_version(graph) => return,
            None => (
                format!("`{name}` wants version {text}, but {file} says no version"),
                "add `version: \"..\"` there, or remove it here",
            ),
        };
        self.report(code::VERSION, wanted.span, message, help);
    }
}

/// Returns true if the file of a graph has a field `version`, even an invalid one.
fn has_version(graph: &Definition) -> bool {
    graph.tree.fields().unwrap_or_default().iter().any(|field| field.name.text == "version")
}
