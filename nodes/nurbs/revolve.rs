//! Makes a control net of a profile that turns around an axis.

use maquette::value::{self, ControlNetError};
use maquette::{Context, Error, Node};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Makes a control net of a profile that turns around the y axis. With knots of the kind `Cylinder` along v its surface is exactly
/// round.
///
/// Each point of the profile becomes a row of nine points on a square. The profile's first point belongs at the bottom, so that the
/// outside of the surface is outside.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Revolve {
    /// The control points of the profile from the bottom to the top: distance from the axis, 0 or more, and height y.
    #[schemars(extend("unit" = "mm"))]
    pub profile: Vec<[f64; 2]>,
}

/// Why a profile cannot be turned.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RevolveError {
    /// A point beyond the axis.
    #[error(
        "point {index} of the profile is {radius} from the axis; the distance must be 0 or more"
    )]
    Radius {
        /// The offending point.
        index: usize,
        /// Its distance.
        radius: f64,
    },
    /// Points that make no net.
    #[error(transparent)]
    Net(#[from] ControlNetError),
}

impl Node for Revolve {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((revolve(&self.profile)?,))
    }
}

/// The corners and the middles of the sides of a square around a circle of radius 1, as (x, z).
const SQUARE: [[f64; 2]; 9] = [
    [1., 0.],
    [1., 1.],
    [0., 1.],
    [-1., 1.],
    [-1., 0.],
    [-1., -1.],
    [0., -1.],
    [1., -1.],
    [1., 0.],
];

/// The control net of a profile of (radius, y) turned around the y axis, in mm: nine columns with the weights 1 and `sqrt(1/2)` in
/// turn, those of four quarter circles.
///
/// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), section 7.5, the nine-point square.
///
/// # Errors
/// If a radius is negative, or the profile is empty or not finite.
pub fn revolve(profile: &[[f64; 2]]) -> Result<value::ControlNet, RevolveError> {
    if let Some(index) = profile.iter().position(|[radius, _]| *radius < 0.0) {
        return Err(RevolveError::Radius { index, radius: profile[index][0] });
    }
    let ring =
        |&[radius, y]: &[f64; 2]| SQUARE.map(|[x, z]| Point3::new(radius * x, y, radius * z));
    let points: Vec<_> = profile.iter().flat_map(ring).collect();
    let corner = 0.5f64.sqrt();
    let weights = (0..points.len()).map(|k| if k % 9 % 2 == 0 { 1.0 } else { corner }).collect();
    Ok(value::ControlNet::new(profile.len(), 9, points)?.with_weights(weights)?)
}

#[cfg(test)]
mod tests {
    use maquette::value::{Along, KnotVector};

    use super::super::nurbs::nurbs;
    use super::*;

    // T-NUR-01, on a surface of revolution.
    #[test]
    fn every_height_is_a_circle() {
        let net = revolve(&[[0.0, -1.0], [3.0, -1.0], [2.0, 4.0], [1.0, 6.0]]).unwrap();
        let surface = nurbs(&net, None, Some(&KnotVector::cylinder()), None).unwrap();
        for u in [0.0, 0.3, 1.0, 1.7, 2.0] {
            let [radius, y] = [surface.point(u, 0.0).x, surface.point(u, 0.0).y];
            for k in 0..=1000 {
                let point = surface.point(u, 4.0 * f64::from(k) / 1000.0);
                assert!((libm::hypot(point.x, point.z) - radius).abs() <= 1e-14 * radius.max(1.0));
                assert!((point.y - y).abs() <= 1e-14);
            }
        }
        let side = surface.normal(1.2, 0.4).unwrap();
        assert!(side.dot(&surface.point(1.2, 0.4).coords) > 0.0, "the outside is outside");
        assert_eq!(surface.iso_curve(Along::U, 2.0).points[1], Point3::new(1.0, 6.0, 1.0));
    }

    #[test]
    fn profiles_that_cannot_be_turned_are_refused() {
        let beyond = RevolveError::Radius { index: 1, radius: -2.0 };
        assert_eq!(revolve(&[[1.0, 0.0], [-2.0, 1.0]]), Err(beyond));
        assert!(matches!(revolve(&[]), Err(RevolveError::Net(_))));
        assert!(matches!(revolve(&[[f64::NAN, 0.0]]), Err(RevolveError::Net(_))));
    }
}
