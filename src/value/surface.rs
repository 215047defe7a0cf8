//! Rational B-spline surfaces.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::content::content_of_fields;
use super::edge_cases::point_sets;
use super::{ControlNet, KnotVector, Layer, Parts, PartsError, Summary, Value};

mod adaptive;
mod change;
mod closest;
mod differentiate;
mod evaluate;
mod grid;
mod joints;
mod tessellate;

pub use change::IsoCurve;
pub use closest::Foot;
pub use differentiate::Derivatives;

/// A parameter direction, u or v, of a control net or surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "Along")]
pub enum ParameterDirection {
    /// The direction from row to row of the net.
    U,
    /// The direction from column to column of the net.
    V,
}

/// Error of building or evaluating a surface.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SurfaceError {
    /// The number of knots does not match the number of control points.
    #[error("the knot vector along {along} is for {knots} control points, the net has {points}")]
    Count {
        /// The parameter direction whose knots do not match: `u` or `v`.
        along: char,
        /// The number of control points that the knots require.
        knots: usize,
        /// The number of control points of the net in this direction.
        points: usize,
    },
    /// Any other violation of the invariant of [`Surface`]; contains the message.
    #[error("{0}")]
    Invalid(String),
}

/// A rational B-spline surface: a control net, and a knot vector for each direction. The rows of the net run along u.
///
/// ```text
/// S(u,v) = sum_ab w_ab P_ab N_a(u) N_b(v) / sum_ab w_ab N_a(u) N_b(v)
/// ```
///
/// Invariant, checked by [`Surface::new`]: the knot vectors match the net. Each window of (p + 1) x (q + 1) weights, where p and q are the
/// degrees along u and v, affects one polynomial piece and has at least one positive weight.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    net: ControlNet,
    u: KnotVector,
    v: KnotVector,
}

impl Surface {
    /// Builds a surface from a net and its two knot vectors.
    ///
    /// # Errors
    /// If the number of knots does not match the net, or all weights of a piece are 0.
    pub fn new(net: ControlNet, u: KnotVector, v: KnotVector) -> Result<Self, SurfaceError> {
        for (along, knots, points) in [('u', &u, net.rows()), ('v', &v, net.columns())] {
            if knots.n_control() != points {
                return Err(SurfaceError::Count { along, knots: knots.n_control(), points });
            }
        }
        let (p, q) = (u.degree(), v.degree());
        for row in 0..net.rows() - p {
            for column in 0..net.columns() - q {
                let positive = (row..=row + p).any(|a| {
                    net.weights()[a * net.columns() + column..][..=q].iter().any(|&w| w > 0.0)
                });
                if !positive {
                    return Err(SurfaceError::Invalid(format!(
                        "all weights around control point ({row}, {column}) are 0: the surface has no point there"
                    )));
                }
            }
        }
        Ok(Self { net, u, v })
    }

    /// The control net of the surface.
    pub fn net(&self) -> &ControlNet {
        &self.net
    }

    /// The knots along u, with one control point per row of the net.
    pub fn u(&self) -> &KnotVector {
        &self.u
    }

    /// The knots along v, with one control point per column of the net.
    pub fn v(&self) -> &KnotVector {
        &self.v
    }
}

impl Value for Surface {
    const NAME: &'static str = "Surface";

    content_of_fields! { net u v }

    fn describe(&self) -> Summary {
        fn domain(knots: &KnotVector) -> String {
            format!("{:?}", knots.domain())
        }
        let mut summary = Summary::default()
            .with_fact("order", format!("{} x {}", self.u.degree() + 1, self.v.degree() + 1))
            .with_fact("domain u", domain(&self.u))
            .with_fact("domain v", domain(&self.v));
        summary.0.extend(self.net.describe().0);
        summary
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = self.net.parts();
        self.u.push("knots u", &mut parts);
        self.v.push("knots v", &mut parts);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let net = ControlNet::from_parts(parts)?;
        let (u, v) = (
            KnotVector::from_named_parts(parts, "knots u")?,
            KnotVector::from_named_parts(parts, "knots v")?,
        );
        Self::new(net, u, v).map_err(PartsError::from_error)
    }

    /// Draws the surface as faces, and its control net as lines.
    fn show(&self) -> Vec<Layer> {
        let faces = self.tessellate_open(0, 0).map(|mesh| Layer::Triangles(Box::new(mesh)));
        faces.into_iter().chain(self.net.show()).collect()
    }

    fn edge_cases() -> Vec<Self> {
        fn knots() -> Result<KnotVector, crate::KnotVectorError> {
            KnotVector::new(2, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        }
        let surfaces = point_sets(9).into_iter().map(|points| {
            let net = ControlNet::new(3, 3, points).ok()?;
            Self::new(net, knots().ok()?, knots().ok()?).ok()
        });
        surfaces.flatten().collect()
    }
}
