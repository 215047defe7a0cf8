//! `maquette help`: a topic of the language of graphs, or a command as clap explains it.

use clap::{Args, CommandFactory};
use maquette_graph::catalog::Catalog;
use maquette_lsp::language::{TOPICS, plain, topic, topics_about};
use maquette_syntax::unknown;

use super::{Cli, Exit, print, print_usage, program};

#[derive(Args)]
pub(crate) struct Help {
    /// A topic of the language of graphs, or a command; without it, both are listed.
    #[arg(value_name = "TOPIC|COMMAND")]
    words: Vec<String>,
}

/// Lines that are longer are tiring to read.
const WIDEST: usize = 100;

impl Help {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let command = Cli::command();
        if let [word] = &self.words[..]
            && let Some(topic) = topic(word)
        {
            print(&plain(&topic.told(catalog), width()));
            if command.find_subcommand(word).is_some() {
                print(&format!("\n`{} {word} --help` explains the command.\n", program()));
            }
            return Exit::Done;
        }
        let mut asked = &command;
        for word in &self.words {
            match asked.find_subcommand(word) {
                Some(found) => asked = found,
                None => return Exit::Usage(nothing_called(word, asked)),
            }
        }
        let words = [program()].into_iter().chain(self.words.iter().cloned());
        if let Err(help) = Cli::command().try_get_matches_from(words.chain(["--help".into()])) {
            print_usage(&help);
        }
        Exit::Done
    }
}

/// That there is no such topic or command, and what may have been meant.
fn nothing_called(word: &str, command: &clap::Command) -> String {
    let message = format!("there is no topic or command `{word}`");
    if let about @ [_, ..] = &topics_about(word)[..] {
        let topics = about.iter().map(|name| format!("`{} help {name}`", program()));
        return format!("{message}; it is explained by {}", Vec::from_iter(topics).join(", "));
    }
    let topics = TOPICS.iter().map(|topic| topic.name);
    let commands = command.get_subcommands().map(clap::Command::get_name);
    unknown(message, word, "there are", &topics.chain(commands).collect::<Vec<_>>())
}

fn width() -> usize {
    let (_, columns) = console::Term::stdout().size_checked().unwrap_or((0, WIDEST as u16));
    WIDEST.min(columns.into()).max(20)
}
