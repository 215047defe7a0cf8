//! What the nodes that interpolate have in common: their parameters, how they find control points, and what they give.

use maquette_node::FieldError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which point of a curve or surface a given point is compared with.
///
/// The form with the nearest point is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear
/// progressive form.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Foot {
    /// The limit point of its own control point: a linear problem with one solution, where there is one.
    #[default]
    Vertex,
    /// The nearest one; on a subdivision surface the nearest on the faces at the vertex, reached downhill from its limit point, as
    /// another sheet of the surface may come nearer. The curve or surface then passes through the point, but not at its control
    /// point's own parameter. Where the iteration does not halve the largest distance in time, the points that are missed by most go on
    /// with `Vertex`.
    Closest,
}

/// Which way a control point moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Direction {
    /// From the foot to the given point.
    #[default]
    Residual,
    /// Along the normal at the foot, as far as the given point is away; from the foot to the point where there is no
    /// perpendicular, at ends, borders and creases, and where this does not converge.
    Normal,
}

/// How control points are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Solver {
    /// Conjugate gradients: fewest iterations. For `foot: Vertex` and `direction: Residual`.
    #[default]
    Pcg,
    /// The geometric iteration itself: for every foot and direction.
    Plain,
    /// One factorization, exact up to rounding. For `foot: Vertex` and `direction: Residual`.
    Direct,
}

/// Which distance must be within the tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Norm {
    /// The largest one.
    #[default]
    Max,
    /// The root of the mean of the squares.
    Mean,
}

/// How control points are found whose curve or surface passes through given points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Interpolation {
    /// Which point of the curve or surface each given point is compared with.
    #[serde(default)]
    pub foot: Foot,
    /// Which way a control point moves.
    #[serde(default)]
    pub direction: Direction,
    /// How control points are found.
    #[serde(default)]
    pub solver: Solver,
    /// Distance from the given points that is small enough, over the diagonal of their box.
    #[schemars(range(min = 1e-14, max = 1.0))]
    #[serde(default = "millionth")]
    pub tolerance: f64,
    /// Which distance that is.
    #[serde(default)]
    pub norm: Norm,
    /// Most iterations.
    #[schemars(range(max = 100_000))]
    #[serde(default = "two_hundred")]
    pub iterations: u32,
}

fn millionth() -> f64 {
    1e-6
}

fn two_hundred() -> u32 {
    200
}

impl Default for Interpolation {
    fn default() -> Self {
        Self {
            foot: Foot::default(),
            direction: Direction::default(),
            solver: Solver::default(),
            tolerance: millionth(),
            norm: Norm::default(),
            iterations: two_hundred(),
        }
    }
}

impl Interpolation {
    /// Whether the control points are the solution of linear equations.
    pub(crate) fn is_linear(&self) -> bool {
        self.foot == Foot::Vertex && self.direction == Direction::Residual
    }

    /// The same as an error of a node's fields.
    pub(crate) fn check_fields(&self) -> Result<(), FieldError> {
        let help = "take `solver: Plain`, or `foot: Vertex` with `direction: Residual`";
        self.check().map_err(|why| FieldError::new("solver", why, help))
    }

    /// # Errors
    /// If the solver is not for this foot and direction.
    pub(crate) fn check(&self) -> Result<(), NotLinear> {
        match self.solver {
            Solver::Pcg | Solver::Direct if !self.is_linear() => {
                Err(NotLinear { solver: self.solver })
            }
            _ => Ok(()),
        }
    }
}

/// A solver of linear equations for what is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "solver {solver:?} solves linear equations, which only `foot: Vertex` with `direction: Residual` gives: take `solver: Plain`"
)]
pub struct NotLinear {
    /// The solver.
    pub solver: Solver,
}
