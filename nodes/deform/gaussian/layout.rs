//! Handles made ready: in mm, with their deviations chosen, and no two of them at one place.

use maquette_value::Memo;
use maquette_value::{Encoder, Handle, HandleSpace, Handles};
use nalgebra::{Point3, Vector3};

use super::gaussians::Gaussians;
use crate::{FfdError, Mode};

/// The lowest and the highest corner of a box.
pub type Bounds = (Point3<f64>, Point3<f64>);

/// All that the shares of handles, and what is solved for them, depend on: everything but their targets.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    pub(crate) at: Vec<Point3<f64>>,
    pub(crate) sigma: Vec<[f64; 3]>,
    pub(crate) weight: Vec<f64>,
    pub(crate) mode: Mode,
    pub(crate) background: f64,
    pub(crate) regularize: f64,
}

/// A layout, where its handles go, and what became of the handles that it was made of.
#[derive(Clone, Debug)]
pub(crate) struct Prepared {
    pub(crate) layout: Layout,
    pub(crate) to: Vec<Point3<f64>>,
    /// Which of the layout's handles each handle became.
    pub(crate) places: Vec<usize>,
    /// Handles that became one: the later and the earlier.
    pub(crate) merged: Vec<[usize; 2]>,
    /// The diagonal of the box.
    pub(crate) diagonal: f64,
}

/// Handles nearer than this many of their deviations are at one place: the equations of both would differ in rounding alone.
const SAME_PLACE: f64 = 1e-6;

/// Targets nearer than this share of the box's diagonal are one.
const SAME_TARGET: f64 = 1e-9;

/// More handles take seconds for one solution, and memory as their square.
pub(crate) const MOST_HANDLES: usize = 2000;

/// How many neighbors a chosen deviation looks at.
const NEIGHBORS: usize = 3;

/// A chosen deviation, in mean distances to these neighbors: neighbors overlap, and the system is well conditioned.
const REACH: f64 = 0.75;

impl Layout {
    pub(crate) fn gaussians(&self) -> Gaussians {
        Gaussians::new(&self.at, &self.sigma, &self.weight, self.background)
    }
}

/// The handles in mm, merged where they are at one place. `bounds` is the box that their space is of.
pub(crate) fn prepare(
    handles: &Handles,
    bounds: Bounds,
    mode: Mode,
    background: f64,
    regularize: f64,
) -> Result<Prepared, FfdError> {
    if !(0.0..f64::INFINITY).contains(&background)
        || (background > 0.0 && mode != Mode::Displacement)
    {
        return Err(FfdError::Background { background });
    }
    if !(0.0..f64::INFINITY).contains(&regularize) {
        return Err(FfdError::Regularize { regularize });
    }
    if handles.len() > MOST_HANDLES {
        return Err(FfdError::TooMany { handles: handles.len(), most: MOST_HANDLES });
    }
    let diagonal = (bounds.1 - bounds.0).norm();
    let (all, to) = chosen(handles, bounds, mode)?;
    let mut prepared = Prepared {
        layout: Layout {
            at: Vec::new(),
            sigma: Vec::new(),
            weight: Vec::new(),
            mode,
            background,
            regularize,
        },
        to: Vec::new(),
        places: Vec::new(),
        merged: Vec::new(),
        diagonal,
    };
    let mut originals = Vec::new();
    for (index, to) in to.into_iter().enumerate() {
        let (at, sigma) = (all.at[index], all.sigma[index]);
        let layout = &mut prepared.layout;
        let twin = (0..layout.at.len()).find(|&other| {
            let step = at - layout.at[other];
            let scaled = |axis: usize| step[axis] / sigma[axis].min(layout.sigma[other][axis]);
            Vector3::new(scaled(0), scaled(1), scaled(2)).norm() < SAME_PLACE
        });
        if let Some(twin) = twin {
            if (to - prepared.to[twin]).norm() > SAME_TARGET * diagonal {
                return Err(FfdError::Conflicting { first: originals[twin], second: index });
            }
            prepared.merged.push([index, originals[twin]]);
            prepared.places.push(twin);
            continue;
        }
        prepared.places.push(layout.at.len());
        originals.push(index);
        layout.at.push(at);
        layout.sigma.push(sigma);
        layout.weight.push(all.weight[index]);
        prepared.to.push(to);
    }
    Ok(prepared)
}

/// The handles in mm with every deviation, and where they go: deviations that were left out are 0.75 of the mean distance to
/// the three nearest handles, measured where the box is a unit cube, and in the absolute form the box's sides.
pub(crate) fn chosen(
    handles: &Handles,
    bounds: Bounds,
    mode: Mode,
) -> Result<(Layout, Vec<Point3<f64>>), FfdError> {
    let world = handles.in_world(bounds)?;
    let unit = Handle { at: [0.0; 3], to: None, sigma: Some([1.0; 3]), weight: 1.0 };
    let sides = Handles::new(HandleSpace::Box, &[unit])?.in_world(bounds)?.sigma()[0];
    let scaled: Vec<Vector3<f64>> =
        world.at().iter().map(|at| (at - bounds.0).component_div(&Vector3::from(sides))).collect();
    fn reach(index: usize, scaled: &[Vector3<f64>], mode: &Mode) -> f64 {
        let others = scaled.iter().map(|other| (other - scaled[index]).norm());
        let mut distances: Vec<f64> = others.filter(|distance| *distance > 0.0).collect();
        distances.sort_by(f64::total_cmp);
        distances.truncate(NEIGHBORS);
        let mean = distances.iter().sum::<f64>() / distances.len() as f64;
        if *mode == Mode::Absolute || !(0.0..f64::INFINITY).contains(&mean) {
            1.0
        } else {
            REACH * mean
        }
    }
    let layout = Layout {
        at: world.at().to_vec(),
        sigma: world
            .sigma()
            .iter()
            .enumerate()
            .map(|(index, given)| {
                if *given != [0.0; 3] {
                    return *given;
                }
                let reach = reach(index, &scaled, &mode);
                sides.map(|side| reach * side)
            })
            .collect(),
        weight: world.weight().to_vec(),
        mode,
        background: 0.0,
        regularize: 0.0,
    };
    Ok((layout, world.to().to_vec()))
}

/// The key of what is remembered.
impl Memo for Layout {
    const NAME: &'static str = "HandleLayout";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&(self.mode as u8)).plain(&[self.background, self.regularize]);
        to.counts(&[self.at.len()]);
        for index in 0..self.at.len() {
            let at: [f64; 3] = self.at[index].into();
            to.plain(&at).plain(&self.sigma[index]).plain(&self.weight[index]);
        }
    }

    fn size(&self) -> usize {
        self.at.len() * size_of::<[f64; 7]>()
    }
}
