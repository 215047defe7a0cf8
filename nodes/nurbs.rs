//! Nodes that redesign a region as a rational B-spline surface.

use maquette::{Pack, node};

mod blend;
mod canvas;
mod control_net;
mod distance;
mod fold;
mod knots;
#[expect(clippy::module_inception, reason = "the node `Nurbs` gives the pack its name")]
mod nurbs;
mod offset_net;
mod point_net;
mod profile;
mod refine;
mod rows;
mod tessellate;
mod weights;

pub use crate::laplace::NotConverged;
pub use blend::{Blend, BlendError, BlendMode, Blended, blend};
pub use control_net::{ControlNet, NetError, NetMethod, control_net};
pub use knots::{Along, Knots, KnotsError, KnotsKind, knots};
pub use nurbs::{Nurbs, NurbsError, nurbs};
pub use offset_net::{OffsetError, OffsetNet, OffsetStep, offset_net};
pub use point_net::{PointNet, point_net};
pub use profile::{Profile, ProfileError};
pub use tessellate::Tessellate;
pub use weights::{Weights, WeightsError, weights};

/// Nodes that redesign a region as a rational B-spline surface.
pub const PACK: Pack = Pack {
    name: "nurbs",
    nodes: &[
        node::<ControlNet>(),
        node::<OffsetNet>(),
        node::<PointNet>(),
        node::<Weights>(),
        node::<Knots>(),
        node::<Nurbs>(),
        node::<Tessellate>(),
        node::<Blend>(),
    ],
    values: &[],
    formats: &[],
};
