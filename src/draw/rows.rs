//! Places for boxes that others draw, with a row for each of their parts.

use super::layout::{End, Link, Node, layout};

/// A box of rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowBox {
    /// How many rows it has below its title.
    pub(crate) rows: usize,
    /// Whether it stands in the last column.
    pub(crate) last: bool,
}

/// The height of a row.
const ROW: f64 = 22.0;

/// The height of a title, in rows.
const TITLE: f64 = 1.5;

/// The column of each box, and how many rows below the highest one its top is. Boxes stand before those that are linked to them; a link goes
/// from a row of a box to a row of another one.
pub(crate) fn placed(boxes: &[RowBox], links: &[[(usize, usize); 2]]) -> Vec<(usize, f64)> {
    let node = |it: &RowBox| Node { height: ROW * (it.rows as f64 + TITLE), last: it.last };
    let end = |(node, row): (usize, usize)| {
        let below = ROW * (row as f64 + 0.5 + TITLE);
        End { node, port: row, below }
    };
    let links = links.iter().map(|&[from, to]| Link { from: end(from), to: end(to) });
    let layout = layout(&Vec::from_iter(boxes.iter().map(node)), &Vec::from_iter(links));
    let slots = layout.slots[..boxes.len()].iter();
    slots.map(|slot| (slot.column, slot.top / ROW)).collect()
}
