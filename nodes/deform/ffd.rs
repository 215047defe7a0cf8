//! Free-form deformation by handles, with rational Gaussian functions.

use maquette_mesh::Movable;
use maquette_node::{Carry, Context, Error, Estimate, Fate, FieldError, In, Node, Promise};
use maquette_value::{Handle, HandleSpace, Handles};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ffd_error::FfdError;
use super::free_form::drag::{self, Drag};
use super::free_form::object::{bounds, points};
use super::free_form::pull::{Deforming, column, deform, prepared};
use super::free_form::reach::{Boxes, Places};
use super::gaussian::layout::Bounds;
use super::gaussian::system::System;
use super::mode::Mode;

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
///
/// In other programs: lattice, cage.
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
    /// How far the handles' pull goes, and how well they are met.
    #[serde(flatten)]
    pub how: Deforming,
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

impl Node for Ffd {
    type Outputs = (Movable,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[
        Carry::all("mesh", "mesh", Fate::Kept).and_cells(Fate::Kept),
        Carry::all("frame", "mesh", Fate::Dropped).and_cells(Fate::Dropped),
    ];

    fn check(&self) -> Result<(), FieldError> {
        let background = self.how.background;
        if background > 0.0 && self.mode != Mode::Displacement {
            let help = "leave `background` or `mode` out";
            return Err(FieldError::new("mode", FfdError::Background { background }, help));
        }
        let handles = self.handles.len();
        match self
            .targets
            .iter()
            .find(|target| handles <= target.handle as usize)
            .filter(|_| self.layout.is_none())
        {
            Some(&Target { handle, .. }) => {
                let error = FfdError::NoHandle { handle: handle as usize, handles };
                Err(FieldError::new("targets", error, "add the handle, or leave the target out"))
            }
            None => Ok(()),
        }
    }

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let from_layout = self.layout.as_ref().map_or(0, |layout| cx.get(layout).at().len());
        let handles = (from_layout + self.handles.len()) as f64;
        let points = points(&cx.get(&self.mesh)).len() as f64;
        let bytes = handles * handles * 16.0 + points * 150.0;
        Some(Estimate { bytes, help: "take fewer handles" })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let what = cx.get(&self.mesh);
        let boxes = self.how.ends().then(|| cx.memo(&Places(column(&what)), Boxes::memo));
        let boxes = boxes.transpose()?;
        let frame = self.frame.as_ref().and_then(|frame| bounds(&cx.get(frame)));
        let Some(frame) =
            frame.or_else(|| boxes.as_ref().map_or_else(|| bounds(&what), Boxes::around))
        else {
            return Ok((what,));
        };
        let how = Deforming { frame: Some(frame), ..self.how };
        let layout = self.layout.as_ref().map(|layout| cx.get(layout));
        let handles = self.all_handles(layout, frame)?;
        let targets = self.targets_in_world(frame)?;
        let (deformed, report) = if targets.is_empty() || how.ends() {
            let prepared = prepared(&handles, frame, self.mode, how)?.aimed(&targets, |_| true)?;
            deform(
                &what,
                &prepared,
                how,
                boxes.as_ref(),
                |layout| cx.memo(layout, System::memo),
                cx.progress(),
            )?
        } else {
            let dragged: Vec<_> = targets.iter().map(|(handle, _)| *handle).collect();
            let drag = Drag::with(
                &what,
                &handles,
                &dragged,
                self.mode,
                how,
                |layout| cx.memo(layout, System::memo),
                |part| cx.memo(part, drag::memo),
            )?;
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
        let all: Vec<_> = layout.in_world(frame)?.iter().chain(own.iter()).collect();
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
