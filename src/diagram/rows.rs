//! Positions for the boxes of an outline, for programs that draw each box as a stack of rows, one row per port or field.

use std::collections::HashMap;

use serde::Serialize;

use super::layout::{Layout, Link, LinkEnd, Node, layout};
use super::{Outline, OutlineNode, Target};

/// Proposed positions of boxes. Each position is the index of the column, from the left, and the distance from the top in rows.
///
/// A box has a title of one and a half rows, and one row for each output, port and other field. All inputs of the graph form one box, and
/// all outputs form another.
#[derive(Debug, Default, Serialize)]
pub struct RowPositions {
    pub(crate) inputs: (usize, f64),
    /// The positions of the nodes, in the order of the outline.
    pub(crate) nodes: Vec<(usize, f64)>,
    pub(crate) outputs: (usize, f64),
}

/// Height of a row, in the units of the module `layout`.
const ROW: f64 = 22.0;

/// Height of the title of a box, in rows.
const TITLE: f64 = 1.5;

/// A row of a box: the index of the box, and the index of the row in the box.
type Row = (usize, usize);

impl RowPositions {
    /// Computes positions for the boxes of an outline.
    pub fn from_outline(outline: &Outline) -> Self {
        let Outline { inputs, nodes, outputs, order, .. } = outline;
        let mut boxes = vec![layout_node(inputs.len(), false)];
        let mut places = HashMap::new();
        for &node in order {
            places.insert(&nodes[node].entry.name[..], (boxes.len(), node));
            boxes.push(layout_node(rows(&nodes[node]), false));
        }
        let last = boxes.len();
        boxes.push(layout_node(outputs.len(), true));
        let source = |target: &Target| -> Option<Row> {
            if let Some(input) = inputs.iter().position(|input| input.name == target.node) {
                return Some((0, input));
            }
            let &(place, node) = places.get(&target.node[..])?;
            let output = nodes[node].outputs.iter().position(|it| it.name == target.output)?;
            Some((place, output))
        };
        let mut links: Vec<[Row; 2]> = Vec::new();
        for &node in order {
            let OutlineNode { entry, links: own, ports, outputs, .. } = &nodes[node];
            let (place, _) = places[&entry.name[..]];
            for link in own {
                let port = link.port.split('.').next();
                let row = ports.iter().position(|it| Some(&it[..]) == port).unwrap_or_default();
                let to = (place, outputs.len() + row);
                links.extend(source(&link.target).map(|from| [from, to]));
            }
        }
        for (row, given) in outputs.iter().enumerate() {
            let from = given.link.as_ref().and_then(source);
            links.extend(from.map(|from| [from, (last, row)]));
        }
        // A cycle of links is an error in the graph. Draw it without the links that lead backwards.
        links.retain(|[(from, _), (to, _)]| from < to);
        let links = links.iter().map(|&[from, to]| Link { from: end(from), to: end(to) });
        let layout = layout(&boxes, &Vec::from_iter(links));
        let mut found = vec![(0, 0.0); nodes.len()];
        for (place, &node) in order.iter().enumerate() {
            found[node] = box_position(&layout, place + 1);
        }
        Self {
            inputs: box_position(&layout, 0),
            nodes: found,
            outputs: box_position(&layout, last),
        }
    }
}

fn layout_node(rows: usize, last: bool) -> Node {
    Node { height: ROW * (rows as f64 + TITLE), is_last: last }
}

fn rows(node: &OutlineNode) -> usize {
    fn is_port(field: &str, node_ports: &[String]) -> bool {
        node_ports.iter().any(|port| port == field)
    }
    let fields = node.fields.iter().filter(|(field, _)| !is_port(field, &node.ports));
    node.outputs.len() + node.ports.len() + fields.count()
}

fn end((node, port): Row) -> LinkEnd {
    LinkEnd { node, port, below: ROW * (port as f64 + 0.5 + TITLE) }
}

fn box_position(layout: &Layout, place: usize) -> (usize, f64) {
    let slot = layout.slots[place];
    (slot.column, slot.top / ROW)
}
