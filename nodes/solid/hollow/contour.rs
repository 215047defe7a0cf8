//! The surface in a grid at some depth.

use std::collections::HashMap;

use maquette::{Cancelled, Progress};
use nalgebra::Point3;

use super::depth::Depth;

/// The six tetrahedra of a cell: the orders in which they go along the axes from its lowest corner to its highest, and whether the volume that edges from the first
/// corner span is positive.
const ORDERS: [([usize; 3], bool); 6] = [
    ([0, 1, 2], true),
    ([1, 2, 0], true),
    ([2, 0, 1], true),
    ([0, 2, 1], false),
    ([2, 1, 0], false),
    ([1, 0, 2], false),
];

/// A vertex is no nearer to a node than this share of an edge, so that triangles have a size.
const NEAREST: f64 = 0.02;

type Surface = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// The points and triangles of what is deeper than `level`, which look into it.
pub(super) fn contour(
    grid: &Depth,
    level: f64,
    progress: &Progress<'_>,
) -> Result<Surface, Cancelled> {
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    let mut numbers: HashMap<[usize; 2], u32> = HashMap::new();
    let [width, height, depth] = grid.counts.map(|count| count - 1);
    let steps = [0, 1, 2].map(|axis| [0, 1, 2].map(|other| usize::from(other == axis)));
    let add = |a: [usize; 3], b: [usize; 3]| [0, 1, 2].map(|axis| a[axis] + b[axis]);
    for z in 0..depth {
        progress.check()?;
        for y in 0..height {
            for x in 0..width {
                let corner = |k: usize| {
                    grid.depths[grid.node([x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)])]
                };
                let deep = (0..8).filter(|&k| level < corner(k)).count();
                if deep == 0 || deep == 8 {
                    continue;
                }
                for (order, is_positive) in ORDERS {
                    let mut at = [[x, y, z]; 4];
                    for k in 0..3 {
                        at[k + 1] = add(at[k], steps[order[k]]);
                    }
                    let is_deep = at.map(|at| level < grid.depths[grid.node(at)]);
                    // Where the edge between two corners, one of which is deep, meets the level.
                    let mut vertex = |a: usize, b: usize| {
                        let ends = if a < b { [at[a], at[b]] } else { [at[b], at[a]] };
                        let nodes = ends.map(|end| grid.node(end));
                        *numbers.entry(nodes).or_insert_with(|| {
                            let [from, to] = nodes.map(|node| grid.depths[node] - level);
                            let share = (from / (from - to)).clamp(NEAREST, 1.0 - NEAREST);
                            let [from, to] = ends.map(|end| grid.place(end));
                            points.push(from + (to - from) * share);
                            points.len() as u32 - 1
                        })
                    };
                    let (inner, outer): (Vec<usize>, Vec<usize>) =
                        (0..4).partition(|k| is_deep[*k]);
                    // An even number of swaps brings the corners into this order, or an odd one.
                    let is_even = |order: [usize; 4]| {
                        let swaps = (0..4).flat_map(|b| (0..b).map(move |a| [a, b]));
                        swaps.filter(|&[a, b]| order[b] < order[a]).count() % 2 == 0
                    };
                    match (&inner[..], &outer[..]) {
                        (&[a], &[b, c, d]) => {
                            let own = [vertex(a, b), vertex(a, d), vertex(a, c)];
                            triangles.push(turned(own, is_even([a, b, c, d]) == is_positive));
                        }
                        (&[b, c, d], &[a]) => {
                            let own = [vertex(a, b), vertex(a, c), vertex(a, d)];
                            triangles.push(turned(own, is_even([a, b, c, d]) == is_positive));
                        }
                        (&[a, b], &[c, d]) => {
                            let quad = [vertex(a, c), vertex(b, c), vertex(b, d), vertex(a, d)];
                            let keeps = is_even([a, b, c, d]) == is_positive;
                            triangles.push(turned([quad[0], quad[1], quad[2]], keeps));
                            triangles.push(turned([quad[0], quad[2], quad[3]], keeps));
                        }
                        _ => {}
                    }
                }
            }
        }
    }
    Ok((points, triangles))
}

fn turned([a, b, c]: [u32; 3], keeps: bool) -> [u32; 3] {
    if keeps { [a, b, c] } else { [a, c, b] }
}
