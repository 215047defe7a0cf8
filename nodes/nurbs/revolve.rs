//! Makes a control net by revolving a profile around an axis.

use maquette_node::{Context, Error, FieldError, In, Node, bail};
use maquette_value as value;
use maquette_value::Curve;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::knot_vectors::even_knots::is_even;

/// Makes a control net by revolving a profile around the y axis. With knots of the kind `Cylinder` along v, the surface of the net is an
/// exact surface of revolution.
///
/// Each point of the profile becomes a row of nine points on a square. The profile starts at the bottom, so that the surface faces outward.
///
/// In other programs: lathe, spin.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Revolve {
    /// The profile, from the bottom to the top: a curve in the plane z = 0, x the distance from the axis. Of a B-spline the control points
    /// and weights are used; with its knots along u the surface passes through it exactly.
    pub curve: Option<In<Curve>>,
    /// The control points of the profile, instead of a curve: distance from the axis, at least 0, and height y, in mm.
    #[schemars(extend("unit" = "mm"))]
    #[serde(default)]
    pub profile: Vec<[f64; 2]>,
}

/// The error message unless exactly one of `curve` and `profile` is given.
const ONE_PROFILE: &str = "a profile is either linked at `curve` or written in `profile`";

impl Node for Revolve {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn check(&self) -> Result<(), FieldError> {
        if self.curve.is_some() != self.profile.is_empty() {
            let help = match self.curve {
                Some(_) => "leave `profile` out",
                None => "link a curve, or write `profile: [(1, 0), (1, 5)]`",
            };
            return Err(FieldError::new("profile", ONE_PROFILE, help));
        }
        if self.curve.is_some() {
            return Ok(());
        }
        let help = "write at least two points, each with a distance from 0 on and a height";
        let net = revolve(&self.profile).map_err(|why| FieldError::new("profile", why, help))?;
        // A net of a single row makes no surface.
        if net.rows() < 2 {
            let message = "expected a profile of at least 2 points, found 1";
            return Err(FieldError::new("profile", message, help));
        }
        Ok(())
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        match self.curve.as_ref().map(|curve| cx.get(curve)) {
            Some(_) if !self.profile.is_empty() => bail!("{ONE_PROFILE}"),
            None if self.profile.is_empty() => bail!("{ONE_PROFILE}"),
            None => Ok((revolve(&self.profile)?,)),
            Some(curve) => {
                if let Some(knots) = curve.knots().filter(|knots| !is_even(knots)) {
                    cx.warn(format!(
                        "the curve's knots are not even: to go through it, `Nurbs` needs them at `u`, as in Knots(kind: Values({:?}))",
                        knots.knots()
                    ));
                }
                Ok((revolve_curve(curve)?,))
            }
        }
    }
}

/// The corners and the side midpoints of a square around a circle of radius 1, as (x, z).
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

/// Makes the control net of a profile of (radius, y), in mm, revolved around the y axis. The net has nine columns with alternating weights
/// 1 and `sqrt(1/2)`, the weights of four quarter circles.
///
/// Piegl and Tiller, *The NURBS Book*, 2nd ed. (1997), section 7.5, the nine-point square.
///
/// # Errors
/// Returns an error if a radius is negative, or the profile is empty or not finite.
pub fn revolve(profile: &[[f64; 2]]) -> Result<value::ControlNet, Error> {
    revolve_profile(profile, &vec![1.0; profile.len()])
}

/// Maximum distance of a profile's points from the plane z = 0, as a fraction of their distance from the origin. It is larger than the
/// rounding errors in files of single precision, about 1e-7.
const FLAT: f64 = 1e-6;

/// Makes the control net of a curve in the plane z = 0 revolved around the y axis; see [`revolve`]. The weights of a B-spline are
/// multiplied with those of the circle. For a closed polyline, the first point also makes the last row.
///
/// # Errors
/// Returns an error if a point is not in the plane, or its x is negative.
pub fn revolve_curve(curve: &Curve) -> Result<value::ControlNet, Error> {
    let points = curve.points();
    if let Some(index) = points.iter().position(|point| point.z.abs() > FLAT * point.coords.norm())
    {
        bail!(
            "point {index} of the curve has z = {}, but a profile must be in the plane z = 0",
            points[index].z
        );
    }
    let mut profile: Vec<[f64; 2]> = points.iter().map(|point| [point.x, point.y]).collect();
    match curve.weights() {
        Some(weights) => revolve_profile(&profile, weights),
        None => {
            let first = curve.is_closed().then_some(profile[0]);
            profile.extend(first);
            revolve(&profile)
        }
    }
}

fn revolve_profile(profile: &[[f64; 2]], weights: &[f64]) -> Result<value::ControlNet, Error> {
    if let Some(index) = profile.iter().position(|[radius, _]| *radius < 0.0) {
        bail!(
            "point {index} of the profile is {} from the axis; the distance must be 0 or more",
            profile[index][0]
        );
    }
    let points: Vec<_> = profile
        .iter()
        .flat_map(|&[radius, y]| SQUARE.map(|[x, z]| Point3::new(radius * x, y, radius * z)))
        .collect();
    let corner = 0.5f64.sqrt();
    let weights = (0..points.len())
        .map(|k: usize| weights[k / 9] * if (k % 9).is_multiple_of(2) { 1.0 } else { corner })
        .collect();
    Ok(value::ControlNet::new(profile.len(), 9, points)?.with_weights(weights)?)
}

#[cfg(test)]
mod tests {
    use maquette_value::{ControlNetError, KnotVector, ParameterDirection};

    use super::super::nurbs::nurbs;
    use super::*;

    // The points of the surface at one height form a circle around the y axis.
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
        assert_eq!(
            surface.iso_curve(ParameterDirection::U, 2.0).points[1],
            Point3::new(1.0, 6.0, 1.0)
        );
    }

    #[test]
    fn a_half_circle_becomes_a_sphere() {
        fn point(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 0.0)
        }
        let points =
            vec![point(0., -2.), point(2., -2.), point(2., 0.), point(2., 2.), point(0., 2.)];
        let corner = 0.5f64.sqrt();
        let knots = KnotVector::new(2, vec![0., 0., 0., 1., 1., 2., 2., 2.]).unwrap();
        let weights = vec![1.0, corner, 1.0, corner, 1.0];
        let half = Curve::rational(points, weights, knots.clone()).unwrap();
        assert!(!is_even(&knots) && is_even(&KnotVector::uniform(7, 4).unwrap()));
        let net = revolve_curve(&half).unwrap();
        let sphere = nurbs(&net, Some(&knots), Some(&KnotVector::cylinder()), None).unwrap();
        for k in 0..100 {
            let (u, v) = (f64::from(k) / 50.0, f64::from(k * 7 % 100) / 25.0);
            assert!((sphere.point(u, v).coords.norm() - 2.0).abs() <= 1e-14);
        }
        let square =
            Curve::polyline(vec![point(1., 0.), point(2., 0.), point(2., 1.)], true).unwrap();
        let profile = revolve(&[[1., 0.], [2., 0.], [2., 1.], [1., 0.]]);
        assert_eq!(revolve_curve(&square).unwrap(), profile.unwrap());
        let off = Curve::polyline(vec![point(1., 0.), Point3::new(1., 1., 0.1)], false).unwrap();
        let not_flat = "point 1 of the curve has z = 0.1, but a profile must be in the plane z = 0";
        assert_eq!(revolve_curve(&off).unwrap_err().to_string(), not_flat);
    }

    #[test]
    fn profiles_that_cannot_be_revolved_are_refused() {
        let error = revolve(&[[1.0, 0.0], [-2.0, 1.0]]).unwrap_err();
        let beyond = "point 1 of the profile is -2 from the axis; the distance must be 0 or more";
        assert_eq!(error.to_string(), beyond);
        for profile in [&[][..], &[[f64::NAN, 0.0]]] {
            let error = revolve(profile).unwrap_err();
            assert!(error.downcast::<ControlNetError>().is_some(), "{error}");
        }
    }
}
