//! Nodes for subdivision surfaces and curves: refinement, and interpolation or approximation of given points.

use maquette_node::{Pack, node};

mod boundary;
mod corners;
mod crease;
mod creases;
mod curvature;
mod curve_basis;
mod fit_subdivision;
#[cfg(test)]
#[path = "../base/topology/flat_faces/insert.rs"]
mod flat_faces;
mod interpolate;
mod interpolate_curve;
mod interpolate_surface;
mod limit;
mod masks;
mod options;
mod read_creases;
mod refine;
mod rules;
mod scheme;
#[cfg(test)]
mod shapes;
mod sharp_edges;
mod simplify;
mod solve;
mod subdivide;
mod subdivide_curve;
mod surface;

pub use boundary::Boundary;
pub use corners::Corners;
pub use crease::Crease;
pub use creases::Creases;
pub use curvature::{
    AngleBending, Bending, BentMesh, Curvature, CurvatureMethod, CurvatureRamp, angle_bending,
    curvature,
};
pub use curve_basis::CurveBasis;
pub use fit_subdivision::{
    FitSubdivision, FittedSubdivision, Moves, Prices, fit_by_moves, fit_subdivision,
};
pub use interpolate::{Interpolate, InterpolateOptions, OnSingular, interpolate};
pub use interpolate_curve::{InterpolateCurve, interpolate_curve};
pub use interpolate_surface::{InterpolateSurface, interpolate_surface};
pub use maquette_base::scattered::Scattered;
pub use options::Subdivision;
pub use read_creases::{ReadCreases, read_creases};
pub use refine::moving_vertices::MovingVertices;
pub use refine::plan::Plan;
pub use scheme::Scheme;
pub use sharp_edges::crease;
pub use simplify::{Simplify, simplify};
pub use solve::interpolation::{Direction, Foot, Interpolation, Norm, Solver};
pub use solve::solution::InterpolationResult;
pub use subdivide::{Subdivide, subdivide};
pub use subdivide_curve::{CurveScheme, SubdivideCurve, subdivide_curve};
pub use surface::limit_point::LimitPoint;
pub use surface::limit_surface::LimitSurface;

/// The nodes for subdivision surfaces and curves.
pub static PACK: Pack = Pack {
    name: "subdivision",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    nodes: &[
        node::<ReadCreases>(),
        node::<Crease>(),
        node::<Subdivide>(),
        node::<Interpolate>(),
        node::<Curvature>(),
        node::<SubdivideCurve>(),
        node::<InterpolateCurve>(),
        node::<InterpolateSurface>(),
        node::<Simplify>(),
        node::<FitSubdivision>(),
    ],
    ..Pack::EMPTY
};
