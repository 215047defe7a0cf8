//! Layout of boxes and links in columns from left to right, with few crossings and straight links.
//!
//! Columns and order: Sugiyama, Tagawa and Toda, "Methods for visual understanding of hierarchical system structures" (1981). The column of
//! a node is the length of the longest path to it. The order in a column follows the mean positions of the neighbors, and is improved by
//! several sweeps over the columns. A link over several columns has a *slot* in each column that it crosses, so that it never runs below a
//! box. Links of one output share their slots.
//!
//! Vertical positions: each slot is placed as near to the positions of its neighbors as the order allows. This is an isotonic regression,
//! solved exactly by pooling adjacent violators (Ayer, Brunk, Ewing, Reid and Silverman, "An empirical distribution function for sampling
//! with incomplete information" (1955)), with the weights of Gansner, Koutsofios, North and Vo, "A technique for drawing directed graphs"
//! (1993), section 4.
//!
//! Guarantees: the boxes and slots of a column do not overlap, and the layout of a graph is deterministic. The number of crossings is not
//! guaranteed to be minimal, because finding the minimum is NP-hard.

use std::collections::BTreeMap;

use petgraph::Incoming;
use petgraph::algo::toposort;
use petgraph::graph::{DiGraph, NodeIndex};

/// A box for which the layout computes a position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    pub(super) height: f64,
    /// True if the box must be in the last column, such as the box of an output file.
    pub(super) is_last: bool,
}

/// One end of a link: a port of a box.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkEnd {
    pub(super) node: usize,
    pub(super) port: usize,
    /// Distance from the top of the box down to the port.
    pub(super) below: f64,
}

/// A link between two boxes. The source comes before the target in the list of boxes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    pub(super) from: LinkEnd,
    pub(super) to: LinkEnd,
}

/// A vertical interval in a column: a box, or a passage through which links cross the column.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    pub(super) column: usize,
    pub(super) top: f64,
    height: f64,
    /// The index of the box. `None` for a passage.
    pub(super) node: Option<usize>,
}

/// The part of a link between two adjacent columns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub(super) from: usize,
    from_below: f64,
    pub(super) to: usize,
    to_below: f64,
    /// The source of the link as [box index, port index].
    pub(super) source: [usize; 2],
}

/// The result of the layout. The first slots are those of the boxes, in the order of the boxes; passages follow.
#[derive(Clone, Debug, Default)]
pub(super) struct Layout {
    pub(super) slots: Vec<Slot>,
    pub(super) segments: Vec<Segment>,
    pub(super) columns: usize,
    pub(super) height: f64,
}

/// Minimum vertical distance between two slots of a column.
const GAP: f64 = 18.0;

/// Height of a passage, through which links cross a column.
const PASSAGE: f64 = 4.0;

/// Number of sweeps that reorder the slots, alternately from left to right and back. The order with the fewest crossings is used.
const ORDER_SWEEPS: usize = 12;

/// Number of sweeps that align the slots vertically, alternately from left to right and back. In each sweep, a position is propagated by
/// one column along a long link.
const ALIGN_SWEEPS: usize = 48;

/// Computes the layout of `nodes`. Each node precedes the nodes that depend on it.
pub(super) fn layout(nodes: &[Node], links: &[Link]) -> Layout {
    let mut layout = Layout::default();
    let columns = columns(nodes, links);
    layout.columns = columns.iter().max().map_or(0, |last| last + 1);
    layout.slots = columns
        .iter()
        .enumerate()
        .map(|(node, &column)| Slot {
            column,
            top: 0.0,
            height: nodes[node].height,
            node: Some(node),
        })
        .collect();
    layout.route_links(links);
    let mut order = Order::new(&layout);
    order.sweep(&layout);
    layout.choose_tops(&order);
    layout
}

/// Returns the column of each box. A box is in a column to the right of all its dependencies. A box without dependencies is in the column
/// directly before the first box that uses it.
fn columns(nodes: &[Node], links: &[Link]) -> Vec<usize> {
    let mut graph: DiGraph<(), ()> = DiGraph::with_capacity(nodes.len(), links.len());
    for _ in nodes {
        graph.add_node(());
    }
    for link in links {
        let [from, to] = [link.from, link.to].map(|end| NodeIndex::new(end.node));
        graph.add_edge(from, to, ());
    }
    let mut columns = vec![0; nodes.len()];
    // Sorting cannot fail, because the links of a graph form no cycles.
    let order = toposort(&graph, None).unwrap_or_else(|_| graph.node_indices().collect());
    for node in order {
        let before = graph.neighbors_directed(node, Incoming).map(|before| columns[before.index()]);
        columns[node.index()] = before.max().map_or(0, |before| before + 1);
    }
    for source in graph.externals(Incoming) {
        let users = graph.neighbors(source).map(|user| columns[user.index()]);
        if let Some(first) = users.min() {
            columns[source.index()] = first - 1;
        }
    }
    let last = columns.iter().copied().max().unwrap_or_default();
    let files_apart = (0..nodes.len()).any(|node| !nodes[node].is_last && columns[node] == last);
    for node in (0..nodes.len()).filter(|&node| nodes[node].is_last) {
        columns[node] = last + usize::from(files_apart);
    }
    columns
}

impl Layout {
    /// Routes each link through the columns between its ends. Links of one output share their passages.
    fn route_links(&mut self, links: &[Link]) {
        let mut by_source: BTreeMap<[usize; 2], Vec<&Link>> = BTreeMap::new();
        for link in links {
            by_source.entry([link.from.node, link.from.port]).or_default().push(link);
        }
        for (source, mut links) in by_source {
            links.sort_by_key(|link| self.slots[link.to.node].column);
            let mut crossing_position = (links[0].from.node, links[0].from.below);
            for link in links {
                let target = link.to.node;
                for column in self.slots[crossing_position.0].column + 1..self.slots[target].column
                {
                    let (passage, middle) = (self.slots.len(), PASSAGE / 2.0);
                    self.slots.push(Slot { column, top: 0.0, height: PASSAGE, node: None });
                    self.join(crossing_position, (passage, middle), source);
                    crossing_position = (passage, middle);
                }
                self.join(crossing_position, (target, link.to.below), source);
            }
        }
    }

    fn join(&mut self, from: (usize, f64), to: (usize, f64), source: [usize; 2]) {
        self.segments.push(Segment {
            from: from.0,
            from_below: from.1,
            to: to.0,
            to_below: to.1,
            source,
        });
    }

    /// Returns the vertical positions at which a segment starts and ends.
    pub(super) fn ends(&self, segment: &Segment) -> [f64; 2] {
        [
            self.slots[segment.from].top + segment.from_below,
            self.slots[segment.to].top + segment.to_below,
        ]
    }

    /// Chooses the vertical positions of all slots.
    fn choose_tops(&mut self, order: &Order) {
        for column in &order.columns {
            let mut top = 0.0;
            for &slot in column {
                self.slots[slot].top = top;
                top += self.slots[slot].height + GAP;
            }
        }
        for sweep in 0..=ALIGN_SWEEPS {
            let sides =
                if sweep == ALIGN_SWEEPS { [true; 2] } else { [sweep % 2 == 0, sweep % 2 == 1] };
            let mut columns: Vec<usize> = (0..self.columns).collect();
            if sides == [false, true] {
                columns.reverse();
            }
            for column in columns {
                self.move_column(&order.columns[column], order, sides);
            }
        }
        let highest = self.slots.iter().map(|slot| slot.top).fold(f64::INFINITY, f64::min);
        self.slots.iter_mut().for_each(|slot| slot.top -= highest);
        self.height = self.slots.iter().map(|slot| slot.top + slot.height).fold(0.0, f64::max);
    }

    /// Moves the slots of a column as near as possible to the vertical positions of their neighbors: in the left column, the right column,
    /// or both.
    fn move_column(&mut self, column: &[usize], order: &Order, [left, right]: [bool; 2]) {
        let mut wishes = Vec::with_capacity(column.len());
        let mut stacked = 0.0;
        for &slot in column {
            let (mut sum, mut weight) = (0.0, 0.0);
            let before = order.before[slot].iter().filter(|_| left);
            for &segment in before.chain(order.behind[slot].iter().filter(|_| right)) {
                let segment = &self.segments[segment];
                let ends = self.ends(segment);
                // A segment between two passages gets the highest weight, because straight long links are preferred to straight short ones.
                let share = match [segment.from, segment.to]
                    .map(|slot: usize| self.slots[slot].node.is_none())
                {
                    [true, true] => 8.0,
                    [false, false] => 1.0,
                    _ => 2.0,
                };
                let shift = if segment.to == slot { ends[0] - ends[1] } else { ends[1] - ends[0] };
                sum += share * (self.slots[slot].top + shift);
                weight += share;
            }
            let top = self.slots[slot].top;
            let wish = if weight > 0.0 { sum / weight } else { top };
            wishes.push((wish - stacked, weight.max(0.1)));
            stacked += self.slots[slot].height + GAP;
        }
        let mut stacked = 0.0;
        for (&slot, free) in column.iter().zip(monotone(&wishes)) {
            self.slots[slot].top = free + stacked;
            stacked += self.slots[slot].height + GAP;
        }
    }
}

/// Returns the non-decreasing sequence that is nearest to the pairs (value, weight), in the weighted least-squares sense.
fn monotone(wishes: &[(f64, f64)]) -> Vec<f64> {
    // Runs of equal values in the result, each as (mean, weight, number of values).
    let mut runs: Vec<(f64, f64, usize)> = Vec::new();
    for &(value, weight) in wishes {
        let mut run = (value, weight, 1);
        while let Some(&(mean, before, count)) = runs.last()
            && mean >= run.0
        {
            let weight = before + run.1;
            run = ((mean * before + run.0 * run.1) / weight, weight, count + run.2);
            runs.pop();
        }
        runs.push(run);
    }
    runs.iter().flat_map(|&(mean, _, count)| std::iter::repeat_n(mean, count)).collect()
}

/// The order of the slots in each column, from top to bottom.
struct Order {
    columns: Vec<Vec<usize>>,
    /// For each slot, its index in its column, from the top.
    places: Vec<usize>,
    /// For each slot, the segments that end at it (`before`) and the segments that start at it (`behind`).
    before: Vec<Vec<usize>>,
    behind: Vec<Vec<usize>>,
}

impl Order {
    fn new(layout: &Layout) -> Self {
        let mut columns = vec![Vec::new(); layout.columns];
        let mut places = Vec::with_capacity(layout.slots.len());
        for (slot, Slot { column, .. }) in layout.slots.iter().enumerate() {
            places.push(columns[*column].len());
            columns[*column].push(slot);
        }
        let mut before = vec![Vec::new(); layout.slots.len()];
        let mut behind = before.clone();
        for (index, segment) in layout.segments.iter().enumerate() {
            behind[segment.from].push(index);
            before[segment.to].push(index);
        }
        Self { columns, places, before, behind }
    }

    /// Reorders the columns in several sweeps, and keeps the order with the fewest crossings.
    fn sweep(&mut self, layout: &Layout) {
        let mut best = (usize::MAX, self.columns.clone());
        for sweep in 0..ORDER_SWEEPS {
            let crossings = self.crossings(layout);
            if crossings < best.0 {
                best = (crossings, self.columns.clone());
            }
            let count = self.columns.len();
            for step in 1..count {
                match sweep % 2 {
                    0 => self.sort(step, layout, true),
                    _ => self.sort(count - 1 - step, layout, false),
                }
            }
        }
        if best.0 < self.crossings(layout) {
            self.columns = best.1;
            self.renumber();
        }
    }

    fn renumber(&mut self) {
        for column in &self.columns {
            (0..).zip(column).for_each(|(place, &slot)| self.places[slot] = place);
        }
    }

    /// Returns the position of a segment's end as a fractional index in the column. `below` is the distance from the top of the slot to
    /// that end.
    fn crossing_position(&self, slot: usize, below: f64, layout: &Layout) -> f64 {
        self.places[slot] as f64 + below / (layout.slots[slot].height + 1.0)
    }

    /// Sorts the slots of a column by the mean position of each slot's neighbors in one adjacent column: the left one if `left` is true,
    /// else the right one. A slot without neighbors in that column is sorted by its own present position.
    fn sort(&mut self, column: usize, layout: &Layout, left: bool) {
        let mean = |slot: usize| {
            let segments = if left { &self.before[slot] } else { &self.behind[slot] };
            if segments.is_empty() {
                return self.places[slot] as f64;
            }
            segments
                .iter()
                .map(|&index| {
                    let segment = &layout.segments[index];
                    match left {
                        true => self.crossing_position(segment.from, segment.from_below, layout),
                        false => self.crossing_position(segment.to, segment.to_below, layout),
                    }
                })
                .sum::<f64>()
                / segments.len() as f64
        };
        let mut keyed: Vec<(f64, usize)> =
            self.columns[column].iter().map(|&slot| (mean(slot), slot)).collect();
        keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.columns[column] = keyed.into_iter().map(|(_, slot)| slot).collect();
        for (place, &slot) in self.columns[column].iter().enumerate() {
            self.places[slot] = place;
        }
    }

    /// Returns the number of pairs of segments that cross each other.
    fn crossings(&self, layout: &Layout) -> usize {
        let mut gaps = vec![Vec::new(); self.columns.len()];
        for segment in &layout.segments {
            let from = self.crossing_position(segment.from, segment.from_below, layout);
            let to = self.crossing_position(segment.to, segment.to_below, layout);
            gaps[layout.slots[segment.from].column].push((from, to));
        }
        gaps.into_iter().map(inversions).sum()
    }
}

/// Counts the inversions among pairs of numbers. An inversion consists of two pairs (a, b) and (c, d) with a < c and b > d.
fn inversions(mut pairs: Vec<(f64, f64)>) -> usize {
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    // The second numbers of the pairs visited so far, in ascending order.
    let mut seen: Vec<f64> = Vec::with_capacity(pairs.len());
    let mut count = 0;
    for (_, second) in pairs {
        let place = seen.partition_point(|&before| before <= second);
        count += seen.len() - place;
        seen.insert(place, second);
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(from: usize, to: usize) -> Link {
        fn end(node: usize, below: f64) -> LinkEnd {
            LinkEnd { node, port: 0, below }
        }
        Link { from: end(from, 10.0), to: end(to, 20.0) }
    }

    fn nodes(count: usize) -> Vec<Node> {
        vec![Node { height: 40.0, is_last: false }; count]
    }

    /// Returns a pseudorandom graph with `count` nodes and `links_each` links per node.
    fn random(count: usize, links_each: u64) -> (Vec<Node>, Vec<Link>) {
        let mut state = 7u64;
        fn next(below: u64, state: &mut u64) -> u64 {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (*state >> 33) % below
        }
        let mut links = Vec::new();
        for node in 1..count {
            for _ in 0..next(links_each + 1, &mut state) {
                links.push(link(node - 1 - next(node.min(12) as u64, &mut state) as usize, node));
            }
        }
        (nodes(count), links)
    }

    #[test]
    fn slots_of_a_column_keep_their_distance() {
        let (nodes, links) = random(90, 3);
        let layout = layout(&nodes, &links);
        for column in 0..layout.columns {
            let mut slots: Vec<&Slot> =
                layout.slots.iter().filter(|slot| slot.column == column).collect();
            slots.sort_by(|a, b| a.top.total_cmp(&b.top));
            for pair in slots.windows(2) {
                assert!(pair[0].top + pair[0].height + GAP <= pair[1].top + 1e-9);
            }
            assert!(0.0 <= slots[0].top && slots[slots.len() - 1].top <= layout.height);
        }
    }

    #[test]
    fn segments_join_neighboring_columns_from_left_to_right() {
        let (nodes, links) = random(60, 2);
        let layout = layout(&nodes, &links);
        for segment in &layout.segments {
            let [from, to] = [segment.from, segment.to].map(|slot| layout.slots[slot].column);
            assert_eq!(from + 1, to);
        }
        let ends = layout.segments.iter().filter(|s| layout.slots[s.to].node.is_some()).count();
        assert_eq!(ends, links.len());
    }

    #[test]
    fn a_ladder_whose_rungs_are_given_in_the_wrong_order_has_no_crossing() {
        let links: Vec<_> = (0..8).map(|k| link(k, 15 - k)).collect();
        let layout = layout(&nodes(16), &links);
        assert_eq!(Order::new(&layout).crossings(&layout), 28);
        for segment in &layout.segments {
            let [from, to] = layout.ends(segment);
            assert!((from - to).abs() < 1e-6);
        }
    }

    #[test]
    fn a_source_stands_right_before_its_user_and_files_stand_last() {
        let mut nodes = nodes(5);
        nodes[4].is_last = true;
        let links = [link(0, 1), link(1, 2), link(3, 2), link(0, 4)];
        // The output file is in the last column, although the longest path to it has only one link.
        assert_eq!(columns(&nodes, &links), [0, 1, 2, 1, 3]);
    }

    #[test]
    fn links_of_one_output_share_their_way() {
        let links = [link(0, 1), link(1, 2), link(2, 3), link(0, 3), link(0, 2)];
        let layout = layout(&nodes(4), &links);
        let passages = layout.slots.iter().filter(|slot| slot.node.is_none());
        assert_eq!(passages.map(|slot| slot.column).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn monotone_regression_returns_the_nearest_numbers() {
        let wishes = [(1.0, 1.0), (4.0, 1.0), (2.0, 3.0), (2.0, 1.0), (9.0, 1.0)];
        assert_eq!(monotone(&wishes), [1.0, 2.4, 2.4, 2.4, 9.0]);
        assert!(monotone(&[]).is_empty());
    }

    #[test]
    fn pairs_that_cross_are_counted() {
        assert_eq!(inversions(vec![(0.0, 2.0), (1.0, 1.0), (2.0, 0.0), (2.0, 3.0)]), 3);
        assert_eq!(inversions(vec![(0.0, 1.0), (0.0, 0.0), (1.0, 1.0)]), 0);
    }

    #[test]
    fn an_empty_graph_has_a_layout() {
        assert_eq!(layout(&[], &[]).height, 0.0);
    }
}
