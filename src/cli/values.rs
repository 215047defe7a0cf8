//! `maquette values`: the types of values that this program knows.

use clap::Args;
use maquette_graph::catalog::Catalog;

use super::{Exit, print_document};

#[derive(Args)]
pub(crate) struct Values {}

impl Values {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let mut names = Vec::from_iter(catalog.value_types().into_keys());
        names.sort_unstable();
        print_document(&(names.join("\n") + "\n"));
        Exit::Done
    }
}
