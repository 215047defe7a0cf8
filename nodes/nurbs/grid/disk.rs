//! A region as a triangulated disk.
//!
//! Four cells around a corner of the grid make two triangles, three cells make one. Holes of the region are closed first. Of the components
//! connected by edges, the largest is kept. The result is always a topological disk: several fans of triangles could meet in a vertex only
//! if a closed chain of cells passed through this vertex, but the inside of such a chain has been filled.
//!
//! An inner edge with both ends on the border gets a vertex at its middle. Without this vertex, the edge could be mapped onto a side of the
//! square, so that the map is not one-to-one: Floater, "One-to-one piecewise linear mappings over triangulations", Mathematics of
//! Computation 72 (2003), theorem 6.1.

use std::collections::BTreeMap;

/// Stands for a missing neighbor: the edge belongs to one triangle only.
const NONE: u32 = u32::MAX;

/// A region of the range grid as a triangulated disk.
pub(crate) struct Disk {
    /// The (column, row) of each vertex. First come all cells of the window, then the vertices in the middle between two cells.
    pub(crate) places: Vec<[f64; 2]>,
    /// For each vertex that is in the middle between two cells, the two cells.
    pub(crate) between: Vec<[u32; 2]>,
    /// The triangles, counter-clockwise in the picture.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// The vertices of the border, counter-clockwise, from the border's first cell on.
    pub(crate) border: Vec<u32>,
}

impl Disk {
    /// Makes the disk of the cells that are 1 in `inside`, which has the given numbers of rows and columns. Returns `None` if no three
    /// cells make a triangle.
    pub(crate) fn new(rows: usize, columns: usize, inside: &[u8]) -> Option<Self> {
        let mut inside = inside.to_vec();
        close_holes(rows, columns, &mut inside);
        let triangles = largest_part(&triangles(rows, columns, &inside));
        let sides = Sides::new(&triangles);
        let border = sides.border()?;
        let mut on_border = vec![false; inside.len()];
        border.iter().for_each(|&vertex| on_border[vertex as usize] = true);
        let places = (0..inside.len()).map(|at| [(at % columns) as f64, (at / columns) as f64]);
        let mut disk =
            Self { places: places.collect(), between: Vec::new(), triangles: Vec::new(), border };
        let mut middles = BTreeMap::new();
        for &[a, b] in &sides.inner {
            if on_border[a as usize] && on_border[b as usize] {
                middles.insert([a, b], disk.places.len() as u32);
                let [from, to] = [a, b].map(|vertex| disk.places[vertex as usize]);
                disk.places.push([(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0]);
                disk.between.push([a, b]);
            }
        }
        triangles.iter().for_each(|&triangle| disk.push(triangle, &middles));
        Some(disk)
    }

    /// Adds a triangle to the disk. Edges of the triangle that have a middle vertex in `middles` are divided at that vertex.
    fn push(&mut self, [a, b, c]: [u32; 3], middles: &BTreeMap<[u32; 2], u32>) {
        for [a, b, c] in [[a, b, c], [b, c, a], [c, a, b]] {
            if let Some(&middle) = middles.get(&[a.min(b), a.max(b)]) {
                self.push([a, middle, c], middles);
                self.push([middle, b, c], middles);
                return;
            }
        }
        self.triangles.push([a, b, c]);
    }
}

/// Fills holes: an outside cell becomes an inside cell if it is not connected to the border of the grid through outside cells with common
/// sides.
fn close_holes(rows: usize, columns: usize, inside: &mut [u8]) {
    let mut stack: Vec<usize> = (0..inside.len())
        .filter(|at| {
            let (row, column) = (at / columns, at % columns);
            row == 0 || row + 1 == rows || column == 0 || column + 1 == columns
        })
        .filter(|&at| inside[at] == 0)
        .collect();
    let mut outside = vec![false; inside.len()];
    stack.iter().for_each(|&at| outside[at] = true);
    while let Some(at) = stack.pop() {
        let column = at % columns;
        let near = [
            at.checked_sub(columns),
            (column > 0).then(|| at - 1),
            (column + 1 < columns).then_some(at + 1),
            Some(at + columns).filter(|&below| below < inside.len()),
        ];
        for next in near.into_iter().flatten() {
            if inside[next] == 0 && !outside[next] {
                outside[next] = true;
                stack.push(next);
            }
        }
    }
    inside.iter_mut().zip(outside).for_each(|(inside, outside)| *inside = u8::from(!outside));
}

/// Returns the triangles between inside cells, in raster order.
fn triangles(rows: usize, columns: usize, inside: &[u8]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for row in 1..rows {
        for column in 1..columns {
            let right_below = row * columns + column;
            let corners =
                [right_below - columns - 1, right_below - 1, right_below, right_below - columns];
            let [a, d, c, b] = corners.map(|at| at as u32);
            match corners.map(|at| inside[at] == 1) {
                [true, true, true, true] => triangles.extend([[a, d, c], [a, c, b]]),
                [false, true, true, true] => triangles.push([d, c, b]),
                [true, false, true, true] => triangles.push([a, c, b]),
                [true, true, false, true] => triangles.push([a, d, b]),
                [true, true, true, false] => triangles.push([a, d, c]),
                _ => {}
            }
        }
    }
    triangles
}

/// Returns the triangles of the largest edge-connected component; if several are equally large, of the first one.
fn largest_part(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let neighbors = Sides::new(triangles).neighbors;
    let mut part = vec![NONE; triangles.len()];
    let mut sizes: Vec<usize> = Vec::new();
    for start in 0..triangles.len() {
        if part[start] != NONE {
            continue;
        }
        let name = sizes.len() as u32;
        let mut size = 0;
        let mut stack = vec![start];
        part[start] = name;
        while let Some(triangle) = stack.pop() {
            size += 1;
            for &next in neighbors[triangle].iter().filter(|&&next| next != NONE) {
                if part[next as usize] == NONE {
                    part[next as usize] = name;
                    stack.push(next as usize);
                }
            }
        }
        sizes.push(size);
    }
    let most = sizes.iter().max();
    let largest = sizes.iter().position(|size| Some(size) == most);
    fn is_largest(name: &u32, largest: &Option<usize>) -> bool {
        *largest == Some(*name as usize)
    }
    triangles
        .iter()
        .zip(&part)
        .filter(|(_, name)| is_largest(name, &largest))
        .map(|(triangle, _)| *triangle)
        .collect()
}

/// The edges of a list of triangles, and the adjacent triangles across the edges.
struct Sides {
    /// The triangles adjacent to each triangle across its edges 0-1, 1-2 and 2-0.
    neighbors: Vec<[u32; 3]>,
    /// The edges between two triangles, as pairs (a, b) with a < b, sorted.
    inner: Vec<[u32; 2]>,
    /// The edges that belong to only one triangle, sorted. Each edge has the direction in which its triangle traverses it.
    outer: Vec<[u32; 2]>,
}

impl Sides {
    fn new(triangles: &[[u32; 3]]) -> Self {
        let mut halves: Vec<([u32; 2], usize, usize)> = Vec::with_capacity(3 * triangles.len());
        for (index, triangle) in triangles.iter().enumerate() {
            for side in 0..3 {
                let (a, b) = (triangle[side], triangle[(side + 1) % 3]);
                halves.push(([a.min(b), a.max(b)], index, side));
            }
        }
        halves.sort_unstable();
        let mut sides = Self {
            neighbors: vec![[NONE; 3]; triangles.len()],
            inner: Vec::new(),
            outer: Vec::new(),
        };
        for same in halves.chunk_by(|a, b| a.0 == b.0) {
            match *same {
                [(edge, first, side), (_, second, other), ..] => {
                    sides.neighbors[first][side] = second as u32;
                    sides.neighbors[second][other] = first as u32;
                    sides.inner.push(edge);
                }
                [(_, index, side)] => {
                    sides.outer.push([triangles[index][side], triangles[index][(side + 1) % 3]]);
                }
                [] => {}
            }
        }
        sides.outer.sort_unstable();
        sides
    }

    /// Returns the border as one closed chain of vertices. `None` if the border is empty or consists of several chains.
    fn border(&self) -> Option<Vec<u32>> {
        let start = self.outer.first()?[0];
        let mut chain = vec![start];
        loop {
            let from = *chain.last()?;
            let edge = self.outer.partition_point(|edge| edge[0] < from);
            let to = self.outer.get(edge).filter(|edge| edge[0] == from)?[1];
            if to == start {
                return (chain.len() == self.outer.len()).then_some(chain);
            }
            if chain.len() == self.outer.len() {
                return None;
            }
            chain.push(to);
        }
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Mask;
    use proptest::prelude::*;

    use super::*;

    fn disk(rows: &[&str]) -> Option<Disk> {
        let mask = Mask::from_rows(rows);
        Disk::new(mask.height(), mask.width(), mask.pixels())
    }

    #[test]
    fn a_hole_is_closed_and_a_spike_is_left_out() {
        let disk = disk(&["###..", "#.###", "###.."]).unwrap();
        // The outer cell of the spike makes no triangle. The inner cell makes one with the corners above and below.
        assert_eq!(disk.border, [0, 5, 10, 11, 12, 8, 2, 1]);
    }

    #[test]
    fn cells_in_a_line_make_no_disk() {
        assert!(disk(&["####"]).is_none());
        assert!(disk(&["#..", ".#.", "..#"]).is_none());
    }

    proptest! {
        #[test]
        fn every_disk_is_a_topological_disk(
            (width, pixels) in (3usize..14, 3usize..14).prop_flat_map(|(width, height)| {
                (Just(width), prop::collection::vec(prop::bool::weighted(0.75), width * height))
            }),
        ) {
            let inside: Vec<u8> = pixels.iter().map(|&inside| u8::from(inside)).collect();
            let rows = inside.len() / width;
            let any = !triangles(rows, width, &inside).is_empty();
            let disk = Disk::new(rows, width, &inside);
            prop_assert_eq!(disk.is_some(), any);
            let Some(disk) = disk else { return Ok(()) };
            // Euler's formula: vertices - edges + triangles = 1 on a disk.
            let sides = Sides::new(&disk.triangles);
            let mut used: Vec<u32> = disk.triangles.concat();
            used.sort_unstable();
            used.dedup();
            let edges = sides.inner.len() + sides.outer.len();
            prop_assert_eq!(used.len() + disk.triangles.len(), edges + 1);
            prop_assert_eq!(sides.outer.len(), disk.border.len());
            // No inner edge connects two border vertices.
            prop_assert!(sides.inner.iter().all(|[a, b]| !(disk.border.contains(a) && disk.border.contains(b))));
        }
    }
}
