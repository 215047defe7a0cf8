//! Versions of graphs: which one a file has, and whether it is one that a use wants.

use maquette_syntax::error::{Span, code};
use maquette_syntax::{Help, Kind, Tree, nearest_or_all};
use semver::{Version, VersionReq};

use super::check::Check;
use super::definition::Definition;

/// What a graph says of another one that it uses.
pub(super) struct Wanted<'t> {
    pub(super) path: &'t str,
    /// Where the path stands.
    pub(super) span: Span,
    pub(super) version: Option<WantedVersion<'t>>,
}

/// The least version that is wanted, as it is written.
pub(super) struct WantedVersion<'t> {
    text: &'t str,
    span: Span,
    fitting: VersionReq,
}

/// The fields of `Graph(..)` under `use`.
const FIELDS: [&str; 2] = ["path", "version"];

impl Check<'_, '_> {
    /// The version that a graph says it has.
    pub(super) fn version(&mut self, tree: &Tree) -> Option<Version> {
        let version = tree.text().and_then(|text| text.parse().ok());
        if version.is_none() && !tree.is_broken() {
            let found = tree.in_words();
            let message = format!("field `version` of Graph wants three numbers, not {found}");
            // Who says two numbers or one means the first of those versions.
            let whole = tree.text().and_then(|text| {
                let zeros = [".0.0", ".0"].map(|zeros| format!("{text}{zeros}"));
                zeros.into_iter().find(|whole| whole.parse::<Version>().is_ok())
            });
            let help = match whole {
                Some(whole) => Help::edit("write \"2.1.0\"", tree.span, format!("\"{whole}\"")),
                None => "write \"2.1.0\"".into(),
            };
            self.find(code::WRONG_VALUE, tree.span, message, help);
        }
        version
    }

    /// Reads `"lib/skirt.ron"` or `Graph("lib/skirt.ron", version: "2.1")`, which `name` is to stand for.
    pub(super) fn wanted<'t>(&mut self, name: &str, value: &'t Tree) -> Option<Wanted<'t>> {
        const WRITE: &str = "write \"lib/name.ron\" or Graph(\"lib/name.ron\", version: \"2.1\")";
        let only = value.call_of("Graph").unwrap_or(value);
        if let Some(path) = only.text() {
            return Some(Wanted { path, span: only.span, version: None });
        }
        let is_graph = value.name().is_some_and(|name| name.text == "Graph");
        let Some(fields) = value.fields().filter(|_| is_graph) else {
            if !value.is_broken() {
                let found = value.in_words();
                let message = format!("`{name}` wants the path of a graph, not {found}");
                self.find(code::WRONG_VALUE, value.span, message, WRITE);
            }
            return None;
        };
        let mut wanted: Option<Wanted<'_>> = None;
        let mut version = None;
        for (nth, field) in fields.iter().enumerate() {
            let (word, at) = (&field.name.text[..], &field.value);
            let is_twice = fields[..nth].iter().any(|before| before.name.text == word);
            match (word, &at.kind) {
                _ if is_twice => {
                    let message = format!("field `{word}` is given twice");
                    self.find(code::BAD_NAME, field.name.span, message, "keep one of them");
                }
                ("path", Kind::Text(path)) => {
                    wanted = Some(Wanted { path, span: at.span, version: None });
                }
                ("version", _) => version = self.fitting(at),
                ("path", _) => {
                    let message = format!("the path of a graph is a text, not {}", at.in_words());
                    self.find(code::WRONG_VALUE, at.span, message, WRITE);
                }
                _ => {
                    let message = format!("Graph has no field `{word}` here");
                    let help = nearest_or_all(word, "its fields", &FIELDS);
                    self.find(code::UNKNOWN_FIELD, field.name.span, message, help);
                }
            }
        }
        if fields.iter().all(|field| field.name.text != "path") {
            let message = format!("`{name}` wants the path of a graph");
            self.find(code::MISSING_FIELD, value.span, message, WRITE);
        }
        Some(Wanted { version, ..wanted? })
    }

    /// `2.1`: this version or a later one that can do the same.
    fn fitting<'t>(&mut self, tree: &'t Tree) -> Option<WantedVersion<'t>> {
        let text = tree.text().filter(|text| text.starts_with(|c: char| c.is_ascii_digit()));
        let fitting = text.filter(|text| !text.contains([',', '*'])).and_then(|t| t.parse().ok());
        if fitting.is_none() && !tree.is_broken() {
            let message = format!("the version that is wanted is numbers, not {}", tree.in_words());
            let help = "write \"2.1\": 2.1.0 or later, but not 3.0.0";
            self.find(code::WRONG_VALUE, tree.span, message, help);
        }
        Some(WantedVersion { text: text?, span: tree.span, fitting: fitting? })
    }

    /// Says so if a graph is of no version that is wanted of it.
    pub(super) fn must_fit(
        &mut self,
        name: &str,
        file: &str,
        wanted: &WantedVersion<'_>,
        graph: &Definition,
    ) {
        let text = wanted.text;
        let (message, help) = match &graph.version {
            Some(version) if wanted.fitting.matches(version) => return,
            Some(version) if !version.pre.is_empty() => (
                format!("`{name}` wants version {text}, but {file} is version {version}"),
                "what stands before a version, as 1.4.0-beta before 1.4.0, is only taken by its whole name",
            ),
            Some(version) => (
                format!("`{name}` wants version {text}, but {file} is version {version}"),
                "take the file of a version that fits, or look at what changed and want this one",
            ),
            // What is wrong with it is told there.
            None if says_version(graph) => return,
            None => (
                format!("`{name}` wants version {text}, but {file} says no version"),
                "write `version: \"..\"` there, or leave it out here",
            ),
        };
        self.find(code::VERSION, wanted.span, message, help);
    }
}

/// Whether a graph's file has a version, right or wrong.
fn says_version(graph: &Definition) -> bool {
    graph.tree.fields().unwrap_or_default().iter().any(|field| field.name.text == "version")
}
