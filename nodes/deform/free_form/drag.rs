//! Fast deformation for interactive dragging: everything that does not depend on the targets of the handles is computed once.
//!
//! A deformation is linear in the handles' targets. The effect that a unit step of one handle has on each point is called a field here: one
//! number per point, which depends only on the positions, deviations and weights of the handles. A drag adds multiples of fields to the
//! deformation before the drag, without evaluating any Gaussian.

use maquette_mesh::Movable;
use maquette_node::{Error, Progress};
use maquette_value::Memo;
use maquette_value::{Column, Encoder, Handles};
use nalgebra::{Matrix3, Point3};

use super::object::{bounds, field_request, points, rebuild};
use super::pull::{
    DeformOptions, column, deformation, deformed_field, make_report, prepare_handles,
};
use super::report::Report;
use crate::gaussian::deformation::{Base, Deformation};
use crate::gaussian::field::{CHUNK_SIZE, FieldRequest, evaluate_field};
use crate::gaussian::layout::{Layout, PreparedHandles};
use crate::gaussian::system::System;
use crate::mode::Mode;

/// Number of handles whose fields (effects on each point) are stored together. A point has three coordinates, so three fields are computed
/// like one deformation.
const GROUP_SIZE: usize = 3;

/// An object and its handles, some of which the user drags.
pub struct Drag {
    object: Movable,
    prepared: PreparedHandles,
    system: System,
    /// The indices in the layout of the dragged handles, without duplicates.
    dragged: Vec<usize>,
    /// The deformed points for the targets before the drag; `None` if all handles are at rest.
    rest: Option<FieldValues>,
    /// The fields of the dragged handles (effects of unit steps on each point), in groups of three.
    groups: Vec<FieldValues>,
}

/// The inputs from which the fields of a group of handles are computed. They serve as cache key.
#[derive(Clone)]
pub(crate) struct FieldInputs {
    points: Column<Point3<f64>>,
    prepared: PreparedHandles,
    /// The handles of the group; `None` for the deformation before the drag.
    group: Option<[Option<usize>; GROUP_SIZE]>,
    derivatives: bool,
    /// The maximum allowed error of a point in mm in the deformation before the drag. The fields of handles are exact.
    error: f64,
}

/// Three numbers for each point, and their derivatives if requested.
#[derive(Clone)]
pub(crate) struct FieldValues {
    values: Column<Point3<f64>>,
    derivatives: Column<Matrix3<f64>>,
}

impl Drag {
    /// Prepares an object for dragging the handles with the indices `dragged`, counted from 0; see [`ffd`](crate::ffd()).
    ///
    /// # Errors
    /// Returns the errors of [`ffd`](crate::ffd()), and an error if a handle does not exist.
    pub fn new(
        object: &Movable,
        handles: &Handles,
        dragged: &[usize],
        mode: Mode,
        options: DeformOptions,
    ) -> Result<Self, Error> {
        Self::with_memo(object, handles, dragged, mode, options, System::new, FieldInputs::make)
    }

    /// Like [`Drag::new`], but computes the linear system with `system` and the fields with `keep`; both functions may return cached
    /// results.
    pub(crate) fn with_memo(
        object: &Movable,
        handles: &Handles,
        dragged: &[usize],
        mode: Mode,
        options: DeformOptions,
        system: impl FnOnce(&Layout) -> Result<System, Error>,
        keep: impl Fn(&FieldInputs) -> Result<FieldValues, Error>,
    ) -> Result<Self, Error> {
        let origin = (Point3::origin(), Point3::origin());
        let frame = options.frame.or_else(|| bounds(object)).unwrap_or(origin);
        let prepared = prepare_handles(handles, frame, mode, options)?;
        let mut indices = Vec::new();
        for &handle in dragged {
            let index = prepared.layout_index(handle)?;
            if !indices.contains(&index) {
                indices.push(index);
            }
        }
        let rest_inputs = FieldInputs {
            points: column(object),
            prepared: prepared.clone(),
            group: None,
            derivatives: field_request(object).folds,
            error: options.accuracy * prepared.diagonal,
        };
        let rest = if prepared.is_at_rest() { None } else { Some(keep(&rest_inputs)?) };
        let groups = indices
            .chunks(GROUP_SIZE)
            .map(|group| {
                let group = Some([0, 1, 2].map(|k| group.get(k).copied()));
                keep(&FieldInputs { group, ..rest_inputs.clone() })
            })
            .collect::<Result<_, _>>()?;
        let system = system(&prepared.layout)?;
        Ok(Self { object: object.clone(), system, dragged: indices, rest, groups, prepared })
    }

    /// Returns the object deformed with new targets (handle index, position in mm). If `targets` has two entries for a handle, the later
    /// one counts. Handles that are not dragged keep their targets.
    ///
    /// # Errors
    /// Returns an error if a handle does not exist, a position becomes infinite, or the evaluation is cancelled.
    pub fn apply_targets(
        &self,
        targets: &[(usize, Point3<f64>)],
        progress: &Progress<'_>,
    ) -> Result<(Movable, Report), Error> {
        let now =
            self.prepared.clone().with_targets(targets, |index| self.dragged.contains(&index))?;
        if now.is_at_rest() {
            return Ok((self.object.clone(), Report { merged: now.merged, ..Report::UNCHANGED }));
        }
        let steps: Vec<_> = self
            .dragged
            .chunks(GROUP_SIZE)
            .map(|group| {
                Matrix3::from_fn(|axis, k| {
                    group.get(k).map_or(0.0, |&index| {
                        now.targets[index][axis] - self.prepared.targets[index][axis]
                    })
                })
            })
            .collect();
        let field = evaluate_field(
            points(&self.object),
            CHUNK_SIZE,
            field_request(&self.object),
            &|first, points, moved, derivatives| {
                self.add(&steps, first, points, moved, derivatives);
            },
            progress,
        )?;
        let deformation = deformation(&now, &self.system);
        let report = make_report(&now, &self.system, &deformation, &field);
        Ok((rebuild(&self.object, field)?, report))
    }

    /// Adds to the positions before the drag the displacements that the steps of the dragged handles cause, group by group.
    fn add(
        &self,
        steps: &[Matrix3<f64>],
        first: usize,
        points: &[Point3<f64>],
        moved: &mut [Point3<f64>],
        derivatives: Option<&mut [Matrix3<f64>]>,
    ) {
        let range = first..first + points.len();
        let rest = self.rest.as_ref().map_or(points, |rest| &rest.values[range.clone()]);
        moved.copy_from_slice(rest);
        for (group, step) in self.groups.iter().zip(steps) {
            for (moved, value) in moved.iter_mut().zip(&group.values[range.clone()]) {
                *moved += step * value.coords;
            }
        }
        let Some(derivatives) = derivatives else { return };
        match &self.rest {
            Some(rest) => derivatives.copy_from_slice(&rest.derivatives[range.clone()]),
            None => derivatives.fill(Matrix3::identity()),
        }
        for (group, step) in self.groups.iter().zip(steps) {
            for (derivative, slope) in derivatives.iter_mut().zip(&group.derivatives[range.clone()])
            {
                *derivative += step * slope;
            }
        }
    }
}

impl PreparedHandles {
    /// Replaces the targets of handles by `targets` (handle index, position). Targets of handles for whose layout index `may_change`
    /// returns false are ignored.
    pub(crate) fn with_targets(
        mut self,
        targets: &[(usize, Point3<f64>)],
        may_change: impl Fn(usize) -> bool,
    ) -> Result<Self, Error> {
        for &(handle, to) in targets {
            let index = self.layout_index(handle)?;
            if may_change(index) {
                self.targets[index] = to;
            }
        }
        Ok(self)
    }

    /// Returns the index that a handle has in the layout, given the handle's original index (before equal handles were merged).
    fn layout_index(&self, handle: usize) -> Result<usize, Error> {
        let handles = self.layout_indices.len();
        self.layout_indices.get(handle).copied().ok_or_else(|| missing_handle(handle, handles))
    }
}

/// Returns the error for a target of a handle that does not exist. `handles` is the number of handles.
pub(crate) fn missing_handle(handle: usize, handles: usize) -> Error {
    Error::new(format!(
        "there is no handle {handle} for a target: there are {handles} handles, numbered from 0"
    ))
}

/// Computes the fields of a group of handles, with the signature that the cache expects.
pub(crate) fn memo(inputs: &FieldInputs) -> Result<FieldValues, Error> {
    inputs.make()
}

impl FieldInputs {
    fn make(&self) -> Result<FieldValues, Error> {
        let system = System::new(&self.prepared.layout)?;
        let deformation = match &self.group {
            None => deformation(&self.prepared, &system),
            Some(group) => unit_steps(&self.prepared.layout, &system, group),
        };
        let request = FieldRequest { jacobians: self.derivatives, ..FieldRequest::default() };
        // The errors of a field are multiplied by the step of its handle, so only the deformation before the drag may be inaccurate.
        let error = if self.group.is_some() { 0.0 } else { self.error };
        let field =
            deformed_field(&deformation, &self.points, request, error, &Progress::silent())?;
        Ok(FieldValues { values: field.positions.into(), derivatives: field.jacobians.into() })
    }
}

/// Returns a deformation in which each coordinate is the effect of a unit step of one of the group's three handles.
fn unit_steps(
    layout: &Layout,
    system: &System,
    group: &[Option<usize>; GROUP_SIZE],
) -> Deformation {
    let n = layout.positions.len();
    let solutions = group.map(|index: Option<usize>| {
        system.solve((0..n).map(|row| if Some(row) == index { 1.0 } else { 0.0 }))
    });
    let values =
        (0..n).map(|k: usize| [0, 1, 2].map(|axis| solutions[axis].coefficients[k])).collect();
    let terms = [0, 1, 2].map(|axis| &solutions[axis].polynomial[..]);
    let base = Base { affine: system.polynomial.combine(terms), ..Base::keep(0.0) };
    Deformation::new(layout.gaussians(), values, base)
}

/// The inputs are the cache key of the fields.
impl Memo for FieldInputs {
    const NAME: &'static str = "DragPart";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.points).memo(&self.prepared.layout);
        to.plain(&self.error).plain(&u8::from(self.derivatives));
        match &self.group {
            Some(group) => {
                to.plain(&1_u8);
                to.counts(&group.map(|index| index.map_or(0, |index| index + 1)));
            }
            // Only the deformation before the drag depends on the targets; the fields of handles do not.
            None => {
                to.plain(&0_u8);
                for target in &self.prepared.targets {
                    let target: [f64; 3] = (*target).into();
                    to.plain(&target);
                }
            }
        }
    }

    fn size(&self) -> usize {
        self.points.size() + self.prepared.layout.size()
    }
}

/// The fields are cached for the next drag of the same handles.
impl Memo for FieldValues {
    const NAME: &'static str = "DragFields";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.values).column(&self.derivatives);
    }

    fn size(&self) -> usize {
        self.values.size() + self.derivatives.size()
    }
}
