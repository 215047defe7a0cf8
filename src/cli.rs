//! The command line: one file per subcommand.
//!
//! Results go to stdout, messages to stderr. Exit codes: 0 done, 1 the graph failed, 2 the command line is wrong, 130
//! stopped by Ctrl-C.

use std::ffi::OsString;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use clap::{Args, CommandFactory, Parser, Subcommand};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Checked, Graph, Options};
use maquette_node::pack::Pack;
use maquette_syntax::error::{MOST_TOLD, Problem, code};
use maquette_syntax::telling::{escaped, harmless, in_full};

use crate::session::{Finished, OutputFolder, Run, Session, Wanted};

mod batch;
mod cache;
mod caching;
mod check;
mod compare;
mod diff;
mod draw;
mod edit;
mod events;
mod extract;
mod files;
mod fmt;
mod gallery;
mod help;
mod inline;
mod inputs;
mod inspect;
mod interrupt;
mod lock;
mod look;
mod lsp;
mod merge;
mod migrate;
mod new;
mod nodes;
mod pin;
mod profile;
mod progress;
mod render;
mod replay;
mod run;
mod serve;
mod set;
mod sheet;
mod terminal;
mod test;
mod watch;
mod why;

/// A node-based geometry graph for redesigning scanned objects.
#[derive(Parser)]
#[command(name = "maquette", version, propagate_version = true)]
#[command(disable_help_subcommand = true, after_help = topics())]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Look at a folder of scans and write a graph that runs on them.
    New(new::New),
    /// Evaluate a graph and write its outputs.
    Run(run::Run),
    /// Run a graph over many scans and many values, and show what came of them side by side.
    Batch(batch::Batch),
    /// Evaluate a graph again whenever something that it depends on changes.
    Watch(watch::Watch),
    /// Find every problem of some graphs; run nothing.
    Check(check::Check),
    /// Draw a graph as SVG or for Graphviz; the files that it reads need not be there.
    Draw(draw::Draw),
    /// Bring graphs into their canonical form; comments and order stay.
    Fmt(fmt::Fmt),
    /// Put values into a graph file and leave every other byte of it alone.
    Set(set::Set),
    /// Add, remove, rename and link nodes of a graph file and leave every other byte of it alone.
    Edit(edit::Edit),
    /// Make some nodes of a graph a graph of their own, and use it in their place.
    Extract(extract::Extract),
    /// Put the nodes of a used graph in the place of one use of it.
    Inline(inline::Inline),
    /// Say how two graphs differ in what they say; formatting, comments and order do not matter.
    Diff(diff::Diff),
    /// Put together what two people made of one graph: git's merge driver for graphs.
    Merge(merge::Merge),
    /// Put the new names of nodes and fields into graphs that have old ones.
    Migrate(migrate::Migrate),
    /// Write down what the graphs are that a graph uses, beside it: `--locked` holds them to it.
    Lock(lock::Lock),
    /// Show what changed in the graphs that a graph uses since they were locked, and take it.
    Update(lock::Update),
    /// Compare the outputs of graphs with what they were when somebody looked at them.
    Test(test::Test),
    /// Compare two files by what they mean: meshes, range data, pictures.
    Compare(compare::Compare),
    /// Make a picture of any value, of a graph or a file.
    Render(render::Render),
    /// Make an output again by what it tells of the graph that it came from, and say whether it is the same.
    Replay(replay::Replay),
    /// Show what graphs give from five sides, with the least and the greatest of each parameter, in one picture each.
    Sheet(sheet::Sheet),
    /// Print the reference of all nodes, or of one.
    Nodes(nodes::Nodes),
    /// Make a page of all graphs of a folder, each with its picture.
    Gallery(gallery::Gallery),
    /// Show what a node gives: counts, bounds, topology, or what is under a pixel.
    Inspect(inspect::Inspect),
    /// Say why a node would run, or why not, since the last evaluation of the graph.
    Why(why::Why),
    /// Keep a node's result beside the graph: from then on the node is not run.
    Pin(pin::Pin),
    /// Take pins of a graph away: the nodes run again.
    Unpin(pin::Unpin),
    /// Run graphs for another program, by lines of JSON; see docs/serve.md.
    Serve(serve::Serve),
    /// Serve editors: problems, completion, names and more, by the language server protocol.
    Lsp(lsp::Lsp),
    /// Look after the results that are kept on disk.
    Cache(cache::Cache),
    /// Explain the language of graphs, a topic at a time, or a command.
    Help(help::Help),
    /// Print a script that completes commands in a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

fn topics() -> String {
    let contents = crate::language::contents();
    format!("The language of graphs, by `{} help TOPIC`:\n{}", program(), contents.trim_end())
}

/// What shapes the reading of a graph.
#[derive(Args)]
struct GraphOptions {
    /// Put a value in place of a parameter's default (NAME=VALUE) or of a node's field (NODE.FIELD=VALUE). A value that is no
    /// RON is text.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, String)>,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR")]
    roots: Vec<PathBuf>,
    /// Take the draft of each `Draft(final: .., draft: ..)`, for a first look.
    #[arg(long)]
    draft: bool,
    /// Refuse the graph if one that it uses is not what the lock file says.
    #[arg(long)]
    locked: bool,
    /// Run the nodes that are pinned, too, as if there were no pins.
    #[arg(long)]
    no_pins: bool,
}

fn assignment(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE or NODE.FIELD=VALUE")?;
    Ok((name.trim().to_owned(), value.trim().to_owned()))
}

impl GraphOptions {
    fn load(&self, path: &Path, catalog: &Catalog) -> Checked {
        Graph::load(path, catalog, &self.all())
    }

    fn all(&self) -> Options {
        let (roots, set) = (self.roots.clone(), self.set.clone());
        let Self { draft, locked, no_pins, .. } = *self;
        Options { roots, set, draft, locked, pins: !no_pins, ..Options::default() }
    }

    /// The folder for the outputs of a graph: the one that was named, else one that drafts have apart.
    fn folder(&self, named: Option<&Path>, graph: &Path) -> OutputFolder {
        if self.draft {
            OutputFolder::of_draft(named, graph)
        } else {
            OutputFolder::new(named, graph)
        }
    }
}

/// How a command ends.
enum Exit {
    Done,
    /// The graph, or something that it names, failed; the reasons have been printed.
    Failed,
    /// The user stopped it.
    Interrupted,
    /// The command line is wrong: why.
    Usage(String),
}

/// The whole program, with these packs.
pub fn main(packs: &[&Pack]) -> ExitCode {
    ExitCode::from(run(packs, std::env::args_os()))
}

/// The whole program with these packs and these words, the first of which is its name; for a process that is more than that, as an
/// interpreter is. Gives its exit code: 0 done, 1 the graph failed, 2 the words are wrong, 130 interrupted.
///
/// Ctrl-C and the allocator are the program's from then on, as [`main`] has them.
pub fn run(packs: &[&Pack], words: impl IntoIterator<Item = OsString>) -> u8 {
    maquette_value::memory::keep_freed();
    crate::eval::this_is_a_program();
    let words = Vec::from_iter(words);
    NAME.get_or_init(|| name_in(words.first()));
    let cli = match Cli::try_parse_from(words) {
        Ok(cli) => cli,
        Err(told) => {
            // Nobody is left to tell if it cannot be printed.
            let _ = told.print();
            return told.exit_code() as u8;
        }
    };
    let catalog = Arc::new(Catalog::new(packs));
    let exit = match cli.command {
        Command::Run(command) => command.run(&catalog),
        Command::Batch(command) => command.run(&catalog),
        Command::Watch(command) => command.run(&catalog),
        Command::Check(command) => command.run(&catalog),
        Command::Draw(command) => command.run(&catalog),
        Command::Fmt(command) => command.run(&catalog),
        Command::Set(command) => command.run(&catalog),
        Command::Edit(command) => command.run(&catalog),
        Command::Extract(command) => command.run(&catalog),
        Command::Inline(command) => command.run(&catalog),
        Command::Diff(command) => command.run(&catalog),
        Command::Merge(command) => command.run(&catalog),
        Command::Migrate(command) => command.run(&catalog),
        Command::Lock(command) => command.run(&catalog),
        Command::Update(command) => command.run(&catalog),
        Command::Test(command) => command.run(&catalog),
        Command::Compare(command) => command.run(&catalog),
        Command::Render(command) => command.run(&catalog),
        Command::Replay(command) => command.run(&catalog),
        Command::Sheet(command) => command.run(&catalog),
        Command::New(command) => command.run(&catalog),
        Command::Nodes(command) => command.run(&catalog),
        Command::Gallery(command) => command.run(&catalog),
        Command::Inspect(command) => command.run(&catalog),
        Command::Why(command) => command.run(&catalog),
        Command::Pin(command) => command.run(&catalog),
        Command::Unpin(command) => command.run(),
        Command::Serve(command) => command.run(&catalog),
        Command::Lsp(command) => command.run(&catalog),
        Command::Cache(command) => command.run(),
        Command::Help(command) => command.run(),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), program(), &mut script);
            print_document(&String::from_utf8_lossy(&script));
            Exit::Done
        }
    };
    match exit {
        Exit::Done => 0,
        Exit::Failed => 1,
        Exit::Interrupted => 130,
        Exit::Usage(why) => {
            eprint(&format!("error: {why}\n"));
            2
        }
    }
}

/// The name of this program: one with a stranger's packs has its own.
fn program() -> String {
    NAME.get_or_init(|| name_in(std::env::args_os().next().as_ref())).clone()
}

static NAME: OnceLock<String> = OnceLock::new();

fn name_in(word: Option<&OsString>) -> String {
    let name = word.and_then(|word| Path::new(word).file_stem());
    name.map_or_else(|| "maquette".into(), |name| name.to_string_lossy().into_owned())
}

/// Whether writing to stdout has failed.
static STDOUT_CLOSED: AtomicBool = AtomicBool::new(false);

/// Writes words to stdout, in which names that others gave may stand.
fn print(text: &str) {
    print_as_it_is(&harmless(text));
}

/// Writes a document to stdout: a program that reads it gets every byte, a terminal what it shows.
fn print_document(text: &str) {
    if std::io::stdout().is_terminal() { print(text) } else { print_as_it_is(text) }
}

/// Writes to stdout; a reader that has gone away is no error.
fn print_as_it_is(text: &str) {
    if std::io::stdout().lock().write_all(text.as_bytes()).is_err() {
        STDOUT_CLOSED.store(true, Ordering::Relaxed);
    }
}

/// Whether the reader of stdout has gone away.
fn stdout_is_closed() -> bool {
    STDOUT_CLOSED.load(Ordering::Relaxed)
}

/// Writes words to stderr.
fn eprint(text: &str) {
    eprint_as_it_is(&harmless(text));
}

fn eprint_as_it_is(text: &str) {
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

fn print_json(document: &serde_json::Value) {
    print_as_it_is(&escaped(&format!("{document:#}\n")));
}

/// Whether a stream shows colors: a terminal, unless NO_COLOR is set (no-color.org).
fn shows_color(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// The problems that are told, in their order, and how many are not: where there are too many, errors go before warnings.
fn told(problems: &[Problem]) -> (Vec<&Problem>, usize) {
    let mut told = Vec::from_iter(problems.iter().enumerate());
    told.sort_by_key(|(_, problem)| problem.severity);
    told.truncate(MOST_TOLD);
    told.sort_by_key(|(index, _)| *index);
    let told = Vec::from_iter(told.into_iter().map(|(_, problem)| problem));
    let rest = problems.len() - told.len();
    (told, rest)
}

/// Prints problems to stderr as people read them.
fn report(problems: &[Problem]) {
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
fn all_outputs(session: &mut Session, graph: &Graph) -> Option<Finished> {
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
fn put_problems(document: &mut serde_json::Value, problems: &[Problem]) {
    let (told, rest) = told(problems);
    document["problems"] = told.into_iter().map(Problem::to_json).collect();
    if rest > 0 {
        document["more_problems"] = rest.into();
    }
}

/// How wide a column of names is, of these lengths. Very long ones stand out of it.
fn column_width(lengths: impl Iterator<Item = usize>) -> usize {
    lengths.max().unwrap_or(0).min(200)
}

/// `4.1 MB`.
fn in_bytes(bytes: usize) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}

/// `3 errors`, `1 error`, `9 900 problems`.
fn counted(count: usize, what: &str) -> String {
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

// TRANSFERRED
#[cfg(feature = "cli")]
mod condition;

#[cfg(feature = "cli")]
pub(crate) use condition::Condition;
