//! Parameters shared by all interpolating nodes.

use maquette_node::{Error, FieldError, bail};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The point of a curve or surface with which a given point is compared.
///
/// The form with the nearest point is described in Japanese patent 4934789, filed on 2007-01-15; the default is the linear progressive
/// form.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Foot {
    /// The limit point of its control point. This gives linear equations.
    #[default]
    Vertex,
    /// The nearest point. On a subdivision surface it is searched on the faces at the vertex, by descent from its limit point, because
    /// another sheet of the surface may be nearer. The curve or surface passes through the point, but not at the parameter of its control
    /// point. If the iteration does not halve the largest distance in time, the points with the largest distances switch to `Vertex`.
    Closest,
}

/// The direction in which a control point moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Direction {
    /// From the foot to the given point.
    #[default]
    Residual,
    /// Along the normal at the foot, by the distance of the given point. As `Residual` at ends, borders and creases, where there is no
    /// normal, and where this does not converge.
    Normal,
}

/// The solver for the control points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Solver {
    /// Conjugate gradients, with the fewest iterations. For `foot: Vertex` and `direction: Residual`.
    #[default]
    Pcg,
    /// The geometric iteration, for every foot and direction.
    Plain,
    /// Direct solution by a factorization. For `foot: Vertex` and `direction: Residual`.
    Direct,
}

/// The distance that must be within the tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Norm {
    /// The largest distance.
    #[default]
    Max,
    /// The root mean square of the distances.
    Mean,
}

/// Options for finding control points whose curve or surface passes through given points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Interpolation {
    /// Point of the curve or surface with which each given point is compared.
    #[serde(default)]
    pub foot: Foot,
    /// The direction in which a control point moves.
    #[serde(default)]
    pub direction: Direction,
    /// The solver for the control points.
    #[serde(default)]
    pub solver: Solver,
    /// Maximum distance from the given points, relative to the diagonal of their bounding box.
    #[schemars(range(min = 1e-14, max = 1.0))]
    #[serde(default = "default_tolerance")]
    pub tolerance: f64,
    /// Distance that must be within the tolerance.
    #[serde(default)]
    pub norm: Norm,
    /// Maximum number of iterations.
    #[schemars(range(max = 100_000))]
    #[serde(default = "default_max_iterations")]
    pub iterations: u32,
}

fn default_tolerance() -> f64 {
    1e-6
}

fn default_max_iterations() -> u32 {
    200
}

impl Default for Interpolation {
    fn default() -> Self {
        Self {
            foot: Foot::default(),
            direction: Direction::default(),
            solver: Solver::default(),
            tolerance: default_tolerance(),
            norm: Norm::default(),
            iterations: default_max_iterations(),
        }
    }
}

impl Interpolation {
    /// Returns true if the control points are the solution of linear equations, that is, for `foot: Vertex` with `direction: Residual`.
    pub(crate) fn is_linear(&self) -> bool {
        self.foot == Foot::Vertex && self.direction == Direction::Residual
    }

    /// Performs [`Self::check`] and returns an error that names the field.
    pub(crate) fn check_fields(&self) -> Result<(), FieldError> {
        let help = "take `solver: Plain`, or `foot: Vertex` with `direction: Residual`";
        self.check().map_err(|why| FieldError::new("solver", why, help))
    }

    /// Checks that the solver supports the foot and the direction.
    ///
    /// # Errors
    /// If the solver does not support the foot or the direction.
    pub(crate) fn check(&self) -> Result<(), Error> {
        match self.solver {
            solver @ (Solver::Pcg | Solver::Direct) if !self.is_linear() => bail!(
                "solver {solver:?} solves only linear equations, which need `foot: Vertex` and `direction: Residual`; use `solver: Plain` instead"
            ),
            _ => Ok(()),
        }
    }
}
