//! What went wrong ([`Error`]), and where and what to do ([`Problem`]).

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use serde_json::json;

/// What went wrong in a node or a file format; the engine says where.
///
/// Made by `?` from any error type. Messages are lower case, without a full stop, and do not name the node.
#[derive(Clone)]
pub struct Error {
    cause: Arc<dyn std::error::Error + Send + Sync>,
    /// The file that it is about.
    file: Option<Arc<str>>,
}

impl Error {
    /// The error as the type that it was made of, if it is an `E`.
    pub fn downcast<E: std::error::Error + 'static>(&self) -> Option<&E> {
        self.cause.downcast_ref()
    }

    /// The same error, whose message begins with the name of the file that it is about.
    pub fn in_file(self, name: &str) -> Self {
        Self { file: Some(name.into()), ..self }
    }
}

impl<E: std::error::Error + Send + Sync + 'static> From<E> for Error {
    fn from(error: E) -> Self {
        Self { cause: Arc::new(error), file: None }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{file}: ")?;
        }
        write!(f, "{}", self.cause)?;
        let mut source = self.cause.source();
        while let Some(cause) = source {
            write!(f, ": {cause}")?;
            source = cause.source();
        }
        Ok(())
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.cause.fmt(f)
    }
}

/// The evaluation was told to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// Whether a problem keeps a graph from running.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// It does.
    Error,
    /// It does not, but the result may not be what was meant.
    Warning,
}

impl Severity {
    /// The word in messages: `error` or `warning`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}

/// A part of a text, by bytes; the end is exclusive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Span {
    /// First byte.
    pub start: usize,
    /// The byte behind the last one.
    pub end: usize,
}

/// A place in a text as people count: from 1, columns in Unicode scalars.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Line.
    pub line: usize,
    /// Column.
    pub column: usize,
}

impl Place {
    /// The place of a byte offset; past the end it is the place behind the last character.
    pub fn of(text: &str, offset: usize) -> Self {
        let mut offset = offset.min(text.len());
        while !text.is_char_boundary(offset) {
            offset -= 1;
        }
        let before = &text[..offset];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        Self {
            line: before.bytes().filter(|&byte| byte == b'\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
        }
    }
}

/// Finds places in a text without counting its lines anew for each.
#[derive(Default)]
pub struct Lines {
    source: Option<Arc<Source>>,
    /// Where each line begins.
    starts: Vec<usize>,
}

impl Lines {
    pub fn place(&mut self, source: &Arc<Source>, at: usize) -> Place {
        if self.source.as_ref().is_none_or(|known| !Arc::ptr_eq(known, source)) {
            let ends = source.text.match_indices('\n').map(|(end, _)| end + 1);
            self.starts = std::iter::once(0).chain(ends).collect();
            self.source = Some(source.clone());
        }
        let line = self.starts.partition_point(|start| *start <= at);
        let start = self.starts[line - 1];
        // Within a line, which is short.
        let Place { column, .. } = Place::of(&source.text[start..], at - start);
        Place { line, column }
    }
}

/// What a panic said.
pub fn in_words(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".into())
}

/// The most problems that are reported at a time: nobody reads more. Explanations of further ones are not computed.
pub const MOST_TOLD: usize = 100;

/// A graph file's name and text, for messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// The name as it was given.
    pub name: PathBuf,
    /// Its text.
    pub text: String,
}

/// One use of a graph in another one, on the way to a problem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Use {
    /// The name of the node that uses it; the name of the type, if no node does.
    pub name: String,
    /// The file that uses it.
    pub source: Arc<Source>,
    /// Where in the file.
    pub span: Span,
}

impl Use {
    /// `graphs/face.ron:9:9`.
    pub fn place(&self) -> String {
        let Place { line, column } = Place::of(&self.source.text, self.span.start);
        format!("{}:{line}:{column}", self.source.name.display())
    }

    fn to_json(&self) -> serde_json::Value {
        let Place { line, column } = Place::of(&self.source.text, self.span.start);
        json!({
            "name": self.name,
            "file": self.source.name.display().to_string(),
            "line": line,
            "column": column,
        })
    }
}

/// Something wrong at a place of a graph file: where, what, and what to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Whether it keeps the graph from running.
    pub severity: Severity,
    /// `G001` and so on; see [`code`].
    pub code: &'static str,
    /// The file.
    pub source: Arc<Source>,
    /// Where in the file.
    pub span: Span,
    /// What is wrong.
    pub message: String,
    /// What to do; may be empty.
    pub help: String,
    /// The edits of the file that make it go away, if there is one answer: what stands at each span becomes the text.
    pub fix: Vec<(Span, String)>,
    /// Another place that explains it, with a few words.
    pub note: Option<(Span, String)>,
    /// For a problem inside of a subgraph: the uses that lead there, from the outermost on.
    pub uses: Vec<Use>,
    /// The elements of a value that are to blame, such as edges with one face, with a place of each in mm.
    pub elements: Vec<(String, [f64; 3])>,
}

/// Returns the problems of a check and of a run that followed it. What the check warns of and the run reports as an error is there once.
pub fn with_those_of_run(mut checked: Vec<Problem>, run: Vec<Problem>) -> Vec<Problem> {
    fn again(problem: &Problem, run: &[Problem]) -> bool {
        run.iter().any(|other| Problem { severity: problem.severity, ..other.clone() } == *problem)
    }
    checked.retain(|problem| !again(problem, &run));
    checked.extend(run);
    checked
}

/// The codes of problems. They keep their meaning.
pub mod code {
    /// The text is not RON.
    pub const SYNTAX: &str = "G001";
    /// The format version is unknown.
    pub const FORMAT: &str = "G002";
    /// A node type that no pack has.
    pub const UNKNOWN_NODE: &str = "G003";
    /// A field that a node, or the graph, does not have.
    pub const UNKNOWN_FIELD: &str = "G004";
    /// A field or a port that must be given.
    pub const MISSING_FIELD: &str = "G005";
    /// A name that is used twice, or is no name.
    pub const BAD_NAME: &str = "G006";
    /// A link to nothing.
    pub const UNKNOWN_LINK: &str = "G007";
    /// Nodes that hang on each other.
    pub const CYCLE: &str = "G008";
    /// A value of the wrong kind.
    pub const WRONG_VALUE: &str = "G009";
    /// A value out of its range.
    pub const OUT_OF_RANGE: &str = "G010";
    /// A parameter or an expression that cannot be computed.
    pub const EXPRESSION: &str = "G011";
    /// A link of the wrong type.
    pub const WRONG_TYPE: &str = "G012";
    /// A file that is not there.
    pub const MISSING_FILE: &str = "G013";
    /// A path that leaves the project.
    pub const OUTSIDE: &str = "G014";
    /// An output that no file format can hold.
    pub const OUTPUT_FORMAT: &str = "G015";
    /// A node failed.
    pub const FAILED: &str = "G016";
    /// A warning of a node about its result.
    pub const WARNING: &str = "G017";
    /// A panic: our bug.
    pub const PANIC: &str = "G018";
    /// A node gave another result for the same inputs.
    pub const NOT_PURE: &str = "G019";
    /// Something that the graph or a test expects does not hold.
    pub const EXPECTED: &str = "G020";
    /// A node that nothing needs.
    pub const UNUSED: &str = "G021";
    /// A used graph of another version than the one that is wanted.
    pub const VERSION: &str = "G030";
    /// A used graph that is not what the lock file says.
    pub const LOCK: &str = "G031";
    /// A node or a field under its old name.
    pub const OUTDATED: &str = "G032";
    /// A pinned result that was computed from something else, or of a node that is gone.
    pub const PIN: &str = "G033";
}

impl Problem {
    /// What is wrong at a place, and no more.
    pub fn new(
        severity: Severity,
        code: &'static str,
        (source, span): (Arc<Source>, Span),
        message: impl Into<String>,
    ) -> Self {
        Self {
            severity,
            code,
            source,
            span,
            message: message.into(),
            help: String::new(),
            fix: Vec::new(),
            note: None,
            uses: Vec::new(),
            elements: Vec::new(),
        }
    }

    /// The text of its file after the edits that make it go away, if there is one answer.
    pub fn fixed(&self) -> Option<String> {
        let mut edits = self.fix.clone();
        edits.sort_by_key(|(span, _)| (span.start, span.end));
        let mut text = self.source.text.clone();
        for (span, new) in edits.iter().rev() {
            let is_there = text.is_char_boundary(span.start) && text.is_char_boundary(span.end);
            if !is_there || span.end < span.start {
                return None;
            }
            text.replace_range(span.start..span.end, new);
        }
        (!edits.is_empty()).then_some(text)
    }

    /// The problem as `--json` prints it. Its `note`, if it has one, is a place of its own with a message, as the related information
    /// of an editor's diagnostics is, its `fix` the edits that make it go away. Elements that are to blame have `elements`, each with a
    /// `name` and a place, `at`.
    pub fn to_json(&self) -> serde_json::Value {
        let file = self.source.name.display().to_string();
        fn place(
            span: Span,
            mut json: serde_json::Value,
            source: &Arc<Source>,
        ) -> serde_json::Value {
            let [start, end] = [span.start, span.end].map(|at| Place::of(&source.text, at));
            let numbers = [start.line, start.column, end.line, end.column];
            for (name, number) in ["line", "column", "end_line", "end_column"].iter().zip(numbers) {
                json[name] = number.into();
            }
            json
        }
        let (severity, code) = (self.severity.word(), self.code);
        let (message, help) = (&self.message, &self.help);
        let json = json!({ "severity": severity, "code": code, "file": file, "message": message, "help": help });
        let mut json = place(self.span, json, &self.source);
        if let Some((span, words)) = &self.note {
            json["note"] = place(*span, json!({ "file": file, "message": words }), &self.source);
        }
        if !self.fix.is_empty() {
            json["fix"] = self
                .fix
                .iter()
                .map(|(span, text)| place(*span, json!({ "text": text }), &self.source))
                .collect();
        }
        if !self.uses.is_empty() {
            json["uses"] = self.uses.iter().map(Use::to_json).collect();
        }
        if !self.elements.is_empty() {
            json["elements"] =
                self.elements.iter().map(|(name, at)| json!({ "name": name, "at": at })).collect();
        }
        json
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_characters_not_bytes() {
        let text = "ab\näöx";
        assert_eq!(Place::of(text, 0), Place { line: 1, column: 1 });
        assert_eq!(Place::of(text, 7), Place { line: 2, column: 3 });
        assert_eq!(Place::of(text, 99), Place { line: 2, column: 4 });
    }
    #[test]
    fn places_are_those_that_problems_have() {
        let texts = ["", "\n", "a\n\nb\u{e4}c\n", "\u{e4}\nb"]
            .map(|text| Arc::new(Source { name: "a.ron".into(), text: text.into() }));
        let mut lines = Lines::default();
        for source in &texts {
            let bytes = 0..=source.text.len();
            for at in bytes.filter(|at| source.text.is_char_boundary(*at)) {
                assert_eq!(lines.place(source, at), Place::of(&source.text, at), "{source:?} {at}");
            }
        }
    }
}
