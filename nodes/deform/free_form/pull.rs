//! Free-form deformation by handles, with rational Gaussian functions.

use std::ops::Range;

use maquette_mesh::Movable;
use maquette_node::{CancelledError, Error, Progress, bail};
use maquette_value::{Column, Handles};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::object::{bounds, field_request, points, rebuild};
use super::reach::{Boxes, gather_rows};
use super::report::Report;
use crate::gaussian::cells::Cells;
use crate::gaussian::deformation::{Base, Deformation};
use crate::gaussian::field::{CHUNK_SIZE, Field, FieldRequest, evaluate_field};
use crate::gaussian::layout::{Bounds, Layout, PreparedHandles, prepare};
use crate::gaussian::system::System;
use crate::mode::Mode;

/// The options of a deformation in addition to its handles and mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "Deforming")]
pub struct DeformOptions {
    /// Weight of the undeformed object relative to the weights of the handles. With more than 0, the effect of a handle vanishes at some
    /// deviations from it. Only for `mode: Displacement`.
    #[schemars(range(min = 0.0))]
    #[serde(default)]
    pub background: f64,
    /// With more than 0, handles may miss their targets to keep the deformation smooth: the squared misses are minimized together with the
    /// squared coefficients, which are weighted by the square of this value. For handles that are too close together to be met exactly.
    #[schemars(range(min = 0.0))]
    #[serde(default)]
    pub regularize: f64,
    /// Maximum error of a point, in diagonals of the box. With more than 0, handles that are too far from a point to matter are ignored,
    /// which is faster for small deviations; with 0, all handles count everywhere. In combination with a `background`, points that no
    /// handle moves by more than the maximum error stay exactly unchanged, and moving a handle costs only the points that it moves.
    #[schemars(range(min = 0.0, max = 0.001))]
    #[serde(default)]
    pub accuracy: f64,
    /// The box to which the handles' space refers, in mm; if `None`, the object's bounding box.
    #[serde(skip)]
    pub frame: Option<Bounds>,
}

/// Moves each handle to its target, and deforms `object`; see [`Ffd`](crate::Ffd).
///
/// The handles are in mm or relative to the box `options.frame`; `mode` is the quantity that they blend. Positions are in the unit of the
/// object, mm. With `options.accuracy` above 0, the error of a point is less than `accuracy` times the box's diagonal.
///
/// The absolute form is that of Yoshida, Kanou and Kitajima, free-form deformation by rational Gaussian functions (equations 4 to 7). The
/// other forms solve for coefficients as usual with radial basis functions.
///
/// # Errors
/// Returns an error if handles conflict, are so close together that the equations cannot be solved, or are too many; if a parameter is not
/// valid; if a position becomes infinite; or if the evaluation is cancelled.
pub fn ffd(
    object: &Movable,
    handles: &Handles,
    mode: Mode,
    options: DeformOptions,
    progress: &Progress<'_>,
) -> Result<(Movable, Report), Error> {
    let Some(frame) = options.frame.or_else(|| bounds(object)) else {
        return Ok((object.clone(), Report::UNCHANGED));
    };
    let prepared = prepare_handles(handles, frame, mode, options)?;
    let boxes = options.is_limited().then(|| Boxes::new(points(object)));
    deform_prepared(object, &prepared, options, boxes.as_ref(), System::new, progress)
}

impl DeformOptions {
    /// Returns true if the effect of the handles is limited: points beyond their reach keep their exact positions.
    pub(crate) fn is_limited(&self) -> bool {
        self.background > 0.0 && self.accuracy > 0.0
    }
}

/// Checks the options and prepares the handles.
pub(crate) fn prepare_handles(
    handles: &Handles,
    frame: Bounds,
    mode: Mode,
    options: DeformOptions,
) -> Result<PreparedHandles, Error> {
    if !(0.0..1.0).contains(&options.accuracy) {
        bail!("`accuracy` is {}, but it must be 0 or more and less than 1", options.accuracy);
    }
    prepare(handles, frame, mode, options.background, options.regularize)
}

/// Deforms an object with a linear system computed by `system`. If the effect of the handles [is limited](DeformOptions::is_limited),
/// `boxes` has the bounding boxes of the rows of points; otherwise it is `None`.
pub(crate) fn deform_prepared(
    object: &Movable,
    prepared: &PreparedHandles,
    options: DeformOptions,
    boxes: Option<&Boxes>,
    system: impl FnOnce(&Layout) -> Result<System, Error>,
    progress: &Progress<'_>,
) -> Result<(Movable, Report), Error> {
    if prepared.is_at_rest() {
        let merged = prepared.merged.clone();
        return Ok((object.clone(), Report { merged, ..Report::UNCHANGED }));
    }
    let system = system(&prepared.layout)?;
    let deformation = deformation(prepared, &system);
    let error = options.accuracy * prepared.diagonal;
    let (points, request) = (points(object), field_request(object));
    let reached =
        boxes.filter(|_| !request.jacobians).map(|boxes| boxes.reached_rows(&deformation, error));
    let field = match reached {
        Some(rows) => reached_field(&deformation, points, rows, request, error, progress),
        None => deformed_field(&deformation, points, request, error, progress),
    }?;
    let report = make_report(prepared, &system, &deformation, &field);
    Ok((rebuild(object, field)?, report))
}

pub(crate) fn make_report(
    prepared: &PreparedHandles,
    system: &System,
    deformation: &Deformation,
    field: &Field,
) -> Report {
    Report {
        condition: system.condition(),
        residual: residual(prepared, deformation),
        merged: prepared.merged.clone(),
        folded: field.folded.iter().filter(|flag| **flag == 1).count(),
        min_determinant: field.min_determinant,
    }
}

impl PreparedHandles {
    /// Returns true if all handles are at rest, so that no point moves. In the absolute form handles at rest move points, so the result is
    /// false unless there are no handles.
    pub(crate) fn is_at_rest(&self) -> bool {
        let moves = self.layout.mode == Mode::Absolute || self.layout.positions != self.targets;
        self.targets.is_empty() || !moves
    }
}

/// Returns the deformation that moves each handle to its target.
pub(crate) fn deformation(prepared: &PreparedHandles, system: &System) -> Deformation {
    let PreparedHandles { layout, targets: to, .. } = prepared;
    let gaussians = layout.gaussians();
    // In the absolute form the initial coefficients are the positions of the handles, which are multiplied by these weights. In the other
    // forms the initial coefficients are 0.
    let weights = (layout.mode == Mode::Absolute)
        .then(|| layout.positions.iter().map(|&at| gaussians.weights(at)).collect::<Vec<_>>());
    let solutions = [0, 1, 2].map(|axis: usize| {
        system.solve(to.iter().enumerate().map(|(row, to)| match &weights {
            None => to[axis] - layout.positions[row][axis],
            Some(weights) => {
                let reached = weights[row]
                    .iter()
                    .enumerate()
                    .map(|(k, weight)| weight * layout.initial_coefficient(k, axis));
                to[axis] - reached.sum::<f64>()
            }
        }))
    });
    let mut base = Base::keep(if layout.mode == Mode::Absolute { 0.0 } else { 1.0 });
    base.affine = system.polynomial.combine([0, 1, 2].map(|axis| &solutions[axis].polynomial[..]));
    Deformation::new(
        gaussians,
        (0..to.len())
            .map(|index: usize| {
                [0, 1, 2].map(|axis| {
                    layout.initial_coefficient(index, axis) + solutions[axis].coefficients[index]
                })
            })
            .collect(),
        base,
    )
}

impl Layout {
    /// Returns the initial coefficient of a handle along an axis. The solution of the linear system is added to this initial coefficient.
    fn initial_coefficient(&self, index: usize, axis: usize) -> f64 {
        match self.mode {
            Mode::Absolute => self.positions[index][axis],
            Mode::Displacement | Mode::Affine => 0.0,
        }
    }
}

/// Returns the maximum distance between the deformed position of a handle and its target, in mm.
pub(crate) fn residual(prepared: &PreparedHandles, deformation: &Deformation) -> f64 {
    let mut moved = vec![Point3::origin(); prepared.targets.len()];
    deformation.apply(&deformation.terms, &prepared.layout.positions, &mut moved, None);
    moved.iter().zip(&prepared.targets).map(|(moved, to)| (moved - to).norm()).fold(0.0, f64::max)
}

/// Evaluates a deformation at points. The error of each position is less than `error` mm; 0 means exact.
pub(crate) fn deformed_field(
    deformation: &Deformation,
    points: &[Point3<f64>],
    request: FieldRequest<'_>,
    error: f64,
    progress: &Progress<'_>,
) -> Result<Field, CancelledError> {
    let cells = relevant_cells(deformation, points, error);
    let chunk = cells.as_ref().map_or(CHUNK_SIZE, |cells| cells.chunk().max(CHUNK_SIZE));
    evaluate_field(
        points,
        chunk,
        request,
        &|_, points, moved, jacobians| match &cells {
            Some(cells) => cells.apply(deformation, points, moved, jacobians),
            None => deformation.apply(&deformation.terms, points, moved, jacobians),
        },
        progress,
    )
}

/// Evaluates a deformation at the points in the given rows. All other points keep their positions.
fn reached_field(
    deformation: &Deformation,
    points: &[Point3<f64>],
    rows: Vec<Range<u32>>,
    request: FieldRequest<'_>,
    error: f64,
    progress: &Progress<'_>,
) -> Result<Field, CancelledError> {
    let near = gather_rows(points, &rows);
    let normals = request.normals.map(|normals| gather_rows(normals, &rows));
    let request = FieldRequest { normals: normals.as_deref(), ..request };
    let field = deformed_field(deformation, &near, request, error, progress)?;
    let min_determinant = if near.len() < points.len() && request.folds {
        field.min_determinant.min(1.0)
    } else {
        field.min_determinant
    };
    Ok(Field { rows: Some(rows), min_determinant, ..field })
}

/// Returns cells of space that ignore Gaussians whose effect in the cell is less than `error` mm; `None` if all Gaussians are used.
fn relevant_cells(deformation: &Deformation, points: &[Point3<f64>], error: f64) -> Option<Cells> {
    if error <= 0.0 {
        return None;
    }
    let bounds = super::object::bounds_of(points)?;
    let values: Vec<Vector3<f64>> =
        deformation.terms.iter().map(|term| term.value.into()).collect();
    // Without a background the weights sum up to 1, so a value common to all coefficients contributes the same with or without the ignored
    // terms. Subtract this common value.
    let common = if deformation.background > 0.0 {
        Vector3::zeros()
    } else {
        values.iter().sum::<Vector3<f64>>() / values.len() as f64
    };
    let greatest = values.iter().map(|value| (value - common).norm()).fold(0.0, f64::max);
    let fraction = error / (2.0 * greatest);
    (fraction > 0.0).then(|| Cells::new(deformation, bounds, points.len(), fraction.min(0.5)))
}

/// Returns the points of an object as a column, which can be hashed for a cache key.
pub(crate) fn column(object: &Movable) -> Column<Point3<f64>> {
    match object {
        Movable::Mesh(mesh) => mesh.positions().clone(),
        Movable::Points(points) => points.positions().clone(),
        Movable::Curve(curve) => curve.points().clone(),
        Movable::RangeImage(range) => range.points().to_vec().into(),
        Movable::ControlNet(net) => net.points().to_vec().into(),
    }
}
