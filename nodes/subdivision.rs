//! Nodes on subdivision surfaces and curves: refinement, and what passes through or near given points.

use maquette::{Pack, node};

mod blocks;
mod boundary;
mod carry;
mod catmull_clark;
mod closed_rows;
mod columns;
mod composed;
mod connectivity;
mod control_curve;
mod control_points;
mod corners;
mod crease;
mod creases;
mod curvature;
mod curve_basis;
mod doo_sabin;
mod downhill;
mod dual_halves;
mod dual_limit;
mod dual_surface;
mod extent;
mod finer_dual_limit;
mod finer_limit;
mod fit_subdivision;
mod geometric;
mod interpolate;
mod interpolate_curve;
mod interpolate_surface;
mod interpolation;
mod least_squares;
mod level;
mod limit;
mod limit_feet;
mod limit_matrix;
mod limit_point;
mod limit_surface;
mod live;
mod loop_masks;
mod manifold;
mod masks;
mod missed;
mod options;
mod patches;
mod piece;
mod place;
mod plan;
mod primal;
mod quadric;
mod read_creases;
mod record;
mod regular_rules;
mod rules;
mod scattered;
mod scheme;
#[cfg(test)]
mod shapes;
mod sharp_edges;
mod sharpness;
mod simplify;
mod smooth_corners;
mod smooth_quad;
mod smooth_triangle;
mod solution;
mod split;
mod stencils;
mod step;
mod subdivide;
mod subdivide_curve;
mod subdivide_error;
mod topology;
mod transpose;
mod turns;
mod walk;
mod without_border;

pub use boundary::Boundary;
pub use corners::Corners;
pub use crease::Crease;
pub use creases::Creases;
pub use curvature::{
    AngleBending, Bending, BentMesh, Curvature, CurvatureError, CurvatureMethod, CurvatureRamp,
    angle_bending, curvature,
};
pub use curve_basis::CurveBasis;
pub use fit_subdivision::{
    FitSubdivision, FitSubdivisionError, FittedSubdivision, Moves, Prices, fit_by_moves,
    fit_subdivision,
};
pub use interpolate::{Interpolate, InterpolateError, InterpolateOptions, OnSingular, interpolate};
pub use interpolate_curve::{InterpolateCurve, InterpolateCurveError, interpolate_curve};
pub use interpolate_surface::{InterpolateSurface, InterpolateSurfaceError, interpolate_surface};
pub use interpolation::{Direction, Foot, Interpolation, Norm, NotLinear, Solver};
pub use limit_point::LimitPoint;
pub use limit_surface::LimitSurface;
pub use live::Live;
pub use options::Subdivision;
pub use plan::Plan;
pub use read_creases::{ReadCreases, ReadCreasesError, read_creases};
pub use scattered::Scattered;
pub use scheme::Scheme;
pub use sharp_edges::crease;
pub use simplify::{Simplify, SimplifyError, simplify};
pub use solution::{Interpolated, RanAway};
pub use subdivide::{Subdivide, subdivide};
pub use subdivide_curve::{CurveScheme, SubdivideCurve, SubdivideCurveError, subdivide_curve};
pub use subdivide_error::SubdivideError;

/// Nodes on subdivision surfaces and curves.
pub const PACK: Pack = Pack {
    name: "subdivision",
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
    values: &[],
    formats: &[],
    readers: &[],
};
