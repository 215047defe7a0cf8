//! A graph as a picture: boxes for nodes and output files, links with the types that they carry.

use crate::catalog::Catalog;
use crate::graph::Graph;

mod dot;
mod layout;
mod svg;

/// What is drawn of a graph, without places.
#[derive(Clone, Debug, Default)]
pub(crate) struct Drawing {
    /// What the graph is for.
    doc: String,
    /// The packs of its nodes, in the program's order.
    packs: Vec<Pack>,
    /// Nodes, each after those that it hangs on, then output files.
    boxes: Vec<Block>,
    wires: Vec<Wire>,
}

/// A pack that nodes come from.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Pack {
    name: String,
    /// Its place among all packs of the program: what chooses its color, in every graph the same.
    place: usize,
}

/// A node or an output file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Block {
    name: String,
    /// None for an output file.
    node: Option<NodeBlock>,
    /// The linked ports.
    inputs: Vec<String>,
    outputs: Vec<Port>,
}

/// What only a node has.
#[derive(Clone, Debug, PartialEq, Eq)]
struct NodeBlock {
    kind: String,
    /// Index of its pack among those of the drawing.
    pack: usize,
}

/// An output of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Port {
    name: String,
    /// The name of its type.
    kind: String,
}

/// A link from an output of one box to an input of another one, by their indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Wire {
    from: [usize; 2],
    to: [usize; 2],
}

impl Drawing {
    /// What is drawn of `graph`.
    pub(crate) fn new(graph: &Graph, catalog: &Catalog) -> Self {
        let mut drawing = Self { doc: graph.doc.clone(), ..Self::default() };
        let mut places: Vec<(usize, &str)> = Vec::new();
        for entry in catalog.entries() {
            if places.last().is_none_or(|(_, name)| *name != entry.pack) {
                places.push((places.len(), entry.pack));
            }
        }
        let pack_of = |kind: &str| catalog.find(kind).map_or("", |entry| entry.pack);
        let used = |name: &str| graph.nodes.iter().any(|node| pack_of(node.kind()) == name);
        let packs = places.into_iter().filter(|(_, name)| used(name));
        drawing.packs = packs.map(|(place, name)| Pack { name: name.to_owned(), place }).collect();
        for (index, node) in graph.nodes.iter().enumerate() {
            let pack = drawing.packs.iter().position(|pack| pack.name == pack_of(node.kind()));
            let mut inputs: Vec<String> = Vec::new();
            for link in &node.links {
                if inputs.last() != Some(&link.port) {
                    inputs.push(link.port.clone());
                }
                let wire = Wire { from: [link.node, link.output], to: [index, inputs.len() - 1] };
                drawing.wires.push(wire);
            }
            let outputs = node.outputs.iter().zip(&node.types).map(|(name, kind)| Port {
                name: (*name).to_owned(),
                kind: kind.map_or_else(String::new, |kind| kind.name.to_owned()),
            });
            drawing.boxes.push(Block {
                name: node.name.clone(),
                node: Some(NodeBlock {
                    kind: node.kind().to_owned(),
                    pack: pack.unwrap_or_default(),
                }),
                inputs,
                outputs: outputs.collect(),
            });
        }
        for output in &graph.outputs {
            let wire = Wire { from: [output.node, output.output], to: [drawing.boxes.len(), 0] };
            drawing.wires.push(wire);
            drawing.boxes.push(Block {
                name: output.name.clone(),
                node: None,
                inputs: vec![String::new()],
                outputs: Vec::new(),
            });
        }
        drawing
    }

    /// Whether some link begins at an output.
    fn is_linked(&self, output: [usize; 2]) -> bool {
        self.wires.iter().any(|wire| wire.from == output)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scan of two outputs that a mask, a mesh and three files come from; texts that need escapes.
    pub(super) fn scan() -> Drawing {
        let block = |name: &str, kind: &str, pack, inputs: &[&str], outputs: &[[&str; 2]]| Block {
            name: name.into(),
            node: (!kind.is_empty()).then(|| NodeBlock { kind: kind.into(), pack }),
            inputs: inputs.iter().map(|&name| name.into()).collect(),
            outputs: outputs
                .iter()
                .map(|[name, kind]| Port { name: (*name).into(), kind: (*kind).into() })
                .collect(),
        };
        let wire = |from, to| Wire { from, to };
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
