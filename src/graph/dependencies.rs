//! Dependencies between the nodes of a graph: their order, their cycles, and the nodes on which a node depends.

use petgraph::algo::toposort;
use petgraph::graph::{DiGraph, NodeIndex};
use petgraph::visit::{Dfs, DfsPostOrder, VisitMap, Visitable};

/// The nodes of a graph as a directed graph. For each link there is an edge from the node that has the link to the source of the link.
///
/// petgraph lists the neighbors of a node in reverse order of insertion. Its depth-first traversals reverse the order again, so they follow
/// edges in the order of insertion.
#[derive(Debug, Default)]
pub struct Dependencies(DiGraph<(), ()>);

impl Dependencies {
    /// Creates a graph of `count` nodes. In each link, the first node depends on the second.
    pub fn new(count: usize, links: impl Iterator<Item = (usize, usize)>) -> Self {
        let mut graph = DiGraph::with_capacity(count, links.size_hint().0);
        for _ in 0..count {
            graph.add_node(());
        }
        for (user, source) in links {
            graph.add_edge(NodeIndex::new(user), NodeIndex::new(source), ());
        }
        Self(graph)
    }

    /// Returns the nodes on which a node depends. A source appears once per link, and the order is from the last link to the first.
    pub(crate) fn sources(&self, node: usize) -> impl Iterator<Item = usize> {
        self.0.neighbors(NodeIndex::new(node)).map(NodeIndex::index)
    }

    /// Returns the nodes that depend on a node. A user appears once per link, and the order is from the last link to the first.
    pub(crate) fn users(&self, node: usize) -> impl Iterator<Item = usize> {
        let users = self.0.neighbors_directed(NodeIndex::new(node), petgraph::Incoming);
        users.map(NodeIndex::index)
    }

    /// For each node, returns true if it is one of `roots` or if a root depends on it.
    pub fn closure_of(&self, roots: impl IntoIterator<Item = usize>) -> Vec<bool> {
        let roots = roots.into_iter().map(NodeIndex::new).collect();
        let mut walk = Dfs::from_parts(roots, self.0.visit_map());
        while walk.next(&self.0).is_some() {}
        self.0.node_indices().map(|node| walk.discovered.is_visited(&node)).collect()
    }

    /// Returns the nodes in topological order, each after those on which it depends; ties follow the order of nodes and links. Also returns
    /// the cycles: for each link that closes a cycle, the nodes of that cycle. Each node is linked to the next one, and the last to the
    /// first.
    pub(crate) fn order(&self) -> (Vec<usize>, Vec<Vec<usize>>) {
        match toposort(&self.0, None) {
            // The edges lead from users to sources, so petgraph lists users before their sources.
            Ok(order) => (order.into_iter().rev().map(NodeIndex::index).collect(), Vec::new()),
            Err(_) => (self.order_ignoring_cycles(), self.cycles()),
        }
    }

    fn order_ignoring_cycles(&self) -> Vec<usize> {
        let mut order = Vec::with_capacity(self.0.node_count());
        let mut walk = DfsPostOrder::empty(&self.0);
        for start in self.0.node_indices() {
            walk.move_to(start);
            while let Some(node) = walk.next(&self.0) {
                order.push(node.index());
            }
        }
        order
    }

    /// Returns the cycles that a depth-first traversal finds. petgraph can report back edges, but its traversal is recursive and could
    /// overflow the stack on a long chain of nodes.
    fn cycles(&self) -> Vec<Vec<usize>> {
        let (mut discovered, mut finished) = (self.0.visit_map(), self.0.visit_map());
        let mut cycles = Vec::new();
        for start in self.0.node_indices() {
            if !discovered.visit(start) {
                continue;
            }
            // The current path. Each node has a list of its unvisited neighbors, in reverse order.
            let mut path = vec![(start, Vec::from_iter(self.0.neighbors(start)))];
            while let Some((node, left)) = path.last_mut() {
                let Some(next) = left.pop() else {
                    finished.visit(*node);
                    path.pop();
                    continue;
                };
                if discovered.visit(next) {
                    path.push((next, self.0.neighbors(next).collect()));
                } else if !finished.is_visited(&next) {
                    let cycle = path.iter().skip_while(|(node, _)| *node != next);
                    cycles.push(cycle.map(|(node, _)| node.index()).collect());
                }
            }
        }
        cycles
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    fn order(count: usize, links: &[(usize, usize)]) -> (Vec<usize>, Vec<Vec<usize>>) {
        Dependencies::new(count, links.iter().copied()).order()
    }

    /// Reference implementation for the test: the order and the cycles by a recursive traversal.
    fn walk(count: usize, links: &[(usize, usize)]) -> (Vec<usize>, Vec<Vec<usize>>) {
        fn visit(
            node: usize,
            links: &[(usize, usize)],
            path: &mut Vec<usize>,
            found: &mut (Vec<usize>, Vec<Vec<usize>>),
        ) {
            path.push(node);
            for &(_, source) in links.iter().filter(|(user, _)| *user == node) {
                if let Some(first) = path.iter().position(|&node| node == source) {
                    found.1.push(path[first..].to_vec());
                } else if !found.0.contains(&source) {
                    visit(source, links, path, found);
                }
            }
            path.pop();
            found.0.push(node);
        }
        let mut found = (Vec::new(), Vec::new());
        for node in 0..count {
            if !found.0.contains(&node) {
                visit(node, links, &mut Vec::new(), &mut found);
            }
        }
        found
    }

    #[test]
    fn nodes_follow_their_dependencies_in_the_order_of_links() {
        assert_eq!(order(4, &[(0, 3), (0, 1), (1, 2)]), (vec![3, 2, 1, 0], vec![]));
        assert_eq!(order(3, &[]), (vec![0, 1, 2], vec![]));
        assert_eq!(order(0, &[]), (vec![], vec![]));
    }

    #[test]
    fn a_cycle_has_the_path_along_its_links() {
        assert_eq!(order(3, &[(0, 1), (1, 2), (2, 1)]), (vec![2, 1, 0], vec![vec![1, 2]]));
        assert_eq!(order(1, &[(0, 0), (0, 0)]), (vec![0], vec![vec![0], vec![0]]));
    }

    #[test]
    fn a_long_chain_and_a_long_circle_need_no_deep_stack() {
        const LENGTH: usize = 200_000;
        let chain: Vec<_> = (1..LENGTH).map(|node| (node - 1, node)).collect();
        assert_eq!(order(LENGTH, &chain).0, (0..LENGTH).rev().collect::<Vec<_>>());
        let circle = [chain, vec![(LENGTH - 1, 0)]].concat();
        assert_eq!(order(LENGTH, &circle).1, [(0..LENGTH).collect::<Vec<_>>()]);
    }

    #[test]
    fn neighbors_are_listed_once_per_link() {
        let needs = Dependencies::new(3, [(1, 0), (2, 0), (2, 1), (2, 0)].into_iter());
        assert_eq!(Vec::from_iter(needs.sources(2)), [0, 1, 0]);
        assert_eq!(Vec::from_iter(needs.users(0)), [2, 2, 1]);
        assert_eq!(needs.closure_of([1]), [true, true, false]);
        assert_eq!(needs.closure_of([]), [false; 3]);
    }

    proptest! {
        #[test]
        fn any_graph_is_ordered_as_a_plain_walk_orders_it(
            links in vec((0..9usize, 0..9usize), 0..24),
        ) {
            prop_assert_eq!(order(9, &links), walk(9, &links));
        }
    }
}
