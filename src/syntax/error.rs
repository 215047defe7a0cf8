//! Errors ([`Error`]), and errors and warnings with a position in a graph file ([`Diagnostic`]).

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use serde_json::json;

/// An error of a node or a file format. It has no position; the engine adds one.
///
/// The operator `?` converts any error type to `Error`, and [`bail!`](crate::bail) returns an `Error` with a message. Messages are lower
/// case, without a full stop, and do not name the node. Define an error type of your own only if some code matches on its variants.
#[derive(Clone)]
pub struct Error {
    cause: Arc<dyn std::error::Error + Send + Sync>,
    /// The name of the file that caused the error. `None` if the error is not about a file.
    file: Option<Arc<str>>,
}

impl Error {
    /// Creates an error that consists of a message.
    pub fn new(message: impl Into<String>) -> Self {
        MessageError(message.into()).into()
    }

    /// Returns the original error if its type is `E`. Otherwise `None`.
    pub fn downcast<E: std::error::Error + 'static>(&self) -> Option<&E> {
        self.cause.downcast_ref()
    }

    /// Adds the name of the file that caused the error. The message then begins with that name.
    pub fn with_file(self, name: &str) -> Self {
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

/// Lets a program that embeds the engine use `?` where it returns `Box<dyn std::error::Error>`.
impl From<Error> for Box<dyn std::error::Error> {
    fn from(error: Error) -> Self {
        MessageError(error.to_string()).into()
    }
}

/// An error that has only a message.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct MessageError(String);

/// Returns an [`Error`] with a message from the enclosing function. The arguments are those of `format!`.
#[macro_export]
macro_rules! bail {
    ($($message:tt)+) => {
        return Err($crate::error::Error::new(format!($($message)+)))
    };
}

/// Error returned when an evaluation was cancelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct CancelledError;

/// The severity of a diagnostic: error or warning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// A diagnostic that prevents the graph from running.
    Error,
    /// A diagnostic about a graph that can run, but whose result may not be the intended one.
    Warning,
}

impl Severity {
    /// Returns the word for messages: `error` or `warning`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}

/// A range of bytes in a text. The end is exclusive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Span {
    pub start: usize,
    pub end: usize,
}

/// A line and a column in a text, both counted from 1. Columns count Unicode scalar values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    pub line: usize,
    pub column: usize,
}

impl Position {
    /// Converts a byte offset to a position. An offset beyond the end gives the position after the last character.
    pub fn from_offset(text: &str, offset: usize) -> Self {
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

/// Converts byte offsets to positions. The line starts of a text are computed once, at the first conversion.
#[derive(Default)]
pub struct LineIndex {
    source: Option<Arc<Source>>,
    /// The byte offset of the start of each line.
    starts: Vec<usize>,
}

impl LineIndex {
    pub fn position(&mut self, source: &Arc<Source>, at: usize) -> Position {
        if self.source.as_ref().is_none_or(|known| !Arc::ptr_eq(known, source)) {
            let ends = source.text.match_indices('\n').map(|(end, _)| end + 1);
            self.starts = std::iter::once(0).chain(ends).collect();
            self.source = Some(source.clone());
        }
        let line = self.starts.partition_point(|start| *start <= at);
        let start = self.starts[line - 1];
        // Only the characters of one line must be counted.
        let Position { column, .. } = Position::from_offset(&source.text[start..], at - start);
        Position { line, column }
    }
}

/// Returns the message of a panic from its payload.
pub fn panic_message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".into())
}

/// Maximum number of diagnostics that are reported at a time. No suggestions are computed for further ones.
pub const MAX_REPORTED: usize = 100;

/// The path and text of a graph file, for messages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// The path of the file, as the user wrote it.
    pub name: PathBuf,
    pub text: String,
}

/// A node that uses another graph. A diagnostic in a used graph lists the nodes that lead to that graph.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Use {
    /// The name of the node. If no node uses the graph, the name of the node type that the section `use` declares.
    pub name: String,
    /// The file that contains the node; `span` is a position in that file.
    pub source: Arc<Source>,
    pub span: Span,
}

impl Use {
    /// Formats the file and position: `graphs/face.ron:9:9`.
    pub fn location(&self) -> String {
        let Position { line, column } = Position::from_offset(&self.source.text, self.span.start);
        format!("{}:{line}:{column}", self.source.name.display())
    }

    fn to_json(&self) -> serde_json::Value {
        let Position { line, column } = Position::from_offset(&self.source.text, self.span.start);
        json!({
            "name": self.name,
            "file": self.source.name.display().to_string(),
            "line": line,
            "column": column,
        })
    }
}

/// An error or warning at a position of a graph file, with a help text.
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnostic {
    pub severity: Severity,
    /// The code of the diagnostic, such as `G001`; see [`code`].
    pub code: &'static str,
    /// The file to which `span`, `fix` and `note` refer.
    pub source: Arc<Source>,
    pub span: Span,
    pub message: String,
    /// A proposed remedy. May be empty.
    pub help: String,
    /// The edits of the file that fix the error, if there is exactly one way to fix it. Each edit replaces a span by a text. Otherwise
    /// empty.
    pub fix: Vec<(Span, String)>,
    /// A second span in the same file that helps to explain the diagnostic, and a label for the span.
    pub note: Option<(Span, String)>,
    /// For a diagnostic in a used graph: the path from the root graph to that graph, outermost use first.
    pub uses: Vec<Use>,
    /// Elements of a value that cause the error, such as edges with one face. Each has a description and a point in mm.
    pub elements: Vec<(String, [f64; 3])>,
}

/// Merges the diagnostics of a check with those of the evaluation that followed. If both report the same error with different severities,
/// only that of the evaluation is kept.
pub fn merge_diagnostics(mut checked: Vec<Diagnostic>, run: Vec<Diagnostic>) -> Vec<Diagnostic> {
    fn is_repeated(diagnostic: &Diagnostic, run: &[Diagnostic]) -> bool {
        run.iter().any(|other| {
            Diagnostic { severity: diagnostic.severity, ..other.clone() } == *diagnostic
        })
    }
    checked.retain(|diagnostic| !is_repeated(diagnostic, &run));
    checked.extend(run);
    checked
}

/// The codes of diagnostics. Each code must keep its meaning forever.
pub mod code {
    /// The text of a file is not RON.
    pub const SYNTAX: &str = "G001";
    /// The program does not know the format version of the file.
    pub const FORMAT: &str = "G002";
    /// The node type is not in any pack.
    pub const UNKNOWN_NODE: &str = "G003";
    /// The node, or the graph, does not have this field.
    pub const UNKNOWN_FIELD: &str = "G004";
    /// A required field or port is missing.
    pub const MISSING_FIELD: &str = "G005";
    /// A name is used twice, or is not a valid name.
    pub const BAD_NAME: &str = "G006";
    /// The target of a link does not exist in the graph.
    pub const UNKNOWN_LINK: &str = "G007";
    /// Nodes depend on each other in a cycle.
    pub const CYCLE: &str = "G008";
    /// A field has a value of the wrong kind, such as a text instead of a number.
    pub const WRONG_VALUE: &str = "G009";
    /// A number is out of the range that its field allows.
    pub const OUT_OF_RANGE: &str = "G010";
    /// A parameter or an expression cannot be computed.
    pub const EXPRESSION: &str = "G011";
    /// A link leads to a value of a wrong type.
    pub const WRONG_TYPE: &str = "G012";
    /// A file that a node reads, or that a graph uses, does not exist.
    pub const MISSING_FILE: &str = "G013";
    /// The path of a file leads outside of the project.
    pub const OUTSIDE: &str = "G014";
    /// No file format can hold the value of an output.
    pub const OUTPUT_FORMAT: &str = "G015";
    /// A node returned an error when it was evaluated.
    pub const FAILED: &str = "G016";
    /// A node returned a warning about its result.
    pub const WARNING: &str = "G017";
    /// A node panicked, which is a bug of the program.
    pub const PANIC: &str = "G018";
    /// A node returned different results for the same inputs.
    pub const NOT_PURE: &str = "G019";
    /// An expectation of the graph or of a test is not met.
    pub const EXPECTED: &str = "G020";
    /// No output or expectation depends on the node.
    pub const UNUSED: &str = "G021";
    /// A used graph has a different version than required.
    pub const VERSION: &str = "G030";
    /// A used graph differs from the lock file.
    pub const LOCK: &str = "G031";
    /// A node or a field is written with an old name.
    pub const OUTDATED: &str = "G032";
    /// A pinned result was computed from different inputs, or its node no longer exists.
    pub const PIN: &str = "G033";
}

impl Diagnostic {
    /// Creates a diagnostic without help, fix, note, uses or elements.
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

    /// Returns the text of the file with the fix applied. `None` if there is no fix, or if a span of the fix is outside of the text.
    pub fn apply_fix(&self) -> Option<String> {
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

    /// Returns the diagnostic as `--json` prints it. The field `note` is a position with a message, like the related information of LSP
    /// diagnostics. The field `fix` holds the edits. The field `elements` holds the elements that cause the error, each with a `name` and a
    /// point `at`.
    pub fn to_json(&self) -> serde_json::Value {
        let file = self.source.name.display().to_string();
        let (severity, code) = (self.severity.word(), self.code);
        let (message, help) = (&self.message, &self.help);
        let json = json!({ "severity": severity, "code": code, "file": file, "message": message, "help": help });
        let mut json = self.with_position(self.span, json);
        if let Some((span, words)) = &self.note {
            json["note"] = self.with_position(*span, json!({ "file": file, "message": words }));
        }
        if !self.fix.is_empty() {
            json["fix"] = self
                .fix
                .iter()
                .map(|(span, text)| self.with_position(*span, json!({ "text": text })))
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

    /// Adds the lines and columns of a span to a JSON object.
    fn with_position(&self, span: Span, mut json: serde_json::Value) -> serde_json::Value {
        let [start, end] =
            [span.start, span.end].map(|at| Position::from_offset(&self.source.text, at));
        let numbers = [start.line, start.column, end.line, end.column];
        for (name, number) in ["line", "column", "end_line", "end_column"].iter().zip(numbers) {
            json[name] = number.into();
        }
        json
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_characters_not_bytes() {
        let text = "ab\näöx";
        assert_eq!(Position::from_offset(text, 0), Position { line: 1, column: 1 });
        assert_eq!(Position::from_offset(text, 7), Position { line: 2, column: 3 });
        assert_eq!(Position::from_offset(text, 99), Position { line: 2, column: 4 });
    }
    #[test]
    fn line_index_agrees_with_from_offset() {
        let texts = ["", "\n", "a\n\nb\u{e4}c\n", "\u{e4}\nb"]
            .map(|text| Arc::new(Source { name: "a.ron".into(), text: text.into() }));
        let mut lines = LineIndex::default();
        for source in &texts {
            let bytes = 0..=source.text.len();
            for at in bytes.filter(|at| source.text.is_char_boundary(*at)) {
                assert_eq!(
                    lines.position(source, at),
                    Position::from_offset(&source.text, at),
                    "{source:?} {at}"
                );
            }
        }
    }
}
