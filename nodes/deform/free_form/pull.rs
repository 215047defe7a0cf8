//! Free-form deformation by handles, with rational Gaussian functions.

use std::ops::Range;

use maquette_mesh::Movable;
use maquette_node::{Cancelled, Progress};
use maquette_value::{Column, Handles};
use nalgebra::{Matrix3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::object::{bounds, points, rebuilt, wanted};
use super::reach::{Boxes, gathered};
use super::report::Report;
use crate::ffd_error::FfdError;
use crate::gaussian::cells::Cells;
use crate::gaussian::deformation::{Base, Deformation};
use crate::gaussian::field::{CHUNK, Field, Wanted, field};
use crate::gaussian::layout::{Bounds, Prepared, prepare};
use crate::gaussian::system::System;
use crate::mode::Mode;

/// How an object is deformed, beside its handles and what these share out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Deforming {
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
    /// to matter are left out, which is faster for small deviations; with 0 all of them count everywhere. With a `background`, too,
    /// what none of them moves farther than that stays exactly where it is, and a moved handle costs what it moves.
    #[schemars(range(min = 0.0, max = 0.001))]
    #[serde(default)]
    pub accuracy: f64,
    /// The box that the handles' space is of, in mm; the object's own if none.
    #[serde(skip)]
    pub frame: Option<Bounds>,
}

/// Moves each handle to its target, and `what` along; see [`Ffd`](crate::Ffd).
///
/// Handles share out what `mode` says, and are in mm or in the box `how.frame`. Yoshida, Kanou and Kitajima, free-form
/// deformation by rational Gaussian functions (equations 4 to 7); the other forms than the absolute one are as for radial basis
/// functions. Positions have the unit of the object, mm. With `how.accuracy` above 0, a point is off by less than that many
/// diagonals of the box.
///
/// # Errors
/// If handles conflict, are too close together to be solved for, or too many; if a number is not one; if a place becomes
/// infinite; if `progress` says so.
pub fn ffd(
    what: &Movable,
    handles: &Handles,
    mode: Mode,
    how: Deforming,
    progress: &Progress<'_>,
) -> Result<(Movable, Report), FfdError> {
    let Some(frame) = how.frame.or_else(|| bounds(what)) else {
        return Ok((what.clone(), Report::NOTHING));
    };
    let prepared = prepared(handles, frame, mode, how)?;
    let boxes = how.ends().then(|| Boxes::new(points(what)));
    deform(what, &prepared, how, boxes.as_ref(), System::new, progress)
}

impl Deforming {
    /// Whether the handles' pull ends somewhere, so that what is beyond stays to the bit.
    pub(crate) fn ends(&self) -> bool {
        self.background > 0.0 && self.accuracy > 0.0
    }
}

/// The handles made ready, and the numbers checked.
pub(crate) fn prepared(
    handles: &Handles,
    frame: Bounds,
    mode: Mode,
    how: Deforming,
) -> Result<Prepared, FfdError> {
    if !(0.0..1.0).contains(&how.accuracy) {
        return Err(FfdError::Accuracy { accuracy: how.accuracy });
    }
    prepare(handles, frame, mode, how.background, how.regularize)
}

/// Deforms with a system from `system`, where the pull [ends](Deforming::ends) with the `boxes` of the points.
pub(crate) fn deform<E: From<FfdError>>(
    what: &Movable,
    prepared: &Prepared,
    how: Deforming,
    boxes: Option<&Boxes>,
    system: impl FnOnce(&crate::gaussian::layout::Layout) -> Result<System, E>,
    progress: &Progress<'_>,
) -> Result<(Movable, Report), E> {
    if prepared.rests() {
        let merged = prepared.merged.clone();
        return Ok((what.clone(), Report { merged, ..Report::NOTHING }));
    }
    let system = system(&prepared.layout)?;
    let deformation = deformation(prepared, &system);
    let error = how.accuracy * prepared.diagonal;
    let (points, wanted) = (points(what), wanted(what));
    let reached =
        boxes.filter(|_| !wanted.jacobians).map(|boxes| boxes.reached(&deformation, error));
    let field = match reached {
        Some(rows) => reached_field(&deformation, points, rows, wanted, error, progress),
        None => deformed_field(&deformation, points, wanted, error, progress),
    };
    let field = field.map_err(FfdError::from)?;
    let report = report(prepared, &system, &deformation, &field);
    Ok((rebuilt(what, field)?, report))
}

pub(crate) fn report(
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
    pub(crate) fn rests(&self) -> bool {
        let moves = self.layout.mode == Mode::Absolute || self.layout.at != self.to;
        self.to.is_empty() || !moves
    }
}

/// What takes each handle to its target.
pub(crate) fn deformation(prepared: &Prepared, system: &System) -> Deformation {
    let Prepared { layout, to, .. } = prepared;
    let gaussians = layout.gaussians();
    fn start(index: usize, axis: usize, layout_at: &[Point3<f64>], layout_mode: &Mode) -> f64 {
        match *layout_mode {
            Mode::Absolute => layout_at[index][axis],
            Mode::Displacement | Mode::Affine => 0.0,
        }
    }
    // What the coefficients do from which the solution starts: the handles' places in the absolute form, else nothing.
    let shares = (layout.mode == Mode::Absolute)
        .then(|| layout.at.iter().map(|&at| gaussians.shares(at)).collect::<Vec<_>>());
    let missing = |axis: usize| {
        let shares = &shares;
        to.iter().enumerate().map(move |(row, to)| match shares {
            None => to[axis] - layout.at[row][axis],
            Some(shares) => {
                let there = shares[row]
                    .iter()
                    .enumerate()
                    .map(|(k, share)| share * start(k, axis, &layout.at, &layout.mode));
                to[axis] - there.sum::<f64>()
            }
        })
    };
    let solutions = [0, 1, 2].map(|axis| system.solve(missing(axis)));
    let mut base = Base::keep(if layout.mode == Mode::Absolute { 0.0 } else { 1.0 });
    base.affine = system.polynomial.combine([0, 1, 2].map(|axis| &solutions[axis].polynomial[..]));
    Deformation::new(
        gaussians,
        (0..to.len())
            .map(|index: usize| {
                [0, 1, 2].map(|axis| {
                    start(index, axis, &layout.at, &layout.mode)
                        + solutions[axis].coefficients[index]
                })
            })
            .collect(),
        base,
    )
}

/// The farthest that a handle is from its target.
pub(crate) fn residual(prepared: &Prepared, deformation: &Deformation) -> f64 {
    let mut there = vec![Point3::origin(); prepared.to.len()];
    deformation.apply(&deformation.terms, &prepared.layout.at, &mut there, None);
    there.iter().zip(&prepared.to).map(|(there, to)| (there - to).norm()).fold(0.0, f64::max)
}

/// A deformation on points, off by less than `error` mm.
pub(crate) fn deformed_field(
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

/// A deformation on the points in these rows; the others stay.
fn reached_field(
    deformation: &Deformation,
    points: &[Point3<f64>],
    rows: Vec<Range<u32>>,
    wanted: Wanted<'_>,
    error: f64,
    progress: &Progress<'_>,
) -> Result<Field, Cancelled> {
    let near = gathered(points, &rows);
    let normals = wanted.normals.map(|normals| gathered(normals, &rows));
    let wanted = Wanted { normals: normals.as_deref(), ..wanted };
    let field = deformed_field(deformation, &near, wanted, error, progress)?;
    let least =
        if near.len() < points.len() && wanted.folds { field.least.min(1.0) } else { field.least };
    Ok(Field { rows: Some(rows), least, ..field })
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
pub(crate) fn column(what: &Movable) -> Column<Point3<f64>> {
    match what {
        Movable::Mesh(mesh) => mesh.positions().clone(),
        Movable::Points(points) => points.positions().clone(),
        Movable::Curve(curve) => curve.points().clone(),
        Movable::RangeImage(range) => range.points().to_vec().into(),
        Movable::ControlNet(net) => net.points().to_vec().into(),
    }
}
