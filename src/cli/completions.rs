//! `maquette completions`: a script that completes commands in a shell.

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use maquette_graph::catalog::Catalog;

use super::{Cli, Exit, print_document, program};

#[derive(Args)]
pub(crate) struct Completions {
    /// The shell.
    shell: Shell,
}

impl Completions {
    pub(super) fn run(&self, _: &Catalog) -> Exit {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), program(), &mut script);
        print_document(&String::from_utf8_lossy(&script));
        Exit::Done
    }
}
