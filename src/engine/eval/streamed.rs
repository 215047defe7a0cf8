//! Finds the nodes whose points are streamed: computed block by block, without keeping them.

use maquette_graph::Graph;
use maquette_graph::files::NodeFile;
use maquette_node::Blocks;
use maquette_node::importers::ReadBlocks;
use maquette_value::fs::extension;

/// When and how files are read in blocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockOptions {
    /// Smaller files are read as a whole: their points stay in memory, so that later evaluations are fast.
    pub(super) min_file_size: u64,
    /// The number of points in a block.
    pub(super) block_len: usize,
}

impl Default for BlockOptions {
    fn default() -> Self {
        Self { min_file_size: 64 << 20, block_len: 1 << 16 }
    }
}

/// Returns true for each node whose points are streamed. The list is empty if there are none. `wanted` is true for each node that the
/// evaluation needs, and `values` are the nodes whose values are requested.
pub(super) fn streamed_nodes(
    graph: &Graph,
    wanted: &[bool],
    values: &[usize],
    options: BlockOptions,
) -> Vec<bool> {
    let mut streamed = Vec::new();
    for (index, node) in graph.nodes().iter().enumerate() {
        if !wanted[index] || node.node.blocks() != Blocks::Each {
            continue;
        }
        let has_source = if node.links.is_empty() {
            matches!(&node.files[..], [file] if is_large(graph, file, options.min_file_size))
        } else {
            streamed_slot(graph, &streamed, index).is_some()
        };
        let mut users = graph.topology().users(index).filter(|&user| wanted[user]).peekable();
        let is_needed_in_blocks =
            users.peek().is_some() && users.all(|user| takes_blocks(graph, user));
        if has_source && is_needed_in_blocks && !values.contains(&index) {
            streamed.resize(wanted.len(), false);
            streamed[index] = true;
        }
    }
    streamed
}

/// Returns true if the file can be read in blocks and has at least `min_size` bytes.
fn is_large(graph: &Graph, file: &NodeFile, min_size: u64) -> bool {
    let metadata = read_blocks_of(graph, file).and_then(|_| std::fs::metadata(&file.path).ok());
    metadata.is_some_and(|metadata| min_size <= metadata.len())
}

/// Returns the function that reads the file in blocks, if there is one. Files with companions are read as a whole.
pub(super) fn read_blocks_of(graph: &Graph, file: &NodeFile) -> Option<ReadBlocks> {
    let extension = extension(&file.path);
    let read = graph.readers().read_blocks(&extension);
    read.filter(|_| !graph.readers().may_name(&extension))
}

/// Returns true if the node takes the points at its first link in blocks.
fn takes_blocks(graph: &Graph, index: usize) -> bool {
    let node = &graph.nodes()[index];
    node.node.blocks() != Blocks::Whole && node.guards.is_empty() && node.files.is_empty()
}

/// Returns the slot of the only link to a streamed node, if the node takes blocks.
pub(super) fn streamed_slot(graph: &Graph, streamed: &[bool], index: usize) -> Option<usize> {
    let links = graph.nodes()[index].links.iter();
    let mut slots = links
        .enumerate()
        .filter(|(_, link)| streamed.get(link.node) == Some(&true))
        .map(|(slot, _)| slot);
    slots.next().filter(|_| slots.next().is_none() && takes_blocks(graph, index))
}
