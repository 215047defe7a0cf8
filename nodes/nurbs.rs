//! Nodes that redesign a region as a rational B-spline surface.

use maquette::{Pack, node};

mod banded;
mod blend;
mod canvas;
mod control_net;
mod disk;
mod distance;
mod fit_line;
mod fit_net;
mod fit_surface;
mod fold;
mod harmonic;
mod knots;
mod loft;
mod mean_value;
#[expect(clippy::module_inception, reason = "the node `Nurbs` gives the pack its name")]
mod nurbs;
mod offset_net;
mod patch;
mod point_net;
mod polar;
mod profile;
mod rays;
mod refine;
mod revolve;
mod round;
mod rows;
mod seam;
mod tessellate;
mod weights;
mod within;

pub use crate::laplace::Unsolved;
pub use blend::{Blend, BlendError, BlendMode, Blended, blend};
pub use control_net::{ControlNet, NetError, NetMethod, control_net};
pub use fit_surface::{FitError, FitMethod, FitParameters, FitSurface, Fitted, fit_surface};
pub(crate) use knots::parameters;
pub use knots::{Knots, KnotsError, KnotsKind, knots};
pub use loft::{Loft, LoftError, Section, loft};
pub use nurbs::{Nurbs, NurbsError, nurbs};
pub use offset_net::{OffsetError, OffsetNet, OffsetStep, offset_net};
pub use point_net::{PointNet, point_net};
pub use profile::{Profile, ProfileError};
pub use revolve::{Revolve, RevolveError, revolve, revolve_curve};
pub use seam::Seam;
pub use tessellate::{Tessellate, TessellateError, tessellate};
pub use weights::{Weights, WeightsError, weights, weights_inside};
pub use within::WithinError;

/// Nodes that redesign a region as a rational B-spline surface.
pub const PACK: Pack = Pack {
    name: "nurbs",
    nodes: &[
        node::<ControlNet>(),
        node::<OffsetNet>(),
        node::<PointNet>(),
        node::<Revolve>(),
        node::<Loft>(),
        node::<Weights>(),
        node::<Knots>(),
        node::<Nurbs>(),
        node::<FitSurface>(),
        node::<Tessellate>(),
        node::<Blend>(),
    ],
    values: &[],
    formats: &[],
    readers: &[],
};
