//! Prepares handles: converts them to mm, chooses omitted deviations, and merges handles at the same position.

use maquette_node::{Error, bail};
use maquette_value::Memo;
use maquette_value::{Encoder, Handle, HandleSpace, Handles};
use nalgebra::{Point3, Vector3};

use super::gaussians::Gaussians;
use crate::Mode;

/// The minimum and maximum corner of a box.
pub type Bounds = (Point3<f64>, Point3<f64>);

/// The handles without their targets, after merging, and the options: all inputs of the linear system that a deformation solves.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    pub(crate) positions: Vec<Point3<f64>>,
    pub(crate) sigma: Vec<[f64; 3]>,
    pub(crate) weight: Vec<f64>,
    pub(crate) mode: Mode,
    pub(crate) background: f64,
    pub(crate) regularize: f64,
}

/// A layout, the targets of its handles, and the mapping from original handles to those of the layout.
#[derive(Clone, Debug)]
pub(crate) struct PreparedHandles {
    pub(crate) layout: Layout,
    pub(crate) targets: Vec<Point3<f64>>,
    /// For each original handle, its index in the layout. Merged handles have the same index.
    pub(crate) layout_indices: Vec<usize>,
    /// The original handles that were merged. Each pair lists the later handle, then the earlier one.
    pub(crate) merged: Vec<[usize; 2]>,
    /// The diagonal of the box to which handle coordinates are relative, in mm.
    pub(crate) diagonal: f64,
}

/// Two handles closer to each other than this many of their standard deviations count as one: their equations would differ by rounding
/// errors only.
const SAME_POSITION: f64 = 1e-6;

/// Two targets closer to each other than this fraction of the box's diagonal count as equal.
const SAME_TARGET: f64 = 1e-9;

/// Maximum number of handles. With more handles, solving the system takes seconds; memory grows with the square of the number.
pub(crate) const MAX_HANDLES: usize = 2000;

/// The number of nearest handles from whose distances an omitted deviation is chosen.
const NEAREST_HANDLES: usize = 3;

/// Ratio of a chosen deviation to the mean distance to the nearest handles. With 0.75, Gaussians overlap, and the linear system is well
/// conditioned.
const DEVIATION_RATIO: f64 = 0.75;

impl Layout {
    pub(crate) fn gaussians(&self) -> Gaussians {
        Gaussians::new(&self.positions, &self.sigma, &self.weight, self.background)
    }
}

/// Returns the handles in mm, merged if they have the same position. `bounds` is the box to which their coordinates are relative.
pub(crate) fn prepare(
    handles: &Handles,
    bounds: Bounds,
    mode: Mode,
    background: f64,
    regularize: f64,
) -> Result<PreparedHandles, Error> {
    if !(0.0..f64::INFINITY).contains(&background)
        || (background > 0.0 && mode != Mode::Displacement)
    {
        return Err(wrong_background(background));
    }
    if !(0.0..f64::INFINITY).contains(&regularize) {
        bail!("`regularize` is {regularize}, but it must be 0 or more");
    }
    if handles.len() > MAX_HANDLES {
        bail!("expected at most {MAX_HANDLES} handles, found {}", handles.len());
    }
    let diagonal = (bounds.1 - bounds.0).norm();
    let (all, to) = choose_deviations(handles, bounds, mode)?;
    let mut prepared = PreparedHandles {
        layout: Layout {
            positions: Vec::new(),
            sigma: Vec::new(),
            weight: Vec::new(),
            mode,
            background,
            regularize,
        },
        targets: Vec::new(),
        layout_indices: Vec::new(),
        merged: Vec::new(),
        diagonal,
    };
    let mut originals = Vec::new();
    for (index, to) in to.into_iter().enumerate() {
        let (at, sigma) = (all.positions[index], all.sigma[index]);
        let layout = &mut prepared.layout;
        let twin = (0..layout.positions.len()).find(|&other| {
            let step = at - layout.positions[other];
            let scaled =
                Vector3::from_fn(|axis, _| step[axis] / sigma[axis].min(layout.sigma[other][axis]));
            scaled.norm() < SAME_POSITION
        });
        if let Some(twin) = twin {
            if (to - prepared.targets[twin]).norm() > SAME_TARGET * diagonal {
                bail!(
                    "handles {} and {index} have the same position but different targets; remove one of them, or give both the same target",
                    originals[twin]
                );
            }
            prepared.merged.push([index, originals[twin]]);
            prepared.layout_indices.push(twin);
            continue;
        }
        prepared.layout_indices.push(layout.positions.len());
        originals.push(index);
        layout.positions.push(at);
        layout.sigma.push(sigma);
        layout.weight.push(all.weight[index]);
        prepared.targets.push(to);
    }
    Ok(prepared)
}

/// Returns the error for a background that is out of range or not supported by the mode.
pub(crate) fn wrong_background(background: f64) -> Error {
    Error::new(format!(
        "`background` is {background}, but it must be 0 or more, and 0 unless `mode` is `Displacement`"
    ))
}

/// Returns the handles in mm with all deviations, and their targets. Omitted deviations are 0.75 of the mean distance to the three nearest
/// handles, measured with the box scaled to a unit cube. In the absolute form, omitted deviations are the sides of the box.
pub(crate) fn choose_deviations(
    handles: &Handles,
    bounds: Bounds,
    mode: Mode,
) -> Result<(Layout, Vec<Point3<f64>>), Error> {
    let world = handles.in_world(bounds)?;
    let unit = Handle { at: [0.0; 3], to: None, sigma: Some([1.0; 3]), weight: 1.0 };
    let sides = Handles::new(HandleSpace::Box, &[unit])?.in_world(bounds)?.sigma()[0];
    let scaled: Vec<Vector3<f64>> = world
        .positions()
        .iter()
        .map(|at| (at - bounds.0).component_div(&Vector3::from(sides)))
        .collect();
    let layout = Layout {
        positions: world.positions().to_vec(),
        sigma: world
            .sigma()
            .iter()
            .enumerate()
            .map(|(index, given)| {
                if *given != [0.0; 3] {
                    return *given;
                }
                let deviation = match mode {
                    Mode::Absolute => 1.0,
                    Mode::Displacement | Mode::Affine => relative_deviation(index, &scaled),
                };
                sides.map(|side| deviation * side)
            })
            .collect(),
        weight: world.weight().to_vec(),
        mode,
        background: 0.0,
        regularize: 0.0,
    };
    Ok((layout, world.targets().to_vec()))
}

/// Returns the deviation for a handle, in sides of the box, chosen from the distances to the nearest handles; 1 if all handles have the
/// same position. `scaled` are the handles' positions with the box scaled to a unit cube.
fn relative_deviation(index: usize, scaled: &[Vector3<f64>]) -> f64 {
    let others = scaled.iter().map(|other| (other - scaled[index]).norm());
    let mut distances: Vec<f64> = others.filter(|distance| *distance > 0.0).collect();
    distances.sort_by(f64::total_cmp);
    distances.truncate(NEAREST_HANDLES);
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    if (0.0..f64::INFINITY).contains(&mean) { DEVIATION_RATIO * mean } else { 1.0 }
}

/// The layout is the cache key of the linear system.
impl Memo for Layout {
    const NAME: &'static str = "HandleLayout";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&(self.mode as u8)).plain(&[self.background, self.regularize]);
        to.counts(&[self.positions.len()]);
        for index in 0..self.positions.len() {
            let at: [f64; 3] = self.positions[index].into();
            to.plain(&at).plain(&self.sigma[index]).plain(&self.weight[index]);
        }
    }

    fn size(&self) -> usize {
        self.positions.len() * size_of::<[f64; 7]>()
    }
}
