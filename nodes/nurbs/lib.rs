//! Nodes that redesign a region as a rational B-spline surface.

use maquette_node::{Pack, node};

mod blend;
mod blend_mode;
mod control_net;
mod fit;
mod fit_method;
mod fit_parameters;
mod fit_surface;
mod grid;
mod knot_vectors;
mod knots;
mod knots_kind;
mod loft;
mod net;
mod nurbs;
mod offset_net;
mod point_net;
mod point_weights;
mod read_net;
mod revolve;
mod tessellate;
mod weights;

pub use blend::{Blend, BlendedRange, blend};
pub use blend_mode::BlendMode;
pub use control_net::{ControlNet, NetMethod, control_net};
pub use fit_method::FitMethod;
pub use fit_parameters::FitParameters;
pub use fit_surface::{FitSurface, FittedSurface, fit_surface};
pub use grid::seam::Seam;
pub use knot_vectors::knot_vector::knots;
pub use knots::Knots;
pub use knots_kind::KnotsKind;
pub use loft::{Loft, Section, loft};
pub use maquette_base::parameters::parameters;
pub use net::profile::Profile;
pub use nurbs::{Nurbs, nurbs};
pub use offset_net::{OffsetNet, OffsetStep, offset_net};
pub use point_net::{PointNet, point_net};
pub use read_net::ReadNet;
pub use revolve::{Revolve, revolve, revolve_curve};
pub use tessellate::{Tessellate, tessellate};
pub use weights::{Weights, weights, weights_inside};

/// Nodes that redesign a region as a rational B-spline surface.
pub static PACK: Pack = Pack {
    name: "nurbs",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<ControlNet>(),
        node::<OffsetNet>(),
        node::<PointNet>(),
        node::<ReadNet>(),
        node::<Revolve>(),
        node::<Loft>(),
        node::<Weights>(),
        node::<Knots>(),
        node::<Nurbs>(),
        node::<FitSurface>(),
        node::<Tessellate>(),
        node::<Blend>(),
    ],
    ..Pack::EMPTY
};
