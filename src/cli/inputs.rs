//! `--input NAME=FILE`: values for a graph that is a function of them.

use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::session::Session;
use maquette_engine::writing::Sources;
use maquette_graph::Graph;
use maquette_syntax::error::Problem;

use super::{Exit, report};

/// What comes into a graph with inputs.
#[derive(Args, Clone, Default)]
pub(super) struct InputOptions {
    /// Give an input of the graph the value in a file, which is read by its ending as a node of the input's type would read it. The
    /// outputs of such a graph are written in the preferred formats of their types.
    #[arg(long = "input", value_name = "NAME=FILE", value_parser = input)]
    files: Vec<(String, PathBuf)>,
}

fn input(text: &str) -> Result<(String, PathBuf), String> {
    let (name, file) = text.split_once('=').ok_or("write NAME=FILE")?;
    Ok((name.trim().to_owned(), PathBuf::from(file.trim())))
}

impl InputOptions {
    /// One input with the value in a file.
    pub(super) fn of(name: &str, file: &Path) -> Self {
        Self { files: vec![(name.to_owned(), file.to_owned())] }
    }

    /// The graph with the values in the files at its inputs, and the warnings about these values.
    pub(super) fn fed(
        &self,
        session: &Session,
        graph: &Graph,
    ) -> Result<(Graph, Vec<Problem>), Vec<Problem>> {
        let (values, warnings) = session.read_inputs(graph, &self.files)?;
        Ok((session.fed(graph, &values)?, warnings))
    }

    /// The same for a forecast: large files are not read.
    pub(super) fn foreseen(
        &self,
        session: &Session,
        graph: &Graph,
    ) -> Result<(Graph, Vec<Problem>), Vec<Problem>> {
        let (values, warnings) = session.known_inputs(graph, &self.files)?;
        Ok((session.fed_with_known(graph, &values)?, warnings))
    }

    /// The graph with the values in the files, where warnings and errors are printed at once.
    pub(crate) fn told(&self, session: &Session, graph: &Graph) -> Result<Graph, Exit> {
        Self::reported(self.fed(session, graph))
    }

    /// The same for a forecast.
    pub(crate) fn told_foreseen(&self, session: &Session, graph: &Graph) -> Result<Graph, Exit> {
        Self::reported(self.foreseen(session, graph))
    }

    fn reported(found: Result<(Graph, Vec<Problem>), Vec<Problem>>) -> Result<Graph, Exit> {
        match found {
            Ok((graph, warnings)) => {
                report(&warnings);
                Ok(graph)
            }
            Err(problems) => {
                report(&problems);
                Err(Exit::Failed)
            }
        }
    }

    /// What may not be replaced: the files.
    pub(super) fn protect(&self, sources: &mut Sources) {
        self.files().for_each(|file| sources.add(file, "it is an input"));
    }

    /// The files.
    pub(super) fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(_, path)| &**path)
    }
}
