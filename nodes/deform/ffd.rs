//! Free-form deformation by handles, with rational Gaussian functions.

use maquette::value::{Column, Handle, HandleSpace, Handles};
use maquette::{Cancelled, Context, Error, In, Node, Progress};
use nalgebra::{Matrix3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cells::Cells;
use super::deformation::{Base, Deformation};
use super::drag::{self, Drag};
use super::ffd_error::FfdError;
use super::field::{CHUNK, Field, Wanted, field};
use super::layout::{Bounds, Prepared, prepare};
use super::object::{bounds, points, rebuilt, wanted};
use super::system::System;
use crate::mesh::Movable;

/// Pulls an object by handles: each goes to its target, and takes along what is around it.
///
/// Every point is shared out among the handles by rational Gaussian functions: the nearer a handle, measured in its deviations,
/// the greater its share. Any number of handles may stand anywhere, also outside of the object. Influence is relative: far from
/// all of them the nearest one takes everything along, so that a single handle moves the whole object. To confine a pull,
/// add handles that stay, or a `background`.
///
/// The result has the type of what came in. Normals turn along. Where space is turned inside out there is a warning, and the
/// vertices of a mesh are marked by the attribute `folded`. Of a control net the fixed points and the base points stay, so that
/// a blend takes the deformation back to the scan; of a B-spline the control points move, which is near to moving the curve.
/// Cells and texture coordinates stay, as does the camera.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Ffd {
    /// What is deformed: a mesh, a range image, points, a curve or a control net.
    pub mesh: In<Movable>,
    /// Handles from elsewhere, before those that stand here.
    pub layout: Option<In<Handles>>,
    /// What the box of the handles is around, if not what is deformed: so that several things are deformed alike.
    pub frame: Option<In<Movable>>,
    /// Handles.
    #[serde(default)]
    pub handles: Vec<Handle>,
    /// Other targets for some handles. What all others do is remembered, so that changing these takes a fraction of the time.
    #[serde(default)]
    pub targets: Vec<Target>,
    /// What the handles share out.
    #[serde(default)]
    pub mode: Mode,
    /// The space of `handles` and `targets`; those of `layout` have their own.
    #[serde(default)]
    pub space: HandleSpace,
    /// How much stays where it is, as a weight beside those of the handles: with more than 0 their pull ends at some deviations
    /// from them. Only for displacements.
    #[schemars(range(min = 0.0))]
    #[serde(default)]
    pub background: f64,
    /// With more than 0, handles may miss their targets to keep the deformation calm: the weight of the coefficients beside
    /// that of the misses, squared. For handles so close together that they could not be met otherwise.
    #[schemars(range(min = 0.0))]
    #[serde(default)]
    pub regularize: f64,
    /// How far a point may land from where it should, in diagonals of the box. With more than 0, handles too far from a point
    /// to matter are left out, which is faster for small deviations; with 0 all of them count everywhere.
    #[schemars(range(min = 0.0, max = 0.001))]
    #[serde(default)]
    pub accuracy: f64,
}

/// Another target for a handle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// Which: counted from 0, those of `layout` before those of `handles`.
    pub handle: u32,
    /// Where it goes instead.
    pub to: [f64; 3],
}

/// What handles share out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Mode {
    /// How far they move: handles that stay leave everything as it is.
    #[default]
    Displacement,
    /// Where they are, as published: even handles that stay squeeze the object, the more the smaller their deviations are.
    Absolute,
    /// How far they move beside the affine motion that fits best: handles that are moved, turned, scaled or sheared as one do
    /// so with the whole object.
    Affine,
}

/// How an object is deformed, beside its handles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deforming {
    /// What handles share out.
    pub mode: Mode,
    /// How much stays where it is; see [`Ffd::background`].
    pub background: f64,
    /// How much handles may miss; see [`Ffd::regularize`].
    pub regularize: f64,
    /// How far a point may land from where it should, in diagonals of the box.
    pub accuracy: f64,
    /// The box that the handles' space is of, in mm; the object's own if none.
    pub frame: Option<Bounds>,
}

/// What is to be known of a deformation.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The condition of the system that was solved, estimated in the 1-norm.
    pub condition: f64,
    /// The farthest that a handle is from its target, in mm.
    pub residual: f64,
    /// Handles that are at one place and go to one target, and so count as one: the later and the earlier.
    pub merged: Vec<[usize; 2]>,
    /// Points at which space is turned inside out.
    pub folded: usize,
    /// The least determinant of the derivatives at a point; infinite where they were not needed.
    pub least: f64,
}

impl Node for Ffd {
    type Outputs = (Movable,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let what = cx.get(&self.mesh);
        let frame = self.frame.as_ref().and_then(|frame| bounds(&cx.get(frame)));
        let Some(frame) = frame.or_else(|| bounds(&what)) else { return Ok((what,)) };
        let how = Deforming {
            mode: self.mode,
            background: self.background,
            regularize: self.regularize,
            accuracy: self.accuracy,
            frame: Some(frame),
        };
        let layout = self.layout.as_ref().map(|layout| cx.get(layout));
        let handles = self.all_handles(layout, frame)?;
        let (deformed, report) = if self.targets.is_empty() {
            let prepared = prepared(&handles, frame, how)?;
            let system = |layout: &_| cx.memo(layout, System::memo);
            deform(&what, &prepared, how, system, cx.progress())?
        } else {
            let targets = self.targets_in_world(frame)?;
            let dragged = Vec::from_iter(targets.iter().map(|(handle, _)| *handle));
            let system = |layout: &_| cx.memo(layout, System::memo);
            let keep = |part: &_| cx.memo(part, drag::memo);
            let drag = Drag::with(&what, &handles, &dragged, how, system, keep)?;
            drag.to(&targets, cx.progress())?
        };
        report.warn(&what, frame, cx);
        Ok((deformed,))
    }
}

impl Ffd {
    fn all_handles(&self, layout: Option<&Handles>, frame: Bounds) -> Result<Handles, FfdError> {
        let own = Handles::new(self.space, &self.handles)?.in_world(frame)?;
        let Some(layout) = layout else { return Ok(own) };
        let all = Vec::from_iter(layout.in_world(frame)?.iter().chain(own.iter()));
        Ok(Handles::new(HandleSpace::World, &all)?)
    }

    fn targets_in_world(&self, frame: Bounds) -> Result<Vec<(usize, Point3<f64>)>, FfdError> {
        let places = self.targets.iter().map(|target| Handle {
            at: target.to,
            to: None,
            sigma: None,
            weight: 1.0,
        });
        let places = Handles::new(self.space, &Vec::from_iter(places))?.in_world(frame)?;
        let numbers = self.targets.iter().map(|target| target.handle as usize);
        Ok(numbers.zip(places.at().iter().copied()).collect())
    }
}

impl Report {
    fn warn(&self, what: &Movable, frame: Bounds, cx: &Context<'_>) {
        for [later, earlier] in &self.merged {
            cx.warn(format!("handles {earlier} and {later} are at one place and count as one"));
        }
        let diagonal = (frame.1 - frame.0).norm();
        if self.residual > NEAR_ENOUGH * diagonal {
            cx.warn(format!(
                "handles miss their targets by up to {:.2e} mm (condition {:.1e})",
                self.residual, self.condition
            ));
        }
        if self.folded > 0 {
            let count = points(what).len();
            let marks = if matches!(what, Movable::Mesh(_) | Movable::Points(_)) {
                ", marked by the attribute `folded`"
            } else {
                ""
            };
            cx.warn(format!(
                "space is turned inside out at {} of {count} points{marks}; the least determinant is {:.2e}",
                self.folded, self.least
            ));
        }
    }
}

/// From this miss on, in diagonals of the box, a handle is not where somebody put it.
const NEAR_ENOUGH: f64 = 1e-9;

/// Moves each handle to its target, and `what` along; see [`Ffd`].
///
/// Handles are in mm or in the box `how.frame`. Yoshida, Kanou and Kitajima, free-form deformation by rational Gaussian
/// functions (equations 4 to 7); the other forms than the absolute one are as for radial basis functions. Positions have the
/// unit of the object, mm. With `how.accuracy` above 0, a point is off by less than that many diagonals of the box.
///
/// # Errors
/// If handles conflict, are too close together to be solved for, or too many; if a number is not one; if a place becomes
/// infinite; if `progress` says so.
pub fn ffd(
    what: &Movable,
    handles: &Handles,
    how: Deforming,
    progress: &Progress<'_>,
) -> Result<(Movable, Report), FfdError> {
    let Some(frame) = how.frame.or_else(|| bounds(what)) else {
        return Ok((what.clone(), Report::NOTHING));
    };
    let prepared = prepared(handles, frame, how)?;
    deform(what, &prepared, how, System::new, progress)
}

impl Report {
    /// Nothing was done.
    pub(super) const NOTHING: Self =
        Self { condition: 1.0, residual: 0.0, merged: Vec::new(), folded: 0, least: f64::INFINITY };
}

/// The handles made ready, and the numbers checked.
pub(super) fn prepared(
    handles: &Handles,
    frame: Bounds,
    how: Deforming,
) -> Result<Prepared, FfdError> {
    if !(0.0..1.0).contains(&how.accuracy) {
        return Err(FfdError::Accuracy { accuracy: how.accuracy });
    }
    prepare(handles, frame, how.mode, how.background, how.regularize)
}

/// Deforms with a system from `system`.
fn deform<E: From<FfdError>>(
    what: &Movable,
    prepared: &Prepared,
    how: Deforming,
    system: impl FnOnce(&super::layout::Layout) -> Result<System, E>,
    progress: &Progress<'_>,
) -> Result<(Movable, Report), E> {
    if prepared.rests() {
        let merged = prepared.merged.clone();
        return Ok((what.clone(), Report { merged, ..Report::NOTHING }));
    }
    let system = system(&prepared.layout)?;
    let deformation = deformation(prepared, &system);
    let field = deformed_field(
        &deformation,
        points(what),
        wanted(what),
        how.accuracy * prepared.diagonal,
        progress,
    )
    .map_err(FfdError::from)?;
    let report = report(prepared, &system, &deformation, &field);
    Ok((rebuilt(what, field)?, report))
}

pub(super) fn report(
    prepared: &Prepared,
    system: &System,
    deformation: &Deformation,
    field: &Field,
) -> Report {
    Report {
        condition: system.condition(),
        residual: residual(prepared, deformation),
        merged: prepared.merged.clone(),
        folded: field.folded.iter().filter(|flag| **flag == 1).count(),
        least: field.least,
    }
}

impl Prepared {
    /// Whether everything stays where it is.
    pub(super) fn rests(&self) -> bool {
        let moves = self.layout.mode == Mode::Absolute || self.layout.at != self.to;
        self.to.is_empty() || !moves
    }
}

/// What takes each handle to its target.
pub(super) fn deformation(prepared: &Prepared, system: &System) -> Deformation {
    let Prepared { layout, to, .. } = prepared;
    let gaussians = layout.gaussians();
    let start = |index: usize, axis: usize| match layout.mode {
        Mode::Absolute => layout.at[index][axis],
        Mode::Displacement | Mode::Affine => 0.0,
    };
    // What the coefficients do from which the solution starts: the handles' places in the absolute form, else nothing.
    let shares = (layout.mode == Mode::Absolute)
        .then(|| Vec::from_iter(layout.at.iter().map(|&at| gaussians.shares(at))));
    let missing = |axis: usize| {
        let shares = &shares;
        to.iter().enumerate().map(move |(row, to)| match shares {
            None => to[axis] - layout.at[row][axis],
            Some(shares) => {
                let there = shares[row].iter().enumerate().map(|(k, share)| share * start(k, axis));
                to[axis] - there.sum::<f64>()
            }
        })
    };
    let solutions = [0, 1, 2].map(|axis| system.solve(missing(axis)));
    let value = |index: usize| {
        [0, 1, 2].map(|axis| start(index, axis) + solutions[axis].coefficients[index])
    };
    let mut base = Base::keep(if layout.mode == Mode::Absolute { 0.0 } else { 1.0 });
    base.affine = system.polynomial.combine([0, 1, 2].map(|axis| &solutions[axis].polynomial[..]));
    Deformation::new(gaussians, (0..to.len()).map(value).collect(), base)
}

/// The farthest that a handle is from its target.
fn residual(prepared: &Prepared, deformation: &Deformation) -> f64 {
    let mut there = vec![Point3::origin(); prepared.to.len()];
    deformation.apply(&deformation.terms, &prepared.layout.at, &mut there, None);
    there.iter().zip(&prepared.to).map(|(there, to)| (there - to).norm()).fold(0.0, f64::max)
}

/// A deformation on points, off by less than `error` mm.
pub(super) fn deformed_field(
    deformation: &Deformation,
    points: &[Point3<f64>],
    wanted: Wanted<'_>,
    error: f64,
    progress: &Progress<'_>,
) -> Result<Field, Cancelled> {
    let cells = relevant_cells(deformation, points, error);
    let evaluate = |_: usize,
                    points: &[Point3<f64>],
                    moved: &mut [Point3<f64>],
                    jacobians: Option<&mut [Matrix3<f64>]>| match &cells {
        Some(cells) => cells.apply(deformation, points, moved, jacobians),
        None => deformation.apply(&deformation.terms, points, moved, jacobians),
    };
    let chunk = cells.as_ref().map_or(CHUNK, |cells| cells.chunk().max(CHUNK));
    field(points, chunk, wanted, &evaluate, progress)
}

/// Cells that leave out what changes places by less than `error`; none where all terms are to count.
fn relevant_cells(deformation: &Deformation, points: &[Point3<f64>], error: f64) -> Option<Cells> {
    if error <= 0.0 {
        return None;
    }
    let bounds = super::object::bounds_of(points)?;
    let values = || deformation.terms.iter().map(|term| Vector3::from(term.value));
    // Without a background a common part of all coefficients is the same whatever is left out.
    let common = if deformation.background > 0.0 {
        Vector3::zeros()
    } else {
        values().sum::<Vector3<f64>>() / deformation.terms.len() as f64
    };
    let greatest = values().map(|value| (value - common).norm()).fold(0.0, f64::max);
    let share = error / (2.0 * greatest);
    (share > 0.0).then(|| Cells::new(deformation, bounds, points.len(), share.min(0.5)))
}

/// The points of an object as a column that can be part of a key.
pub(super) fn column(what: &Movable) -> Column<Point3<f64>> {
    match what {
        Movable::Mesh(mesh) => mesh.positions().clone(),
        Movable::Points(points) => points.positions().clone(),
        Movable::Curve(curve) => curve.points().clone(),
        Movable::RangeImage(range) => range.points().to_vec().into(),
        Movable::ControlNet(net) => net.points().to_vec().into(),
    }
}
