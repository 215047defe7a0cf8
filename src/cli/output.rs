//! What commands print, how they end, and what the program is called.

use std::ffi::OsString;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use maquette_engine::session::{Finished, Run, Session, Wanted};
use maquette_graph::Graph;
use maquette_syntax::error::{MOST_TOLD, Problem, code};
use maquette_syntax::telling::{escaped, harmless, in_full, on_one_line};

/// How a command ends.
pub(crate) enum Exit {
    Done,
    /// The graph, or something that it names, failed; the reasons have been printed.
    Failed,
    /// The user stopped it.
    Interrupted,
    /// The command line is wrong: why.
    Usage(String),
}

/// The name of this program: one with a stranger's packs has its own.
pub(crate) fn program() -> String {
    NAME.get_or_init(|| name_in(std::env::args_os().next().as_ref())).clone()
}

pub(crate) static NAME: OnceLock<String> = OnceLock::new();

pub(crate) fn name_in(word: Option<&OsString>) -> String {
    let name = word.and_then(|word| Path::new(word).file_stem());
    name.map_or_else(|| "maquette".into(), |name| name.to_string_lossy().into_owned())
}

/// What people read of a path.
pub(crate) trait Shown {
    /// The path on one line, without characters that a terminal would act on.
    fn shown(&self) -> String;
}

impl Shown for Path {
    fn shown(&self) -> String {
        on_one_line(&self.to_string_lossy()).into_owned()
    }
}

/// Whether writing to stdout has failed.
pub(crate) static STDOUT_CLOSED: AtomicBool = AtomicBool::new(false);

/// Writes words to stdout, in which names that others gave may stand.
pub(crate) fn print(text: &str) {
    print_as_it_is(&harmless(text));
}

/// Writes a document to stdout: a program that reads it gets every byte, a terminal what it shows.
pub(crate) fn print_document(text: &str) {
    if std::io::stdout().is_terminal() { print(text) } else { print_as_it_is(text) }
}

/// Writes to stdout; a reader that has gone away is no error.
pub(crate) fn print_as_it_is(text: &str) {
    if std::io::stdout().lock().write_all(text.as_bytes()).is_err() {
        STDOUT_CLOSED.store(true, Ordering::Relaxed);
    }
}

/// Whether the reader of stdout has gone away.
pub(crate) fn stdout_is_closed() -> bool {
    STDOUT_CLOSED.load(Ordering::Relaxed)
}

/// Writes words to stderr.
pub(crate) fn eprint(text: &str) {
    eprint_as_it_is(&harmless(text));
}

pub(crate) fn eprint_as_it_is(text: &str) {
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

pub(crate) fn print_json(document: &serde_json::Value) {
    print_as_it_is(&escaped(&format!("{document:#}\n")));
}

/// Whether a stream shows colors: a terminal, unless NO_COLOR is set (no-color.org).
pub(crate) fn shows_color(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// The problems that are told, in their order, and how many are not: where there are too many, errors go before warnings.
pub(crate) fn told(problems: &[Problem]) -> (Vec<&Problem>, usize) {
    let mut told = Vec::from_iter(problems.iter().enumerate());
    told.sort_by_key(|(_, problem)| problem.severity);
    told.truncate(MOST_TOLD);
    told.sort_by_key(|(index, _)| *index);
    let told = Vec::from_iter(told.into_iter().map(|(_, problem)| problem));
    let rest = problems.len() - told.len();
    (told, rest)
}

/// Prints problems to stderr as people read them.
pub(crate) fn report(problems: &[Problem]) {
    let color = shows_color(&std::io::stderr());
    let (told, rest) = told(problems);
    for problem in told {
        eprint_as_it_is(&format!("{}\n\n", in_full(problem, color, None)));
    }
    if rest > 0 {
        eprint(&format!("and {} more\n\n", counted(rest, "problem")));
    }
}

/// Evaluates all outputs of a graph, whatever it expects of them, and reports what is wrong; none if nothing could be run.
pub(crate) fn all_outputs(session: &mut Session, graph: &Graph) -> Option<Finished> {
    let wanted = Wanted::Named(graph.output_names().map(str::to_owned).collect());
    match session.run(graph, &Run { wanted, ..Run::default() }) {
        Ok(finished) => {
            // The check has told of nodes of unknown types, and other outputs may be there.
            let unknown = |problem: &Problem| problem.code == code::UNKNOWN_NODE;
            let problems = finished.problems();
            report(&Vec::from_iter(problems.into_iter().filter(|it| !unknown(it))));
            Some(finished)
        }
        Err(problems) => {
            report(&problems);
            None
        }
    }
}

/// Problems as `--json` has them: the `problems` that are told and, if there are more, how many, as fields of a document.
pub(crate) fn put_problems(document: &mut serde_json::Value, problems: &[Problem]) {
    let (told, rest) = told(problems);
    document["problems"] = told.into_iter().map(Problem::to_json).collect();
    if rest > 0 {
        document["more_problems"] = rest.into();
    }
}

/// How wide a column of names is, of these lengths. Very long ones stand out of it.
pub(crate) fn column_width(lengths: impl Iterator<Item = usize>) -> usize {
    lengths.max().unwrap_or(0).min(200)
}

/// `4.1 MB`.
pub(crate) fn in_bytes(bytes: usize) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}

/// `3 errors`, `1 error`, `9 900 problems`.
pub(crate) fn counted(count: usize, what: &str) -> String {
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
