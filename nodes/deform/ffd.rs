//! The node that deforms objects by handles, with rational Gaussian functions.

use maquette_mesh::Movable;
use maquette_node::{
    Carry, Context, Error, Estimate, FieldError, Forecast, In, Node, Promise, Sizes, Transfer,
};
use maquette_value::{Handle, HandleSpace, Handles};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::free_form::drag::{self, Drag, missing_handle};
use super::free_form::object::{bounds, points};
use super::free_form::pull::{DeformOptions, column, deform_prepared, prepare_handles};
use super::free_form::reach::{Boxes, MemoPoints};
use super::gaussian::layout::{Bounds, wrong_background};
use super::gaussian::system::System;
use super::mode::Mode;

/// Deforms an object by handles: each handle moves to its target, and moves the points around it.
///
/// Every point is influenced by all handles, weighted by rational Gaussian functions: the nearer a handle, measured in its deviations, the
/// greater its weight. Handles may be at any positions, also outside of the object, and in any number. Weights are relative: far from all
/// handles, a point follows the nearest one, so that a single handle moves the whole object. To limit the reach of a handle, add handles at
/// rest, or a `background`.
///
/// The result has the type of the input. Normals are transformed. Where the deformation folds space over, there is a warning, and the
/// attribute `folded` marks the vertices of a mesh. In a control net the fixed points and the base points stay, so that a blend takes the
/// deformation back to the scan. In a B-spline the control points are moved, which is approximately the deformation of the curve. Cells,
/// texture coordinates and the camera stay.
///
/// In other programs: lattice, cage.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Ffd {
    /// Object to deform: a mesh, a range image, points, a curve or a control net.
    pub mesh: In<Movable>,
    /// Handles from another node; they precede `handles`.
    pub layout: Option<In<Handles>>,
    /// Object whose bounding box is the box of the handles; if omitted, the deformed object. With one `frame`, several objects are deformed
    /// in the same way.
    pub frame: Option<In<Movable>>,
    /// Handles, each with its position and its target.
    #[serde(default)]
    pub handles: Vec<Handle>,
    /// New targets for some handles. The effect of all other handles is cached, so that changing these targets takes a fraction of the
    /// time.
    #[serde(default)]
    pub targets: Vec<Target>,
    /// Quantity of the handles that is blended.
    #[serde(default)]
    pub mode: Mode,
    /// Coordinate space of `handles` and `targets`; `layout` has its own.
    #[serde(default)]
    pub space: HandleSpace,
    /// Reach of the handles and accuracy of the deformation.
    #[serde(flatten)]
    pub options: DeformOptions,
}

/// A new target for a handle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// Number of the handle, counted from 0; the handles of `layout` precede those of `handles`.
    pub handle: u32,
    /// New target position.
    pub to: [f64; 3],
}

impl Node for Ffd {
    type Outputs = (Movable,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[
        Carry::uniform("mesh", "mesh", Transfer::Kept).and_cells(Transfer::Kept),
        Carry::uniform("frame", "mesh", Transfer::Dropped).and_cells(Transfer::Dropped),
    ];

    fn check(&self) -> Result<(), FieldError> {
        let background = self.options.background;
        if background > 0.0 && self.mode != Mode::Displacement {
            let help = "remove `background` or `mode`";
            return Err(FieldError::new("mode", wrong_background(background), help));
        }
        let handles = self.handles.len();
        match self
            .targets
            .iter()
            .find(|target| handles <= target.handle as usize)
            .filter(|_| self.layout.is_none())
        {
            Some(&Target { handle, .. }) => {
                let error = missing_handle(handle as usize, handles);
                Err(FieldError::new("targets", error, "add the handle, or remove the target"))
            }
            None => Ok(()),
        }
    }

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let from_layout = self.layout.as_ref().map_or(0, |layout| cx.get(layout).positions().len());
        let handles = (from_layout + self.handles.len()) as f64;
        let points = points(&cx.get(&self.mesh)).len() as f64;
        let bytes = handles * handles * 16.0 + points * 150.0;
        Some(Estimate { bytes, help: "use fewer handles" })
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Some(Forecast::by_law(sizes.get(&self.mesh)?))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let object = cx.get(&self.mesh);
        let boxes =
            self.options.is_limited().then(|| cx.memo(&MemoPoints(column(&object)), Boxes::memo));
        let boxes = boxes.transpose()?;
        let frame = self.frame.as_ref().and_then(|frame| bounds(&cx.get(frame)));
        let Some(frame) =
            frame.or_else(|| boxes.as_ref().map_or_else(|| bounds(&object), Boxes::bounds))
        else {
            return Ok((object,));
        };
        let options = DeformOptions { frame: Some(frame), ..self.options };
        let layout = self.layout.as_ref().map(|layout| cx.get(layout));
        let handles = self.all_handles(layout, frame)?;
        let targets = self.targets_in_world(frame)?;
        let (deformed, report) = if targets.is_empty() || options.is_limited() {
            let prepared = prepare_handles(&handles, frame, self.mode, options)?
                .with_targets(&targets, |_| true)?;
            deform_prepared(
                &object,
                &prepared,
                options,
                boxes.as_ref(),
                |layout| cx.memo(layout, System::memo),
                cx.progress(),
            )?
        } else {
            let dragged: Vec<_> = targets.iter().map(|(handle, _)| *handle).collect();
            let drag = Drag::with_memo(
                &object,
                &handles,
                &dragged,
                self.mode,
                options,
                |layout| cx.memo(layout, System::memo),
                |part| cx.memo(part, drag::memo),
            )?;
            drag.apply_targets(&targets, cx.progress())?
        };
        report.warn(&object, frame, cx);
        Ok((deformed,))
    }
}

impl Ffd {
    fn all_handles(&self, layout: Option<&Handles>, frame: Bounds) -> Result<Handles, Error> {
        let own = Handles::new(self.space, &self.handles)?.in_world(frame)?;
        let Some(layout) = layout else { return Ok(own) };
        let all: Vec<_> = layout.in_world(frame)?.iter().chain(own.iter()).collect();
        Ok(Handles::new(HandleSpace::World, &all)?)
    }

    fn targets_in_world(&self, frame: Bounds) -> Result<Vec<(usize, Point3<f64>)>, Error> {
        let handles = self.targets.iter().map(|target| Handle {
            at: target.to,
            to: None,
            sigma: None,
            weight: 1.0,
        });
        let handles = Handles::new(self.space, &handles.collect::<Vec<_>>())?.in_world(frame)?;
        let numbers = self.targets.iter().map(|target| target.handle as usize);
        Ok(numbers.zip(handles.positions().iter().copied()).collect())
    }
}
