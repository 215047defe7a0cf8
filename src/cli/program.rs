//! The program: its words, and what it ends with.

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Parser, Subcommand};
use maquette_graph::catalog::Catalog;
use maquette_node::pack::Pack;

use crate::output::{Exit, NAME, eprint, name_in, print_usage, program, stdout_error};
use crate::parent;

/// A node-based geometry graph for redesigning scanned objects.
#[derive(Parser)]
#[command(name = "maquette", version, propagate_version = true)]
#[command(disable_help_subcommand = true, after_help = topics())]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Makes the subcommands: each is a struct of arguments that runs.
macro_rules! commands {
    ($($(#[$doc:meta])* $name:ident($file:ident::$arguments:ident),)*) => {
        #[derive(Subcommand)]
        pub(crate) enum Command {
            $($(#[$doc])* $name(crate::$file::$arguments),)*
        }

        impl Command {
            fn run(&self, catalog: &Arc<Catalog>) -> Exit {
                match self {
                    $(Self::$name(command) => command.run(catalog),)*
                }
            }
        }
    };
}

commands! {
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
    Completions(completions::Completions),
}

pub(crate) fn topics() -> String {
    let contents = maquette_lsp::language::contents();
    format!("The language of graphs, by `{} help TOPIC`:\n{}", program(), contents.trim_end())
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
    maquette_engine::eval::this_is_a_program();
    let code = run_words(packs, Vec::from_iter(words));
    let Some(error) = stdout_error() else { return code };
    eprint(&format!("error: cannot write to standard output: {error}\n"));
    code.max(1)
}

fn run_words(packs: &[&Pack], mut words: Vec<OsString>) -> u8 {
    // The format may be left out, so that a word behind a blank is the graph unless it names one.
    let place = words.windows(2).position(|pair| pair[0] == "--events" && pair[1] == "openjd");
    if let Some(place) = place {
        words.splice(place..place + 2, ["--events=openjd".into()]);
    }
    parent::end_with_it();
    NAME.get_or_init(|| name_in(words.first()));
    let cli = match Cli::try_parse_from(words) {
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
