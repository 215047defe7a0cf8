//! Decides which ends of creases belong together.

use super::curves::{Joint, join};
use super::ends::CreaseEnd;

/// Maximum number of ends of creases at a rim. A rim with more is that of a relief.
const MAX_ENDS: usize = 12;

/// Costs of an end that is not joined: for an end with few edges, which may be noise, and for others. The cost of a curve is about 1 if it
/// fits well.
const SHORT_EDGES: usize = 7;
const SHORT_COST: f64 = 2.0;
const LONG_COST: f64 = 60.0;

/// Two ends of creases and the curve that joins them.
#[derive(Clone, Debug)]
pub(super) struct Pair {
    /// The indices of the ends' rim vertices, ascending.
    pub(super) rim: [usize; 2],
    /// The points of the data's crease behind both ends.
    pub(super) behind: [nalgebra::Point3<f64>; 2],
    pub(super) joint: Joint,
}

/// The curves that continue creases across a hole; no two of them cross.
pub(super) struct Pairing {
    pub(super) pairs: Vec<Pair>,
    /// The number of ends that are not joined.
    pub(super) n_open: usize,
}

/// Joins ends such that the total cost is least. `edge` is the mean edge length at the rim.
pub(super) fn pair(ends: &[CreaseEnd], edge: f64) -> Option<Pairing> {
    let count = ends.len();
    if !(2..=MAX_ENDS).contains(&count) {
        return None;
    }
    let joints: Vec<Vec<Option<Joint>>> = (0..count)
        .map(|i| {
            (0..count).map(|j| (i < j).then(|| join(&ends[i], &ends[j], edge)).flatten()).collect()
        })
        .collect();
    let single: Vec<f64> = ends
        .iter()
        .map(|end| if end.points.len() <= SHORT_EDGES { SHORT_COST } else { LONG_COST })
        .collect();
    // `costs[i][j]` is the least cost of the ends from `i` on and before `j`, and `partners[i][j]` the end that `i` is joined to.
    let mut costs = vec![vec![0.0; count + 1]; count + 2];
    let mut partners = vec![vec![None; count + 1]; count + 1];
    for length in 1..=count {
        for i in 0..=count - length {
            let j = i + length;
            let mut best = (single[i] + costs[i + 1][j], None);
            for (k, joint) in joints[i].iter().enumerate().take(j).skip(i + 1) {
                let Some(joint) = joint else { continue };
                let cost = joint.cost + costs[i + 1][k] + costs[k + 1][j];
                if cost < best.0 {
                    best = (cost, Some(k));
                }
            }
            (costs[i][j], partners[i][j]) = best;
        }
    }
    let (mut pairs, mut n_open, mut open) = (Vec::new(), 0, vec![[0, count]]);
    while let Some([i, j]) = open.pop() {
        if i >= j {
            continue;
        }
        match partners[i][j] {
            Some(k) => {
                open.extend([[i + 1, k], [k + 1, j]]);
                pairs.extend(joints[i][k].clone().map(|joint| Pair {
                    rim: [ends[i].rim, ends[k].rim],
                    behind: [ends[i].points[1], ends[k].points[1]],
                    joint,
                }));
            }
            None => {
                n_open += 1;
                open.push([i + 1, j]);
            }
        }
    }
    pairs.sort_by_key(|pair| pair.rim);
    (!pairs.is_empty()).then_some(Pairing { pairs, n_open })
}
