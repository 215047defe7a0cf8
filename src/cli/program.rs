//! The program as a whole: its command line and its exit codes.

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;

use clap::builder::Styles;
use clap::{Parser, Subcommand};
use maquette_graph::catalog::Catalog;
use maquette_node::pack::Pack;

use crate::output::{Exit, NAME, eprint, name_in, print_usage, program, stdout_error};
use crate::{parent, renamed_commands};

/// A node-based geometry graph for redesigning scanned objects.
#[derive(Parser)]
#[command(name = "maquette", version, propagate_version = true)]
#[command(disable_help_subcommand = true, help_template = help_template(), after_help = topic_list())]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Defines the enum of all commands, in groups. Each command is a struct of arguments with a method `run`.
macro_rules! commands {
    ($($group:literal { $($(#[$doc:meta])* $name:ident($file:ident::$arguments:ident),)* })*) => {
        #[derive(Subcommand)]
        pub(crate) enum Command {
            $($($(#[$doc])* $name(crate::$file::$arguments),)*)*
        }

        /// The groups of commands in `--help`. Each has its title, and the names of the variants of [`Command`] in it.
        const GROUPS: &[(&str, &[&str])] = &[$(($group, &[$(stringify!($name)),*]),)*];

        impl Command {
            fn run(&self, catalog: &Arc<Catalog>) -> Exit {
                match self {
                    $($(Self::$name(command) => command.run(catalog),)*)*
                }
            }
        }
    };
}

commands! {
    "make" {
        /// Create a graph for a folder of scans.
        New(new::New),
        /// Print the reference of all nodes, or of one.
        Nodes(nodes::Nodes),
        /// Explain the graph language by topic, or a command.
        Help(help::Help),
    }
    "run" {
        /// Evaluate a graph and write its outputs.
        Run(run::Run),
        /// Evaluate a graph again whenever a file that it depends on changes.
        Watch(watch::Watch),
        /// Run a graph over many scans and parameter values, and compare the results on one page.
        Batch(batch::Batch),
        /// Compute an output again from the provenance in it, and report if it is the same.
        Replay(replay::Replay),
    }
    "look" {
        /// Print facts about a result: counts, bounds, topology, or the value at a pixel.
        Inspect(inspect::Inspect),
        /// Explain why a node would run, or not, since the last evaluation of the graph.
        Why(why::WhyCommand),
        /// Draw a graph as SVG or for Graphviz; its input files may be missing.
        Draw(draw::Draw),
        /// Render a picture of a value, contact sheets of graphs, or a gallery of a folder.
        Render(render::Render),
    }
    "test" {
        /// Report the errors and warnings of graphs without running them.
        Check(check::Check),
        /// Compare the outputs of graphs with their approved results (goldens).
        Test(test::Test),
        /// Compare the contents of two files: meshes, range images, pictures.
        Compare(compare::Compare),
    }
    "edit" {
        /// Edit a graph file: nodes, links, values, outputs. All other bytes stay.
        Edit(edit::Edit),
        /// Format graphs. Comments and the order of nodes stay.
        Fmt(fmt::Fmt),
        /// List the differences between two graphs, except formatting, comments and order.
        Diff(diff::Diff),
        /// Merge two versions of a graph: git's merge driver for graphs.
        Merge(merge::Merge),
    }
    "share" {
        /// Write or update the lock file of the graphs that a graph uses; see `run --locked`.
        Lock(lock::Lock),
        /// Store results of nodes beside the graph, so that these nodes do not run; or remove them.
        Pin(pin::Pin),
        /// Show, check and clean the results that are stored on disk.
        Cache(cache::Cache),
        /// Run graphs for another program, by lines of JSON; see docs/serve.md.
        Serve(serve::Serve),
        /// Serve editors by the language server protocol: diagnostics, completion, renaming.
        Lsp(lsp::Lsp),
        /// Print a script that completes commands in a shell.
        Completions(completions::Completions),
    }
}

/// Returns the template of `maquette --help`, which lists the commands by group.
fn help_template() -> String {
    let command = Command::augment_subcommands(clap::Command::new("maquette"));
    let styles = Styles::styled();
    let (header, literal) = (styles.get_header(), styles.get_literal());
    let width = command.get_subcommands().map(|it| it.get_name().len()).max().unwrap_or(0);
    let mut list = String::new();
    for (group, variants) in GROUPS {
        list += &format!("{header}{group}:{header:#}\n");
        for variant in *variants {
            let name = variant.to_lowercase();
            let about = command.find_subcommand(&name).and_then(clap::Command::get_about);
            let about = about.map(ToString::to_string).unwrap_or_default();
            list += &format!("  {literal}{name:<width$}{literal:#}  {about}\n");
        }
    }
    format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}\n{header}Options:{header:#}\n{{options}}{{after-help}}"
    )
}

fn topic_list() -> String {
    let names = maquette_lsp::manual::TOPICS.iter().map(|topic| topic.name).collect::<Vec<_>>();
    format!("Topics of the graph language, for `{} help TOPIC`: {}.", program(), names.join(", "))
}

/// Runs the program with the given packs and the arguments of the process.
pub fn main(packs: &[&Pack]) -> ExitCode {
    ExitCode::from(run(packs, std::env::args_os()))
}

/// Runs the program inside of another process, such as a Python interpreter. The first argument is the name of the program. Returns the
/// exit code: 0 for success, 1 if the graph failed, 2 if the command line is wrong, 130 if interrupted.
///
/// Like [`main`], installs the program's Ctrl-C handler and memory settings in the process.
pub fn run(packs: &[&Pack], arguments: impl IntoIterator<Item = OsString>) -> u8 {
    maquette_value::memory::keep_freed();
    maquette_engine::eval::this_is_a_program();
    let code = run_arguments(packs, Vec::from_iter(arguments));
    let Some(error) = stdout_error() else { return code };
    eprint(&format!("error: cannot write to standard output: {error}\n"));
    code.max(1)
}

fn run_arguments(packs: &[&Pack], mut arguments: Vec<OsString>) -> u8 {
    // Join `--events openjd` to one argument. The value of `--events` is optional, so clap would take `openjd` for the path of the graph.
    let events = arguments.windows(2).position(|pair| pair[0] == "--events" && pair[1] == "openjd");
    if let Some(index) = events {
        arguments.splice(index..index + 2, ["--events=openjd".into()]);
    }
    parent::end_with_parent();
    NAME.get_or_init(|| name_in(arguments.first()));
    if let Some(message) = renamed_commands::message(&arguments[1.min(arguments.len())..]) {
        eprint(&message);
        return 2;
    }
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(message) => return print_usage(&message),
    };
    let catalog = Arc::new(Catalog::new(packs));
    match cli.command.run(&catalog) {
        Exit::Done => 0,
        Exit::Failed => 1,
        Exit::Interrupted => 130,
        Exit::Usage(why) => {
            eprint(&format!("error: {why}\n"));
            2
        }
    }
}
