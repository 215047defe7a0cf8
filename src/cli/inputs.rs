//! `--input NAME=FILE`: reads the values of a graph's inputs from files.

use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::session::Session;
use maquette_engine::writing::Sources;
use maquette_graph::Graph;
use maquette_syntax::error::Diagnostic;

use super::{Exit, report};

/// Values for the inputs of a graph.
#[derive(Args, Clone, Default)]
pub(super) struct InputOptions {
    /// Set an input of the graph to the value in a file. The extension determines the reader. Outputs without an extension are written in
    /// the preferred format of their type.
    #[arg(long = "input", value_name = "NAME=FILE", value_parser = parse_input)]
    files: Vec<(String, PathBuf)>,
}

fn parse_input(text: &str) -> Result<(String, PathBuf), String> {
    let (name, file) = text.split_once('=').ok_or("expected NAME=FILE")?;
    Ok((name.trim().to_owned(), PathBuf::from(file.trim())))
}

impl InputOptions {
    /// Creates options that set a single input.
    pub(super) fn single(name: &str, file: &Path) -> Self {
        Self { files: vec![(name.to_owned(), file.to_owned())] }
    }

    /// Returns the graph with the values from the files as its inputs. Also returns the warnings of reading the files.
    pub(super) fn feed(
        &self,
        session: &Session,
        graph: &Graph,
    ) -> Result<(Graph, Vec<Diagnostic>), Vec<Diagnostic>> {
        let (values, warnings) = session.read_inputs(graph, &self.files)?;
        Ok((session.bind_inputs(graph, &values)?, warnings))
    }

    /// Returns the graph with what is known about its inputs, for a forecast. Large files are not read. Also returns warnings.
    pub(super) fn feed_for_forecast(
        &self,
        session: &Session,
        graph: &Graph,
    ) -> Result<(Graph, Vec<Diagnostic>), Vec<Diagnostic>> {
        let (values, warnings) = session.known_inputs(graph, &self.files)?;
        Ok((session.bind_known_inputs(graph, &values)?, warnings))
    }

    /// Does the work of [`Self::feed`], and prints the warnings and errors.
    pub(crate) fn feed_and_report(&self, session: &Session, graph: &Graph) -> Result<Graph, Exit> {
        Self::report_warnings(self.feed(session, graph))
    }

    /// Does the work of [`Self::feed_for_forecast`], and prints the warnings and errors.
    pub(crate) fn feed_for_forecast_and_report(
        &self,
        session: &Session,
        graph: &Graph,
    ) -> Result<Graph, Exit> {
        Self::report_warnings(self.feed_for_forecast(session, graph))
    }

    fn report_warnings(
        found: Result<(Graph, Vec<Diagnostic>), Vec<Diagnostic>>,
    ) -> Result<Graph, Exit> {
        match found {
            Ok((graph, warnings)) => {
                report(&warnings);
                Ok(graph)
            }
            Err(diagnostics) => {
                report(&diagnostics);
                Err(Exit::Failed)
            }
        }
    }

    /// Adds the input files to `sources`, the files that outputs must not replace.
    pub(super) fn protect(&self, sources: &mut Sources) {
        self.files().for_each(|file| sources.add(file, "it is an input"));
    }

    /// Returns the paths of the input files.
    pub(super) fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(|(_, path)| &**path)
    }
}
