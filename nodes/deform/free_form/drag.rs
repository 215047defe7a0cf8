//! Targets that change while everything else stays: what does not depend on them is computed once.
//!
//! A deformation is linear in its targets. What a unit step of one handle does to each point is a field of numbers that depends
//! on the layout alone; a drag adds multiples of such fields to what the handles do at rest, without a single power.

use maquette_mesh::Movable;
use maquette_node::{Error, Progress};
use maquette_value::Memo;
use maquette_value::{Column, Encoder, Handles};
use nalgebra::{Matrix3, Point3};

use super::object::{bounds, points, rebuilt, wanted};
use super::pull::{Deforming, column, deformation, deformed_field, prepared, report};
use super::report::Report;
use crate::FfdError;
use crate::gaussian::deformation::{Base, Deformation};
use crate::gaussian::field::{CHUNK, Wanted, field};
use crate::gaussian::layout::{Layout, Prepared};
use crate::gaussian::system::System;
use crate::mode::Mode;

/// Fields that are kept together: as many as a point has coordinates, so that a group of them is computed like a deformation.
const GROUP: usize = 3;

/// An object and its handles, some of which are dragged.
pub struct Drag {
    what: Movable,
    prepared: Prepared,
    system: System,
    /// The handles of the layout that are dragged, without repetition.
    dragged: Vec<usize>,
    /// What the handles do before they are dragged; nothing if they all rest.
    rest: Option<Kept>,
    /// The fields of the dragged handles, three by three.
    groups: Vec<Kept>,
}

/// What the fields of a group depend on, by which they are remembered.
#[derive(Clone)]
pub(crate) struct FieldInputs {
    points: Column<Point3<f64>>,
    prepared: Prepared,
    /// The handles of a group; none for what the handles do at rest.
    group: Option<[Option<usize>; GROUP]>,
    derivatives: bool,
    /// How far, in mm, a point may be off.
    error: f64,
}

/// Three numbers per point, and their derivatives if they are wanted.
#[derive(Clone)]
pub(crate) struct Kept {
    values: Column<Point3<f64>>,
    derivatives: Column<Matrix3<f64>>,
}

impl Drag {
    /// Prepares an object for drags of the handles with these numbers, counted from 0; see [`ffd`](crate::ffd()).
    ///
    /// # Errors
    /// As [`ffd`](crate::ffd()), and if there is no such handle.
    pub fn new(
        what: &Movable,
        handles: &Handles,
        dragged: &[usize],
        mode: Mode,
        how: Deforming,
    ) -> Result<Self, FfdError> {
        Self::with(what, handles, dragged, mode, how, System::new, FieldInputs::make)
    }

    /// [`Drag::new`] with what `system` and `keep` compute, or remember.
    pub(crate) fn with<E: From<FfdError>>(
        what: &Movable,
        handles: &Handles,
        dragged: &[usize],
        mode: Mode,
        how: Deforming,
        system: impl FnOnce(&Layout) -> Result<System, E>,
        keep: impl Fn(&FieldInputs) -> Result<Kept, E>,
    ) -> Result<Self, E> {
        let origin = (Point3::origin(), Point3::origin());
        let frame = how.frame.or_else(|| bounds(what)).unwrap_or(origin);
        let prepared = prepared(handles, frame, mode, how)?;
        let mut places = Vec::new();
        for &handle in dragged {
            let place = prepared.place(handle)?;
            if !places.contains(&place) {
                places.push(place);
            }
        }
        let wanted = wanted(what);
        let inputs = |group| FieldInputs {
            points: column(what),
            prepared: prepared.clone(),
            group,
            derivatives: wanted.folds,
            error: how.accuracy * prepared.diagonal,
        };
        let rest = if prepared.rests() { None } else { Some(keep(&inputs(None))?) };
        let groups = places
            .chunks(GROUP)
            .map(|group| keep(&inputs(Some([0, 1, 2].map(|k| group.get(k).copied())))))
            .collect::<Result<_, _>>()?;
        let system = system(&prepared.layout)?;
        Ok(Self { what: what.clone(), system, dragged: places, rest, groups, prepared })
    }

    /// The object with these targets (a handle's number and its place in mm) in place of those of its handles. Of two targets
    /// for one handle the later counts; handles that were not to be dragged stay with theirs.
    ///
    /// # Errors
    /// If there is no such handle, a place becomes infinite, or `progress` says so.
    pub fn to(
        &self,
        targets: &[(usize, Point3<f64>)],
        progress: &Progress<'_>,
    ) -> Result<(Movable, Report), FfdError> {
        let now = self.prepared.clone().aimed(targets, |place| self.dragged.contains(&place))?;
        if now.rests() {
            return Ok((self.what.clone(), Report { merged: now.merged, ..Report::NOTHING }));
        }
        fn step(
            place: &usize,
            now_to: &[Point3<f64>],
            prepared_to: &[Point3<f64>],
        ) -> nalgebra::Vector3<f64> {
            now_to[*place] - prepared_to[*place]
        }
        let steps: Vec<_> = self
            .dragged
            .chunks(GROUP)
            .map(|group| {
                Matrix3::from_fn(|axis, k| {
                    group.get(k).map_or(0.0, |place| step(place, &now.to, &self.prepared.to)[axis])
                })
            })
            .collect();
        let evaluate = |first: usize,
                        points: &[Point3<f64>],
                        moved: &mut [Point3<f64>],
                        derivatives: Option<&mut [Matrix3<f64>]>| {
            self.add(&steps, first, points, moved, derivatives);
        };
        let field = field(points(&self.what), CHUNK, wanted(&self.what), &evaluate, progress)?;
        let deformation = deformation(&now, &self.system);
        let report = report(&now, &self.system, &deformation, &field);
        Ok((rebuilt(&self.what, field)?, report))
    }

    /// Adds the steps of all groups to where points are at rest.
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

impl Prepared {
    /// The same with these targets in place of those of its handles, where they may be others.
    pub(crate) fn aimed(
        mut self,
        targets: &[(usize, Point3<f64>)],
        may_be_other: impl Fn(usize) -> bool,
    ) -> Result<Self, FfdError> {
        for &(handle, to) in targets {
            let place = self.place(handle)?;
            if may_be_other(place) {
                self.to[place] = to;
            }
        }
        Ok(self)
    }

    /// Which of the layout's handles this one became.
    fn place(&self, handle: usize) -> Result<usize, FfdError> {
        let handles = self.places.len();
        self.places.get(handle).copied().ok_or(FfdError::NoHandle { handle, handles })
    }
}

/// The fields that these inputs give, to be remembered.
pub(crate) fn memo(inputs: &FieldInputs) -> Result<Kept, Error> {
    Ok(inputs.make()?)
}

impl FieldInputs {
    fn make(&self) -> Result<Kept, FfdError> {
        let system = System::new(&self.prepared.layout)?;
        let deformation = match &self.group {
            None => deformation(&self.prepared, &system),
            Some(group) => unit_steps(&self.prepared.layout, &system, group),
        };
        let wanted = Wanted { jacobians: self.derivatives, ..Wanted::default() };
        // What is left out of a unit step would be scaled up with it: only the rest may be off.
        let error = if self.group.is_some() { 0.0 } else { self.error };
        let field = deformed_field(&deformation, &self.points, wanted, error, &Progress::none())?;
        Ok(Kept { values: field.positions.into(), derivatives: field.jacobians.into() })
    }
}

/// What a step of 1 of each of these handles does, along one axis each.
fn unit_steps(layout: &Layout, system: &System, group: &[Option<usize>; GROUP]) -> Deformation {
    let n = layout.at.len();
    let solutions = group.map(|place: Option<usize>| {
        system.solve((0..n).map(|row| if Some(row) == place { 1.0 } else { 0.0 }))
    });
    let values =
        (0..n).map(|k: usize| [0, 1, 2].map(|axis| solutions[axis].coefficients[k])).collect();
    let terms = [0, 1, 2].map(|axis| &solutions[axis].polynomial[..]);
    let base = Base { affine: system.polynomial.combine(terms), ..Base::keep(0.0) };
    Deformation::new(layout.gaussians(), values, base)
}

/// The key of what is remembered.
impl Memo for FieldInputs {
    const NAME: &'static str = "DragPart";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.points).memo(&self.prepared.layout);
        to.plain(&self.error).plain(&u8::from(self.derivatives));
        match &self.group {
            Some(group) => {
                to.plain(&1_u8);
                to.counts(&group.map(|place| place.map_or(0, |place| place + 1)));
            }
            // Only what the handles do at rest depends on where they go.
            None => {
                to.plain(&0_u8);
                for target in &self.prepared.to {
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

/// Remembered for the next drag of the same handles.
impl Memo for Kept {
    const NAME: &'static str = "DragFields";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.values).column(&self.derivatives);
    }

    fn size(&self) -> usize {
        self.values.size() + self.derivatives.size()
    }
}
