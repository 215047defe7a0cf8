//! What commands print, how they end, and what the program is called.

use std::ffi::OsString;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

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

/// The first error of a write to stdout. Nothing is written after it.
static STDOUT_ERROR: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes words to stdout, in which names that others gave may stand.
pub(crate) fn print(text: &str) {
    print_as_it_is(&harmless(text));
}

/// Writes a document to stdout: a program that reads it gets every byte, a terminal what it shows.
pub(crate) fn print_document(text: &str) {
    if io::stdout().is_terminal() { print(text) } else { print_as_it_is(text) }
}

/// Writes to stdout. All commands do so here: the program fails at its end if something could not be written ([`stdout_error`]).
pub(crate) fn print_as_it_is(text: &str) {
    let mut stdout = io::stdout().lock();
    let mut failed = first_stdout_error();
    #[cfg(target_os = "linux")]
    if failed.is_none() && crate::closed_stdout::was_closed() && !text.is_empty() {
        *failed = Some(io::Error::from_raw_os_error(libc::EBADF));
    }
    if failed.is_none() {
        // What stays in the buffer would be lost without a word.
        *failed = stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()).err();
    }
}

fn first_stdout_error() -> std::sync::MutexGuard<'static, Option<io::Error>> {
    STDOUT_ERROR.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns true if nothing more can be written to stdout.
pub(crate) fn stdout_is_closed() -> bool {
    first_stdout_error().is_some()
}

/// Takes the error that kept text from being written to stdout. A reader that has read enough, as `head` does, is none.
pub(crate) fn stdout_error() -> Option<io::Error> {
    first_stdout_error().take().filter(|error| error.kind() != ErrorKind::BrokenPipe)
}

/// Prints what clap has to say: help and versions to stdout, errors to stderr. Returns the exit code.
pub(crate) fn print_usage(message: &clap::Error) -> u8 {
    if message.use_stderr() {
        // Nobody is left to hear of it if it cannot be printed.
        let _ = message.print();
    } else {
        let text = message.render();
        let color = shows_color(&io::stdout());
        print_as_it_is(&if color { text.ansi().to_string() } else { text.to_string() });
    }
    message.exit_code() as u8
}

/// Writes words to stderr.
pub(crate) fn eprint(text: &str) {
    eprint_as_it_is(&harmless(text));
}

pub(crate) fn eprint_as_it_is(text: &str) {
    let _ = io::stderr().lock().write_all(text.as_bytes());
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
    let mut told: Vec<_> = problems.iter().enumerate().collect();
    told.sort_by_key(|(_, problem)| problem.severity);
    told.truncate(MOST_TOLD);
    told.sort_by_key(|(index, _)| *index);
    let told: Vec<_> = told.into_iter().map(|(_, problem)| problem).collect();
    let rest = problems.len() - told.len();
    (told, rest)
}

/// Prints problems to stderr as people read them.
pub(crate) fn report(problems: &[Problem]) {
    let color = shows_color(&io::stderr());
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
            fn unknown(problem: &Problem) -> bool {
                problem.code == code::UNKNOWN_NODE
            }
            let problems = finished.problems();
            report(&problems.into_iter().filter(|it| !unknown(it)).collect::<Vec<_>>());
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
