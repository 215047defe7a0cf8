//! Places for the boxes of an outline, whose programs draw them with a row for each part.

use std::collections::HashMap;

use serde::Serialize;

use super::layout::{End, Layout, Link, Node, layout};
use super::{Outline, OutlineNode, Target};

/// Where boxes may stand: column from the left, and rows below the highest one.
///
/// A box has a title as high as one and a half rows, then a row for each of its outputs, ports and other fields. All inputs are one box, and
/// all outputs of the graph.
#[derive(Debug, Default, Serialize)]
pub struct Places {
    pub(crate) inputs: (usize, f64),
    /// In the order of the nodes.
    pub(crate) nodes: Vec<(usize, f64)>,
    pub(crate) outputs: (usize, f64),
}

/// The height of a row.
const ROW: f64 = 22.0;

/// The height of a title, in rows.
const TITLE: f64 = 1.5;

/// A row of a box: the box's place in the list of all, and the row.
type Row = (usize, usize);

impl Places {
    /// Places for the boxes of an outline.
    pub fn of(outline: &Outline) -> Self {
        let Outline { inputs, nodes, outputs, order, .. } = outline;
        let mut boxes = vec![boxed(inputs.len(), false)];
        let mut places = HashMap::new();
        for &node in order {
            places.insert(&nodes[node].entry.name[..], (boxes.len(), node));
            boxes.push(boxed(rows(&nodes[node]), false));
        }
        let last = boxes.len();
        boxes.push(boxed(outputs.len(), true));
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
        // A circle, which is a mistake, is drawn without one of its links.
        links.retain(|[(from, _), (to, _)]| from < to);
        let links = links.iter().map(|&[from, to]| Link { from: end(from), to: end(to) });
        let layout = layout(&boxes, &Vec::from_iter(links));
        let mut found = vec![(0, 0.0); nodes.len()];
        for (place, &node) in order.iter().enumerate() {
            found[node] = at(&layout, place + 1);
        }
        Self { inputs: at(&layout, 0), nodes: found, outputs: at(&layout, last) }
    }
}

fn boxed(rows: usize, last: bool) -> Node {
    Node { height: ROW * (rows as f64 + TITLE), last }
}

fn rows(node: &OutlineNode) -> usize {
    fn is_port(field: &str, node_ports: &[String]) -> bool {
        node_ports.iter().any(|port| port == field)
    }
    let fields = node.fields.iter().filter(|(field, _)| !is_port(field, &node.ports));
    node.outputs.len() + node.ports.len() + fields.count()
}

fn end((node, port): Row) -> End {
    End { node, port, below: ROW * (port as f64 + 0.5 + TITLE) }
}

fn at(layout: &Layout, place: usize) -> (usize, f64) {
    let slot = layout.slots[place];
    (slot.column, slot.top / ROW)
}
