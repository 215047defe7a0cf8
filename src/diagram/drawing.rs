//! What is drawn of a graph.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use maquette_graph::catalog::Catalog;
use maquette_graph::{DraftField, ELEMENTS, Graph, GraphUse};
use maquette_syntax::error::Source;

/// What is drawn of a graph, without places.
#[derive(Clone, Debug, Default)]
pub struct Drawing {
    /// What the graph is for.
    pub doc: String,
    /// The packs of its nodes, in the program's order.
    pub packs: Vec<Pack>,
    /// Nodes, each after those that it hangs on, then output files.
    pub boxes: Vec<Block>,
    pub wires: Vec<Wire>,
}

/// A pack that nodes come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pack {
    pub name: String,
    /// Its place among all packs of the program: what chooses its color, in every graph the same.
    pub place: usize,
}

/// A node or an output file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    pub name: String,
    /// None for an output file.
    pub node: Option<NodeBlock>,
    /// The linked ports.
    pub inputs: Vec<String>,
    pub outputs: Vec<Port>,
    /// The file in which it stands, and at which byte.
    pub(crate) at: Option<(Arc<Source>, usize)>,
    /// What of its fields is a `Draft`.
    pub(crate) drafts: Vec<DraftField>,
}

/// What only a node has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeBlock {
    pub kind: String,
    /// Index of its pack among those of the drawing.
    pub pack: usize,
}

/// An output of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    pub name: String,
    /// The name of its type.
    pub kind: String,
}

/// A link from an output of one box to an input of another one, by their indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wire {
    pub from: [usize; 2],
    pub to: [usize; 2],
}

/// The graph as an SVG picture: boxes for nodes and output files, links with the types that they carry.
pub fn to_svg(graph: &Graph, catalog: &Catalog) -> String {
    Drawing::new(graph, catalog).to_svg()
}

impl Drawing {
    /// What is drawn of `graph`.
    pub fn new(graph: &Graph, catalog: &Catalog) -> Self {
        let mut drawing = Self { doc: graph.doc().to_owned(), ..Self::default() };
        let mut places: Vec<(usize, &str)> = Vec::new();
        for entry in catalog.entries() {
            if places.last().is_none_or(|(_, name)| *name != entry.pack) {
                places.push((places.len(), entry.pack));
            }
        }
        let pack_of = |kind: &str| catalog.find(kind).map_or("", |entry| entry.pack);
        let boxes = boxes(graph);
        let kinds = boxes.iter().map(|part| match part {
            BoxContent::Node(index) => pack_of(graph.nodes()[*index].kind()),
            BoxContent::Use(..) => GRAPHS,
        });
        let kinds = Vec::from_iter(kinds);
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
                BoxContent::Use(given, _) => linked(graph, given),
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
            let (name, kind, outputs) = described(graph, part);
            let node = Some(NodeBlock { kind, pack: pack.unwrap_or_default() });
            let at = Some(place(graph, part));
            // An element of a list has those of the `ForEach`.
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

    /// Whether some link begins at an output.
    pub fn is_linked(&self, output: [usize; 2]) -> bool {
        self.wires.iter().any(|wire| wire.from == output)
    }
}

/// The elements of a `ForEach` over data are drawn one by one, unless there are more than these.
pub(crate) const MOST_ELEMENTS: usize = 50;

/// What graphs that are used are listed as, beside packs.
pub(crate) const GRAPHS: &str = "graphs";

/// What one box of the drawing stands for: a node, or the use of a graph with all that is in it.
pub enum BoxContent<'g> {
    Node(usize),
    /// With the index of its first node.
    Use(&'g GraphUse, usize),
}

/// The boxes of a graph: its own nodes and uses, each where the first of its nodes stands. A `ForEach` over data is one box if its
/// elements are not known, or are very many.
pub(crate) fn boxes(graph: &Graph) -> Vec<BoxContent<'_>> {
    let is_whole = |given: &&GraphUse| match &given.kind[..] {
        "Switch" => false,
        kind if kind.starts_with("ForEach(") => {
            given.is_open || elements(graph, given).is_some_and(|count| count > MOST_ELEMENTS)
        }
        _ => true,
    };
    let mut uses: HashMap<&str, &GraphUse> = HashMap::new();
    uses.extend(graph.uses().iter().filter(is_whole).map(|given| (&given.name[..], given)));
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

/// The linked ports of a use with what they are linked to. The elements of a `ForEach` over data are taken apart inside of its box: their
/// port is linked to the data.
pub(crate) fn linked<'g>(graph: &'g Graph, given: &'g GraphUse) -> Vec<(&'g str, (usize, usize))> {
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

/// How many elements a `ForEach` over data has.
pub(crate) fn elements(graph: &Graph, given: &GraphUse) -> Option<usize> {
    let found = graph.loops().iter().find(|it| it.name == given.name && !it.is_open)?;
    Some(graph.nodes()[found.node].outputs.len())
}

/// Whether a node takes the data of a `ForEach` apart: its outputs are drawn as one.
pub(crate) fn is_apart(graph: &Graph, node: usize) -> bool {
    graph.nodes()[node].kind() == ELEMENTS
}

/// For each value that boxes give, by its node and output: the box and the place among its outputs.
pub(crate) fn sources(
    graph: &Graph,
    boxes: &[BoxContent<'_>],
) -> HashMap<(usize, usize), [usize; 2]> {
    let mut sources = HashMap::new();
    for (index, part) in boxes.iter().enumerate() {
        match part {
            BoxContent::Node(node) => {
                let outputs = 0..graph.nodes()[*node].outputs.len();
                fn drawn(output: usize, graph: &Graph, node: usize) -> usize {
                    if is_apart(graph, node) { 0 } else { output }
                }
                sources.extend(
                    outputs.map(|output| ((*node, output), [index, drawn(output, graph, *node)])),
                );
            }
            BoxContent::Use(given, _) => {
                for (output, (_, targets)) in given.outputs.iter().enumerate() {
                    // What only goes through comes from where it was made.
                    for target in targets {
                        sources.entry(*target).or_insert([index, output]);
                    }
                }
            }
        }
    }
    sources
}

/// The file in which a box stands, and at which byte.
pub(crate) fn place(graph: &Graph, part: &BoxContent<'_>) -> (Arc<Source>, usize) {
    let (BoxContent::Node(index) | BoxContent::Use(_, index)) = part;
    let node = &graph.nodes()[*index];
    if let (BoxContent::Use(..), Some(outermost)) = (part, node.uses.first()) {
        return (outermost.source.clone(), outermost.span.start);
    }
    let (source, span) = node.sheet.place(node.span);
    (source, span.start)
}

/// The name, type and outputs of a box.
pub(crate) fn described(graph: &Graph, part: &BoxContent<'_>) -> (String, String, Vec<Port>) {
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

    /// A scan of two outputs that a mask, a mesh and three files come from; texts that need escapes.
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
