//! Keeps results of nodes beside the graph, and takes them away.

use std::path::{Path, PathBuf};

use maquette_graph::{Ancestry, ELEMENTS, Graph, INPUT, PINS_ENDING, Pin, Pins, bytes_of};
use maquette_syntax::error::{Problem, code};

use super::Finished;
use crate::writing::{
    Destination, Refused, Sources, Turn, keep_beside, make_folder, remove, remove_empty, sweep,
};

/// Why pins are not changed.
#[derive(Debug, thiserror::Error)]
pub enum PinError {
    #[error("{}", .0.message)]
    Unread(Box<Problem>),
    #[error("the pin cannot be kept: {0}")]
    Refused(#[from] Refused),
    #[error("the pins cannot be changed: {0}")]
    Io(#[from] std::io::Error),
}

impl From<Box<Problem>> for PinError {
    fn from(problem: Box<Problem>) -> Self {
        Self::Unread(problem)
    }
}

/// The nodes that a name means to somebody who wants to keep what they give.
///
/// # Errors
/// In words, if there is none, or none that can be pinned.
pub fn pinnable<'g>(graph: &'g Graph, name: &str) -> Result<Vec<&'g str>, String> {
    if let Some(each) = graph.open_loop(name) {
        return Err(format!(
            "`{}` has as many elements as its data have, of which none can be pinned: pin its data, or what is made of all of them",
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
        return Err(format!(
            "`{name}` is an input of the graph: what is given there is not computed"
        ));
    }
    if of_kind(ELEMENTS, &nodes, graph) {
        return Err(format!("`{name}` is a part of data: pin the data"));
    }
    Ok(nodes.into_iter().map(|node| &graph.nodes()[node].name[..]).collect())
}

impl Finished {
    /// Keeps what these nodes of the graph, as it was before its data said how many nodes it has, gave as its pins. The files.
    ///
    /// # Errors
    /// If a value is not there, or a file cannot be written.
    pub fn pin(&self, graph: &Graph, names: &[&str]) -> Result<Vec<PathBuf>, PinError> {
        let path = &graph.source().name;
        let _turn = Turn::beside(path)?;
        let mut pins = Pins::of(path)?;
        make_folder(&pins.folder)?;
        let sources = Sources::of(graph);
        let (mut files, mut former) = (Vec::new(), Vec::new());
        for name in names {
            let values = self.values_of_node(name).zip(graph.find(name));
            let Some((values, index)) = values else {
                let message = format!("`{name}` gave nothing");
                return Err(Box::new(graph.problem(code::FAILED, message)).into());
            };
            let pin = Pin::new(&values, Ancestry::of(graph.nodes(), index, graph.readers()));
            let file = pin.file(&pins.folder);
            Destination::folder(&pins.folder, &sources).write(&file, &bytes_of(&values))?;
            files.push(file);
            former.extend(pins.pins.insert((*name).to_owned(), pin));
        }
        keep_beside(&path.with_extension(PINS_ENDING), &pins.to_text())?;
        former.iter().try_for_each(|former| tidy(&pins, former))?;
        Ok(files)
    }
}

/// Takes away the pins of nodes of these names, and in uses of these names. Gives the nodes' names.
///
/// # Errors
/// If a file cannot be read, written or taken away.
pub fn unpin(graph: &Path, names: &[String]) -> Result<Vec<String>, PinError> {
    let _turn = Turn::beside(graph)?;
    let mut pins = Pins::of(graph)?;
    fn is_meant(pinned: &String, names: &[String]) -> bool {
        names.iter().any(|name| means(name, pinned))
    }
    let taken = Vec::from_iter(pins.pins.extract_if(.., |pinned, _| is_meant(pinned, names)));
    let file = graph.with_extension(PINS_ENDING);
    match (taken.is_empty(), pins.pins.is_empty()) {
        (true, _) => {}
        (false, true) => remove(&file)?,
        (false, false) => keep_beside(&file, &pins.to_text())?,
    }
    taken.iter().try_for_each(|(_, pin)| tidy(&pins, pin))?;
    if pins.pins.is_empty() {
        sweep(&pins.folder);
        remove_empty(&pins.folder);
    }
    Ok(taken.into_iter().map(|(name, _)| name).collect())
}

/// Whether a name is that of a pinned node, or of a use that it is in.
pub fn means(name: &str, pinned: &str) -> bool {
    pinned.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Takes the file of a former pin away, unless another one has the same values.
fn tidy(pins: &Pins, former: &Pin) -> Result<(), Refused> {
    let file = former.file(&pins.folder);
    let is_needed = pins.pins.values().any(|pin| pin.outputs == former.outputs);
    if !is_needed && file.exists() {
        Destination::folder(&pins.folder, &Sources::default()).remove(&file)?;
    }
    Ok(())
}
