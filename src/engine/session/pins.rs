//! Pins: results of nodes that are stored next to the graph file, so that the nodes need not run. Adds and removes pins.

use std::path::{Path, PathBuf};

use maquette_graph::{Ancestry, ELEMENTS, Graph, INPUT, PINS_ENDING, Pin, Pins, bytes_of};
use maquette_syntax::error::{Diagnostic, code};

use super::RunResult;
use crate::writing::{
    Destination, FolderLock, Sources, WriteError, keep_beside, make_folder, remove, remove_empty,
    sweep,
};

/// The reason why pins could not be added or removed.
#[derive(Debug, thiserror::Error)]
pub enum PinError {
    #[error("{}", .0.message)]
    Unread(Box<Diagnostic>),
    #[error("the pin cannot be kept: {0}")]
    Refused(#[from] WriteError),
    #[error("the pins cannot be changed: {0}")]
    Io(#[from] std::io::Error),
}

impl From<Box<Diagnostic>> for PinError {
    fn from(diagnostic: Box<Diagnostic>) -> Self {
        Self::Unread(diagnostic)
    }
}

/// Returns the nodes whose results are pinned when the user pins `name`. This is the node with that name. If that node uses another graph,
/// these are the nodes that compute its outputs.
///
/// # Errors
/// A message if there is no such node, or if its result cannot be pinned.
pub fn pinnable<'g>(graph: &'g Graph, name: &str) -> Result<Vec<&'g str>, String> {
    if let Some(each) = graph.open_loop(name) {
        return Err(format!(
            "`{}` is a loop over data, whose elements cannot be pinned: pin its data, or a node that uses all elements",
            each.name
        ));
    }
    let nodes = graph.nodes_of(name);
    if nodes.is_empty() {
        let known = Vec::from_iter(graph.names());
        return Err(graph.unknown("node", name, "its nodes", &known));
    }
    fn of_kind(kind: &str, nodes: &[usize], graph: &Graph) -> bool {
        nodes.iter().any(|&node| graph.nodes()[node].kind() == kind)
    }
    if of_kind(INPUT, &nodes, graph) {
        return Err(format!("`{name}` is an input of the graph, which is not computed"));
    }
    if of_kind(ELEMENTS, &nodes, graph) {
        return Err(format!("`{name}` is a part of data: pin the data"));
    }
    Ok(nodes.into_iter().map(|node| &graph.nodes()[node].name[..]).collect())
}

impl RunResult {
    /// Pins the results of the named nodes, and returns the written files. `graph` is the graph as it was loaded, before its loops over
    /// data were expanded.
    ///
    /// # Errors
    /// If one of the nodes has no result, or a file cannot be written.
    pub fn pin(&self, graph: &Graph, names: &[&str]) -> Result<Vec<PathBuf>, PinError> {
        let path = &graph.source().name;
        let _turn = FolderLock::acquire(path)?;
        let mut pins = Pins::read(path)?;
        make_folder(&pins.folder)?;
        let sources = Sources::of_graph(graph);
        let (mut files, mut former) = (Vec::new(), Vec::new());
        for name in names {
            let values = self.values_of_node(name).zip(graph.find(name));
            let Some((values, index)) = values else {
                let message = format!("`{name}` gave nothing");
                return Err(Box::new(graph.diagnostic(code::FAILED, message)).into());
            };
            let pin = Pin::new(&values, Ancestry::trace(graph.nodes(), index, graph.readers()));
            let file = pin.file(&pins.folder);
            Destination::folder(&pins.folder, &sources).write(&file, &bytes_of(&values))?;
            files.push(file);
            former.extend(pins.pins.insert((*name).to_owned(), pin));
        }
        keep_beside(&path.with_extension(PINS_ENDING), &pins.to_text())?;
        former.iter().try_for_each(|former| remove_unused_pin(&pins, former))?;
        Ok(files)
    }
}

/// Removes the pins of the nodes with the given names. For a node that uses another graph, removes the pins of all nodes in that graph.
/// Returns the names of the nodes whose pins were removed.
///
/// # Errors
/// If a file cannot be read, written or removed.
pub fn unpin(graph: &Path, names: &[String]) -> Result<Vec<String>, PinError> {
    let _turn = FolderLock::acquire(graph)?;
    let mut pins = Pins::read(graph)?;
    fn is_meant(pinned: &str, names: &[String]) -> bool {
        names.iter().any(|name| matches_pin(name, pinned))
    }
    let taken = Vec::from_iter(pins.pins.extract_if(.., |pinned, _| is_meant(pinned, names)));
    let file = graph.with_extension(PINS_ENDING);
    match (taken.is_empty(), pins.pins.is_empty()) {
        (true, _) => {}
        (false, true) => remove(&file)?,
        (false, false) => keep_beside(&file, &pins.to_text())?,
    }
    taken.iter().try_for_each(|(_, pin)| remove_unused_pin(&pins, pin))?;
    if pins.pins.is_empty() {
        sweep(&pins.folder);
        remove_empty(&pins.folder);
    }
    Ok(taken.into_iter().map(|(name, _)| name).collect())
}

/// Returns true if `name` is the pinned node itself, or a node that uses the graph which contains the pinned node.
pub fn matches_pin(name: &str, pinned: &str) -> bool {
    pinned.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Removes the file of a pin that was removed or replaced, unless another pin still uses that file.
fn remove_unused_pin(pins: &Pins, former: &Pin) -> Result<(), WriteError> {
    let file = former.file(&pins.folder);
    let is_needed = pins.pins.values().any(|pin| pin.outputs == former.outputs);
    if !is_needed && file.exists() {
        Destination::folder(&pins.folder, &Sources::default()).remove(&file)?;
    }
    Ok(())
}
