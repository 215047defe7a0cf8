//! `maquette help`: prints a topic of the graph language, or the help of a command.

use clap::{Args, CommandFactory};
use maquette_graph::catalog::Catalog;
use maquette_lsp::manual::{TOPICS, plain, topic, topics_about};
use maquette_syntax::unknown_name_message;

use super::{Cli, Exit, print, print_usage, program, renamed_commands};

#[derive(Args)]
pub(crate) struct Help {
    /// A topic of the graph language, or a command [default: list both].
    #[arg(value_name = "TOPIC|COMMAND")]
    words: Vec<String>,
}

/// The maximum line width in columns, even on wider terminals. Longer lines are hard to read.
const MAX_WIDTH: usize = 100;

impl Help {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let command = Cli::command();
        if let [word] = &self.words[..]
            && let Some(topic) = topic(word)
        {
            print(&plain(&topic.render(catalog), width()));
            if command.find_subcommand(word).is_some() {
                print(&format!("\n`{} {word} --help` explains the command.\n", program()));
            } else if let Some(words) = renamed_commands::help_words(word) {
                print(&format!("\n`{} help {words}` explains the command.\n", program()));
            }
            return Exit::Done;
        }
        let mut command_path = &command;
        for word in &self.words {
            match command_path.find_subcommand(word) {
                Some(found) => command_path = found,
                None => return Exit::Usage(unknown_message(word, command_path)),
            }
        }
        let words = [program()].into_iter().chain(self.words.iter().cloned());
        if let Err(help) = Cli::command().try_get_matches_from(words.chain(["--help".into()])) {
            print_usage(&help);
        }
        Exit::Done
    }
}

/// Returns the message about an unknown topic or command. It suggests a similar one.
fn unknown_message(word: &str, command: &clap::Command) -> String {
    if let Some(words) = renamed_commands::help_words(word) {
        return format!(
            "`{word}` has a new name\n  = help: use `{} help {words}` instead",
            program()
        );
    }
    let message = format!("there is no topic or command `{word}`");
    if let about @ [_, ..] = &topics_about(word)[..] {
        let topics = about.iter().map(|name| format!("`{} help {name}`", program()));
        return format!("{message}; it is explained by {}", Vec::from_iter(topics).join(", "));
    }
    let topics = TOPICS.iter().map(|topic| topic.name);
    let commands = command.get_subcommands().map(clap::Command::get_name);
    unknown_name_message(message, word, "there are", &topics.chain(commands).collect::<Vec<_>>())
}

fn width() -> usize {
    let (_, columns) = console::Term::stdout().size_checked().unwrap_or((0, MAX_WIDTH as u16));
    MAX_WIDTH.min(columns.into()).max(20)
}
