//! Nodes that redesign a region as a rational B-spline surface.

use maquette::{Pack, node};

mod banded;
mod blend;
mod blend_error;
mod blend_mode;
mod canvas;
mod charted;
mod control_net;
mod disk;
mod distance;
mod even_knots;
mod fit_error;
mod fit_line;
mod fit_method;
mod fit_net;
mod fit_parameters;
mod fit_surface;
mod fold;
mod harmonic;
mod knot_vector;
mod knots;
mod knots_error;
mod knots_kind;
mod loft;
mod mean_value;
mod net_error;
#[expect(clippy::module_inception, reason = "the node `Nurbs` gives the pack its name")]
mod nurbs;
mod offset_net;
mod parameters;
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
pub use blend::{Blend, Blended, blend};
pub use blend_error::BlendError;
pub use blend_mode::BlendMode;
pub use control_net::{ControlNet, NetMethod, control_net};
pub use fit_error::FitError;
pub use fit_method::FitMethod;
pub use fit_parameters::FitParameters;
pub use fit_surface::{FitSurface, Fitted, fit_surface};
pub use knot_vector::knots;
pub use knots::Knots;
pub use knots_error::KnotsError;
pub use knots_kind::KnotsKind;
pub use loft::{Loft, LoftError, Section, loft};
pub use net_error::NetError;
pub use nurbs::{Nurbs, NurbsError, nurbs};
pub use offset_net::{OffsetError, OffsetNet, OffsetStep, offset_net};
pub(crate) use parameters::parameters;
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
