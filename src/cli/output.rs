//! Printing, exit codes and the name of the program.

use std::ffi::OsString;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

use maquette_engine::session::{Run, RunResult, Session, Targets};
use maquette_graph::Graph;
use maquette_syntax::diagnostics::{escape_json, render, sanitize, sanitize_line};
use maquette_syntax::error::{Diagnostic, MAX_REPORTED, Severity, code};

/// The result of a command, which determines the exit code.
pub(crate) enum Exit {
    Done,
    /// The graph or one of its files has errors, which have already been printed.
    Failed,
    /// The user interrupted the command.
    Interrupted,
    /// The command line is wrong. Contains the error message.
    Usage(String),
}

/// Returns the name of this program, usually `maquette`. A program that is built with other packs may have another name.
pub(crate) fn program() -> String {
    NAME.get_or_init(|| name_in(std::env::args_os().next().as_ref())).clone()
}

pub(crate) static NAME: OnceLock<String> = OnceLock::new();

pub(crate) fn name_in(word: Option<&OsString>) -> String {
    let name = word.and_then(|word| Path::new(word).file_stem());
    name.map_or_else(|| "maquette".into(), |name| name.to_string_lossy().into_owned())
}

/// Formats a path for messages.
pub(crate) trait DisplayPath {
    /// Returns the path as one line without control characters.
    fn for_display(&self) -> String;
}

impl DisplayPath for Path {
    fn for_display(&self) -> String {
        sanitize_line(&self.to_string_lossy()).into_owned()
    }
}

/// The first error of writing to stdout. After an error nothing more is written to it.
static STDOUT_ERROR: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes a text to stdout. Control characters, which file names may contain, are replaced by visible symbols.
pub(crate) fn print(text: &str) {
    print_as_it_is(&sanitize(text));
}

/// Writes a document to stdout. A file or pipe receives the exact bytes. On a terminal, control characters are replaced by visible symbols.
pub(crate) fn print_document(text: &str) {
    if io::stdout().is_terminal() { print(text) } else { print_as_it_is(text) }
}

/// Writes a text to stdout unchanged. All commands print through this function. It stores the first error ([`stdout_error`]), which makes
/// the program fail at the end.
pub(crate) fn print_as_it_is(text: &str) {
    let mut stdout = io::stdout().lock();
    let mut failed = first_stdout_error();
    #[cfg(target_os = "linux")]
    if failed.is_none() && crate::closed_stdout::was_closed() && !text.is_empty() {
        *failed = Some(io::Error::from_raw_os_error(libc::EBADF));
    }
    if failed.is_none() {
        // Flush at once, because an error of a later flush would go unnoticed.
        *failed = stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()).err();
    }
}

fn first_stdout_error() -> std::sync::MutexGuard<'static, Option<io::Error>> {
    STDOUT_ERROR.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns true if writing to stdout has failed, so that nothing more can be written.
pub(crate) fn stdout_is_closed() -> bool {
    first_stdout_error().is_some()
}

/// Takes the first error of writing to stdout. A pipe that its reader has closed, as `head` does, is not an error.
pub(crate) fn stdout_error() -> Option<io::Error> {
    first_stdout_error().take().filter(|error| error.kind() != ErrorKind::BrokenPipe)
}

/// Prints a message of clap: help and version to stdout, errors to stderr. Returns the exit code.
pub(crate) fn print_usage(message: &clap::Error) -> u8 {
    if message.use_stderr() {
        // Ignore an error: if stderr is closed, nothing can be reported.
        let _ = message.print();
    } else {
        let text = message.render();
        let color = shows_color(&io::stdout());
        print_as_it_is(&if color { text.ansi().to_string() } else { text.to_string() });
    }
    message.exit_code() as u8
}

/// Writes a text to stderr. Control characters are replaced by visible symbols.
pub(crate) fn eprint(text: &str) {
    eprint_as_it_is(&sanitize(text));
}

pub(crate) fn eprint_as_it_is(text: &str) {
    let _ = io::stderr().lock().write_all(text.as_bytes());
}

pub(crate) fn print_json(document: &serde_json::Value) {
    print_as_it_is(&escape_json(&format!("{document:#}\n")));
}

/// Returns true if colors may be written to a stream: it is a terminal, and the variable NO_COLOR is not set (no-color.org).
pub(crate) fn shows_color(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// Selects the diagnostics to report. If there are too many, prefers errors to warnings. Keeps their order. Also returns the number of
/// diagnostics left out.
pub(crate) fn split_for_report(diagnostics: &[Diagnostic]) -> (Vec<&Diagnostic>, usize) {
    let mut reported: Vec<_> = diagnostics.iter().enumerate().collect();
    reported.sort_by_key(|(_, diagnostic)| diagnostic.severity);
    reported.truncate(MAX_REPORTED);
    reported.sort_by_key(|(index, _)| *index);
    let reported: Vec<_> = reported.into_iter().map(|(_, diagnostic)| diagnostic).collect();
    let rest = diagnostics.len() - reported.len();
    (reported, rest)
}

/// Returns true if one of the diagnostics is an error.
pub(crate) fn has_errors(diagnostics: &[Diagnostic]) -> bool {
    count_severity(diagnostics, Severity::Error) > 0
}

/// Returns the number of diagnostics with this severity.
pub(crate) fn count_severity(diagnostics: &[Diagnostic], severity: Severity) -> usize {
    diagnostics.iter().filter(|it| it.severity == severity).count()
}

/// Prints diagnostics to stderr, in the form for people.
pub(crate) fn report(diagnostics: &[Diagnostic]) {
    let color = shows_color(&io::stderr());
    let (reported, rest) = split_for_report(diagnostics);
    for diagnostic in reported {
        eprint_as_it_is(&format!("{}\n\n", render(diagnostic, color, None)));
    }
    if rest > 0 {
        eprint(&format!("and {}\n\n", format_count(rest, "more diagnostic")));
    }
}

/// Evaluates all outputs of a graph without checking its expectations, and reports diagnostics. Returns `None` if the graph could not run.
pub(crate) fn all_outputs(session: &mut Session, graph: &Graph) -> Option<RunResult> {
    let targets = Targets::Named(graph.output_names().map(str::to_owned).collect());
    match session.run(graph, &Run { targets, ..Run::default() }) {
        Ok(finished) => {
            // Leave out errors about nodes of unknown types, which the check has already reported. Outputs that do not need them can be
            // evaluated.
            let mut diagnostics = finished.diagnostics();
            diagnostics.retain(|it| it.code != code::UNKNOWN_NODE);
            report(&diagnostics);
            Some(finished)
        }
        Err(diagnostics) => {
            report(&diagnostics);
            None
        }
    }
}

/// Adds diagnostics to a JSON document: `problems` contains those that are reported, and `more_problems` is the number of those left out.
pub(crate) fn put_problems(document: &mut serde_json::Value, diagnostics: &[Diagnostic]) {
    let (reported, rest) = split_for_report(diagnostics);
    document["problems"] = reported.into_iter().map(Diagnostic::to_json).collect();
    if rest > 0 {
        document["more_problems"] = rest.into();
    }
}

/// Returns the width of a table column for names of these lengths: the largest length, but at most 200. Longer names extend beyond the
/// column.
pub(crate) fn column_width(lengths: impl Iterator<Item = usize>) -> usize {
    lengths.max().unwrap_or(0).min(200)
}

/// Formats a number of bytes, such as `4.1 MB`.
pub(crate) fn in_bytes(bytes: usize) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}

/// Formats a number with a noun, such as `3 errors`, `1 error` or `9 900 files`.
pub(crate) fn format_count(count: usize, what: &str) -> String {
    let digits = count.to_string();
    let mut number = String::with_capacity(digits.len() + digits.len() / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            number.push(' ');
        }
        number.push(digit);
    }
    format!("{number} {what}{}", if count == 1 { "" } else { "s" })
}
