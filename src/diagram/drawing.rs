//! The content of a diagram of a graph, without positions.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::{DraftField, ELEMENTS, Graph, GraphUse};
use maquette_syntax::error::Source;

/// The content of a diagram, without positions.
#[derive(Clone, Debug, Default)]
pub struct Drawing {
    /// The description of the graph by its author.
    pub doc: String,
    /// The packs of the nodes, in the order in which the program registers them.
    pub packs: Vec<Pack>,
    /// The boxes of the nodes, each after its dependencies, then the boxes of the output files.
    pub boxes: Vec<Block>,
    pub wires: Vec<Wire>,
}

/// A pack that contains nodes of the drawing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pack {
    pub name: String,
    /// The index of the pack among all packs of the program. It determines the pack's color, which is therefore the same in all diagrams.
    pub place: usize,
}

/// A box of the diagram, which represents a node or an output file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    pub name: String,
    /// The data of the node. `None` for an output file.
    pub node: Option<NodeBlock>,
    /// The names of the input ports that have a link.
    pub inputs: Vec<String>,
    pub outputs: Vec<Port>,
    /// The file that contains the node, and the byte offset of the node in that file.
    pub(crate) at: Option<(Arc<Source>, usize)>,
    /// The fields of the node whose value is a `Draft`.
    pub(crate) drafts: Vec<DraftField>,
}

/// The data that only a box of a node has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeBlock {
    pub kind: String,
    /// The index of the node's pack in `Drawing::packs`.
    pub pack: usize,
}

/// An output of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    pub name: String,
    /// The name of the output's value type.
    pub kind: String,
}

/// A link from an output of one box to an input of another. Each end is [box index, port index].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wire {
    pub from: [usize; 2],
    pub to: [usize; 2],
}

/// Returns the diagram of a graph as SVG: boxes for nodes and output files, links with their types.
pub fn to_svg(graph: &Graph, catalog: &Catalog) -> String {
    Drawing::new(graph, catalog).to_svg()
}

impl Drawing {
    /// Creates the drawing of a graph.
    pub fn new(graph: &Graph, catalog: &Catalog) -> Self {
        let mut drawing = Self { doc: graph.doc().to_owned(), ..Self::default() };
        let mut places: Vec<(usize, &str)> = Vec::new();
        for entry in catalog.entries() {
            if places.last().is_none_or(|(_, name)| *name != entry.pack) {
                places.push((places.len(), entry.pack));
            }
        }
        let boxes = boxes(graph);
        let kinds = boxes.iter().map(|part| match part {
            BoxContent::Node(index) => {
                catalog.find(graph.nodes()[*index].kind()).map_or("", |entry| entry.pack)
            }
            BoxContent::Use(..) => GRAPHS,
        });
        let kinds = kinds.collect::<Vec<_>>();
        places.push((places.len(), GRAPHS));
        let packs = places.into_iter().filter(|(_, name)| kinds.contains(name));
        drawing.packs = packs.map(|(place, name)| Pack { name: name.to_owned(), place }).collect();
        let (sources, drafts) = (sources(graph, &boxes), graph.draft_fields());
        for (index, (part, pack)) in boxes.iter().zip(&kinds).enumerate() {
            let pack = drawing.packs.iter().position(|known| known.name == **pack);
            let links: Vec<(&str, (usize, usize))> = match part {
                BoxContent::Node(node) => {
                    let links = graph.nodes()[*node].links.iter();
                    links.map(|link| (&link.port[..], (link.node, link.output))).collect()
                }
                BoxContent::Use(given, _) => linked_ports(graph, given),
            };
            let mut inputs: Vec<String> = Vec::new();
            for (port, target) in links {
                if inputs.last().is_none_or(|last| last != port) {
                    inputs.push(port.to_owned());
                }
                let from = sources.get(&target).copied();
                let to = [index, inputs.len() - 1];
                drawing.wires.extend(from.map(|from| Wire { from, to }));
            }
            let (name, kind, outputs) = describe_box(graph, part);
            let node = Some(NodeBlock { kind, pack: pack.unwrap_or_default() });
            let at = Some(place(graph, part));
            // The box of one element of a `ForEach` over a list, such as `copies/1`, gets the draft fields of the whole `ForEach`, here
            // `copies`.
            let drafts = drafts.get(name.split('/').next().unwrap_or_default());
            let drafts = drafts.cloned().unwrap_or_default();
            drawing.boxes.push(Block { name, node, inputs, outputs, at, drafts });
        }
        for output in graph.outputs() {
            let to = [drawing.boxes.len(), 0];
            let from = sources.get(&(output.node, output.output)).copied();
            drawing.wires.extend(from.map(|from| Wire { from, to }));
            drawing.boxes.push(Block {
                name: output.name.clone(),
                node: None,
                inputs: vec![String::new()],
                outputs: Vec::new(),
                drafts: Vec::new(),
                at: Some((output.source.clone(), output.span.start)),
            });
        }
        drawing
    }

    /// Returns true if an output has a link. `output` is [box index, port index].
    pub fn is_linked(&self, output: [usize; 2]) -> bool {
        self.wires.iter().any(|wire| wire.from == output)
    }
}

/// Maximum number of elements for which a `ForEach` over data is drawn with one box per element.
pub(crate) const MAX_ELEMENTS: usize = 50;

/// The name under which the list of packs contains all graphs that are used as nodes.
pub(crate) const GRAPHS: &str = "graphs";

/// The content of a box: a node, or a used graph with all its nodes.
pub enum BoxContent<'g> {
    Node(usize),
    /// A node of the graph file that stands for several nodes of the graph, such as a used graph. The number is the index of the first of
    /// these nodes.
    Use(&'g GraphUse, usize),
}

/// Returns the boxes of a graph: one for each node, and one for each used graph, at the position of its first node. A `ForEach` over data
/// is drawn as one box if the number of its elements is unknown or greater than [`MAX_ELEMENTS`].
pub(crate) fn boxes(graph: &Graph) -> Vec<BoxContent<'_>> {
    let mut uses: HashMap<&str, &GraphUse> = HashMap::new();
    for given in graph.uses().iter() {
        let is_one_box = match &given.kind[..] {
            "Switch" => false,
            kind if kind.starts_with("ForEach(") => {
                given.is_open || elements(graph, given).is_some_and(|count| count > MAX_ELEMENTS)
            }
            _ => true,
        };
        if is_one_box {
            uses.insert(&given.name, given);
        }
    }
    let mut boxes: Vec<BoxContent<'_>> = Vec::new();
    let mut begun: HashSet<&str> = HashSet::new();
    for (index, node) in graph.nodes().iter().enumerate() {
        let ends = node.name.match_indices('/').map(|(at, _)| at);
        match ends.filter_map(|at| uses.get(&node.name[..at]).copied()).next() {
            Some(given) if !begun.insert(&given.name) => {}
            Some(given) => boxes.push(BoxContent::Use(given, index)),
            None => boxes.push(BoxContent::Node(index)),
        }
    }
    boxes
}

/// Returns the linked ports of a box with several nodes, and the targets of their links. For a `ForEach` over data, the node that splits
/// the data into elements is inside of the box, so the port is linked to the data itself.
pub(crate) fn linked_ports<'g>(
    graph: &'g Graph,
    given: &'g GraphUse,
) -> Vec<(&'g str, (usize, usize))> {
    let apart = graph.loops().iter().find(|it| it.name == given.name).map(|it| it.node);
    let data = apart.and_then(|node| graph.nodes()[node].links.first());
    let mut links = Vec::with_capacity(given.inputs.len() + 1);
    for (port, target) in &given.inputs {
        if Some(target.0) != apart {
            links.push((&port[..], *target));
        }
    }
    if let (Some(node), Some(data)) = (apart, data) {
        let port = graph.nodes()[node].name.rsplit('/').next().unwrap_or_default();
        links.insert(0, (port, (data.node, data.output)));
    }
    links
}

/// Returns the number of elements of a `ForEach` over data. `None` if it is unknown before the evaluation.
pub(crate) fn elements(graph: &Graph, given: &GraphUse) -> Option<usize> {
    let found = graph.loops().iter().find(|it| it.name == given.name && !it.is_open)?;
    Some(graph.nodes()[found.node].outputs.len())
}

/// Returns true if the node splits the data of a `ForEach` into elements. Its outputs are drawn as a single output.
pub(crate) fn is_apart(graph: &Graph, node: usize) -> bool {
    graph.nodes()[node].kind() == ELEMENTS
}

/// Maps each value (node, output) to the output that represents it in the drawing: the index of a box, and the index of an output of the
/// box.
pub(crate) fn sources(
    graph: &Graph,
    boxes: &[BoxContent<'_>],
) -> HashMap<(usize, usize), [usize; 2]> {
    let mut sources = HashMap::new();
    for (index, part) in boxes.iter().enumerate() {
        match part {
            BoxContent::Node(node) => {
                for output in 0..graph.nodes()[*node].outputs.len() {
                    let drawn = if is_apart(graph, *node) { 0 } else { output };
                    sources.insert((*node, output), [index, drawn]);
                }
            }
            BoxContent::Use(given, _) => {
                for (output, (_, targets)) in given.outputs.iter().enumerate() {
                    // A used graph may return one of its inputs unchanged. Then draw links to this output from the box that computes the
                    // value of the input.
                    for target in targets {
                        sources.entry(*target).or_insert([index, output]);
                    }
                }
            }
        }
    }
    sources
}

/// Returns the file that contains the node of a box, and the byte offset of the node in that file.
pub(crate) fn place(graph: &Graph, part: &BoxContent<'_>) -> (Arc<Source>, usize) {
    let (BoxContent::Node(index) | BoxContent::Use(_, index)) = part;
    let node = &graph.nodes()[*index];
    if let (BoxContent::Use(..), Some(outermost)) = (part, node.uses.first()) {
        return (outermost.source.clone(), outermost.span.start);
    }
    let (source, span) = node.source_map.locate(node.span);
    (source, span.start)
}

/// Returns the name, type and outputs of a box.
pub(crate) fn describe_box(graph: &Graph, part: &BoxContent<'_>) -> (String, String, Vec<Port>) {
    fn kind_of(node: usize, output: usize, graph: &Graph) -> String {
        let kind = graph.nodes()[node].types.get(output).copied().flatten();
        kind.map_or_else(String::new, |kind| kind.name.to_owned())
    }
    match part {
        BoxContent::Node(index) => {
            let node = &graph.nodes()[*index];
            let outputs = node.outputs.iter().enumerate();
            let drawn = if is_apart(graph, *index) { 1 } else { usize::MAX };
            (
                node.name.clone(),
                node.kind().to_owned(),
                outputs
                    .take(drawn)
                    .map(|(output, name)| Port {
                        name: (*name).to_owned(),
                        kind: kind_of(*index, output, graph),
                    })
                    .collect(),
            )
        }
        BoxContent::Use(given, _) => {
            let outputs = given
                .outputs
                .iter()
                .map(|(name, targets)| Port {
                    name: name.clone(),
                    kind: targets
                        .first()
                        .map_or_else(String::new, |&(node, at)| kind_of(node, at, graph)),
                })
                .collect();
            let kind = match elements(graph, given) {
                Some(count) => format!("{} of {count} elements", given.kind),
                None if given.is_open => format!("{} of ? elements", given.kind),
                None => given.kind.clone(),
            };
            (given.name.clone(), kind, outputs)
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Returns the drawing of a graph for tests: a scan with two outputs, a mask, a mesh and three files. Some names need escapes.
    pub(crate) fn scan() -> Drawing {
        fn block(
            name: &str,
            kind: &str,
            pack: usize,
            inputs: &[&str],
            outputs: &[[&str; 2]],
        ) -> Block {
            Block {
                name: name.into(),
                node: (!kind.is_empty()).then(|| NodeBlock { kind: kind.into(), pack }),
                inputs: inputs.iter().map(|&name| name.into()).collect(),
                outputs: outputs
                    .iter()
                    .map(|[name, kind]| Port { name: (*name).into(), kind: (*kind).into() })
                    .collect(),
                at: None,
                drafts: Vec::new(),
            }
        }
        fn wire(from: [usize; 2], to: [usize; 2]) -> Wire {
            Wire { from, to }
        }
        Drawing {
            doc: "Finds \"red\" & more\u{7}.".into(),
            packs: ["image", "range"]
                .into_iter()
                .enumerate()
                .map(|(place, name)| Pack { name: name.into(), place })
                .collect(),
            boxes: vec![
                block(
                    "scan",
                    "ReadCapture",
                    1,
                    &[],
                    &[["color", "Image"], ["range", "RangeImage"]],
                ),
                block("red", "Threshold", 0, &["image"], &[["mask", "Mask"]]),
                block("grid", "Triangulate", 1, &["range", "within"], &[["mesh", "Mesh"]]),
                block("a<b>\"c\\d.png", "", 0, &[""], &[]),
                block("grid.ply", "", 0, &[""], &[]),
            ],
            wires: vec![
                wire([0, 0], [1, 0]),
                wire([0, 1], [2, 0]),
                wire([1, 0], [2, 1]),
                wire([1, 0], [3, 0]),
                wire([2, 0], [4, 0]),
            ],
        }
    }
}
