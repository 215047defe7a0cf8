//! How far the points of a net must move at least when a part that stands out sinks.
//!
//! A profile is tangent to the border, so it leaves the flank of a nose where it was, and lets the middle sink: a sharp crest remains along
//! the border, thinner than the cells. Therefore each point sinks at least in proportion to its height over a membrane through the
//! surroundings: the whole part becomes flat first, and goes below its surroundings then.

use maquette_base::linear::laplace;
use maquette_node::{Error, Progress};
use maquette_value as value;
use nalgebra::{Unit, Vector3};

/// Maximum length of an edge between the part and its surroundings, in median edges of the part. The part may hide some of its surroundings
/// from the sensor, so the limit is large; longer edges lead to the background. The limit is that of `Blend`.
const MAX_EDGE: f64 = 15.0;

/// Minimum length of an edge between the part and its surroundings that is a step in depth, in median edges of the part.
const STEP: f64 = 6.0;

/// Distance from the rim at which the heights count entirely, in points of the net. At the rim they do not count, so that the lip that
/// remains there follows the rim and not the cells.
const RAMP: f64 = 1.75;

/// Number of points around a step in depth without a ramp; after as many more, the ramp is complete.
const STEP_REACH: usize = 3;

/// Minimum ratio of what stands out to what stands back. Other parts are uneven, or surrounded by an uneven surface.
const MIN_RATIO: f64 = 4.0;

/// Minimum fraction of the points around a part through which the membrane passes. Where less is known, its level is a guess.
const MIN_ANCHORED: f64 = 0.5;

/// Minimum height of a part that stands out, in median edges. Lower ones are bumps of a flat part.
const MIN_HEIGHT: f64 = 2.0;

/// The heights of a part over its surroundings.
pub(crate) struct Relief {
    /// The height of each point of the net, in mm; 0 for points that do not stand out, and outside. If the part ends at a step in depth,
    /// the points just beyond the step have the height of the part there, so that surfaces of the net fall at the step and not before it.
    heights: Vec<f64>,
    highest: f64,
    /// The median length of the edges of the part, in mm.
    edge: f64,
}

impl Relief {
    /// Returns how far a point moves that would move by `amount`, if the innermost point moves by `distance`: at least in proportion to its
    /// height. Where both are about equal, the larger one is exceeded by at most one edge, so that there is no sharp bend.
    pub(crate) fn sink(&self, at: usize, amount: f64, distance: f64) -> f64 {
        let flat = self.heights[at] * (distance / self.highest).min(1.0);
        let rounding = flat.min(amount).min(2.0 * self.edge);
        let difference = flat - amount;
        let larger =
            flat.midpoint(amount) + (difference * difference + rounding * rounding).sqrt() / 2.0;
        larger.min(distance)
    }
}

/// The part of a net that an offset may move.
pub(crate) struct Part<'a> {
    pub(crate) net: &'a value::ControlNet,
    /// 1 for each point of the net in the part, its border included.
    pub(crate) inside: &'a [u8],
    /// The distance of each point from the rim of the part, in points of the net; `None` if it is unknown.
    pub(crate) rim_distances: Option<&'a [f64]>,
}

/// A point outside of a part.
struct Reached {
    point: usize,
    /// The point of the part from which it was reached.
    from: usize,
    is_interpolated: bool,
}

/// Returns the neighbors of a point in its row and column of a net with the given numbers of columns and points.
fn neighbors(at: usize, columns: usize, count: usize) -> impl Iterator<Item = usize> {
    let near = [
        (!at.is_multiple_of(columns)).then(|| at - 1),
        (at % columns + 1 < columns).then_some(at + 1),
        at.checked_sub(columns),
        (at + columns < count).then_some(at + columns),
    ];
    near.into_iter().flatten()
}

impl Part<'_> {
    /// Returns the relief of the part against `direction`; `None` if the part does not stand out.
    pub(crate) fn relief(
        &self,
        direction: Unit<Vector3<f64>>,
        progress: &Progress<'_>,
    ) -> Result<Option<Relief>, Error> {
        let (net, inside) = (self.net, self.inside);
        let Some(edge) = self.median_edge() else { return Ok(None) };
        let levels: Vec<f64> =
            net.points().iter().map(|point| point.coords.dot(&direction)).collect();
        let surroundings = self.surroundings();
        let mut membrane = vec![f64::NAN; inside.len()];
        let mut free = inside.to_vec();
        let mut anchors = 0;
        for reached in &surroundings {
            if reached.is_interpolated {
                free[reached.point] = 1;
            } else if self.length(reached.from, reached.point) <= MAX_EDGE * edge {
                membrane[reached.point] = levels[reached.point];
                anchors += 1;
            }
        }
        let ends = surroundings
            .iter()
            .filter(|reached| !reached.is_interpolated || self.is_on_border(reached.point));
        if (anchors as f64) < MIN_ANCHORED * ends.count() as f64 {
            return Ok(None);
        }
        laplace::solve(net.columns(), net.rows(), &free, 0.0, &mut membrane, progress)?;
        let mut heights: Vec<f64> = (0..inside.len())
            .map(|at| if inside[at] == 1 { membrane[at] - levels[at] } else { 0.0 })
            .collect();
        let [out, back] = [1.0, -1.0].map(|sign| {
            let part = heights.iter().map(|height| (sign * height).max(0.0));
            part.sum::<f64>()
        });
        if out < MIN_RATIO * back {
            return Ok(None);
        }
        heights.iter_mut().for_each(|height| *height = height.max(0.0));
        let highest = heights.iter().copied().fold(0.0, f64::max);
        heights
            .iter_mut()
            .zip(self.ramp(edge, &surroundings))
            .for_each(|(height, share)| *height *= share);
        if highest < MIN_HEIGHT * edge {
            return Ok(None);
        }
        let mut beyond = vec![(0.0, 0.0); inside.len()];
        for [a, b] in self.edges().filter(|[a, b]| inside[*a] != inside[*b]) {
            let (inner, outer) = if inside[a] == 1 { (a, b) } else { (b, a) };
            if heights[inner] >= MIN_HEIGHT * edge {
                beyond[outer].0 += heights[inner];
                beyond[outer].1 += 1.0;
            }
        }
        for (height, (sum, count)) in heights.iter_mut().zip(beyond) {
            if count > 0.0 {
                *height = sum / count;
            }
        }
        Ok(Some(Relief { heights, highest, edge }))
    }

    /// Returns by how much the height of each point counts: 0 at the rim and 1 inside. At a step in depth it is 1 up to the rim, since the
    /// border of the part is the edge of a surface there, which must sink as a whole.
    fn ramp(&self, edge: f64, surroundings: &[Reached]) -> Vec<f64> {
        let Some(distances) = self.rim_distances else { return vec![1.0; self.inside.len()] };
        let mut at_step = vec![0.0_f64; self.inside.len()];
        for reached in surroundings {
            let ends = match reached.is_interpolated {
                true => self.is_on_border(reached.point),
                false => self.length(reached.from, reached.point) > STEP * edge,
            };
            if ends {
                at_step[reached.from] = 2.0;
            }
        }
        for _ in 0..2 * STEP_REACH {
            let before = at_step.clone();
            for [a, b] in self.edges() {
                at_step[a] = at_step[a].max(before[b] - 1.0 / STEP_REACH as f64);
                at_step[b] = at_step[b].max(before[a] - 1.0 / STEP_REACH as f64);
            }
        }
        let ramp = distances.iter().zip(at_step).map(|(distance, at_step): (&f64, f64)| {
            let x = (distance / RAMP).clamp(0.0, 1.0);
            f64::max(x * x * (3.0 - 2.0 * x), at_step.min(1.0))
        });
        ramp.collect()
    }

    /// Returns the points around the part, through interpolated points up to the first others.
    fn surroundings(&self) -> Vec<Reached> {
        let columns = self.net.columns();
        let interpolated = self.net.interpolated_points();
        let mut is_new: Vec<bool> = self.inside.iter().map(|&inside| inside == 0).collect();
        let mut reached: Vec<Reached> = Vec::new();
        let inside = (0..self.inside.len()).filter(|&at| self.inside[at] == 1);
        let mut from: Vec<(usize, usize)> = inside.map(|at| (at, at)).collect();
        while !from.is_empty() {
            let mut next = Vec::new();
            for (origin, at) in from {
                for near in neighbors(at, columns, self.inside.len()) {
                    if std::mem::take(&mut is_new[near]) {
                        let is_interpolated = interpolated.is_some_and(|flags| flags[near] == 1);
                        reached.push(Reached { point: near, from: origin, is_interpolated });
                        if is_interpolated {
                            next.push((origin, near));
                        }
                    }
                }
            }
            from = next;
        }
        reached
    }

    /// Returns all pairs of points that are neighbors in a row or column of the net.
    fn edges(&self) -> impl Iterator<Item = [usize; 2]> {
        let (columns, count) = (self.net.columns(), self.inside.len());
        (0..count).flat_map(move |at| {
            let right = (at % columns + 1 < columns).then_some([at, at + 1]);
            let below = (at + columns < count).then_some([at, at + columns]);
            right.into_iter().chain(below)
        })
    }

    fn is_on_border(&self, at: usize) -> bool {
        let (row, column) = (at / self.net.columns(), at % self.net.columns());
        row == 0 || row + 1 == self.net.rows() || column == 0 || column + 1 == self.net.columns()
    }

    fn length(&self, a: usize, b: usize) -> f64 {
        (self.net.points()[b] - self.net.points()[a]).norm()
    }

    /// Returns the median length of the edges of the part before any offset; `None` if there are none, or they have no length.
    fn median_edge(&self) -> Option<f64> {
        let base = self.net.base();
        let mut lengths: Vec<f64> = self
            .edges()
            .filter(|edge| edge.iter().all(|&at| self.inside[at] == 1))
            .map(|[a, b]| (base[b] - base[a]).norm())
            .collect();
        if lengths.is_empty() {
            return None;
        }
        let middle = lengths.len() / 2;
        let median = *lengths.select_nth_unstable_by(middle, f64::total_cmp).1;
        (median > 0.0).then_some(median)
    }
}
