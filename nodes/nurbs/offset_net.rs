//! Moves the free points of a control net.

use maquette_node::{Context, Error, FieldError, In, Node, Progress, bail};
use maquette_value as value;
use maquette_value::{Direction, DirectionError, Field, Region};
use nalgebra::{Matrix3, Unit, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::rim_distance::{Rectangle, rim_distances};
use super::grid::within::points_in_region;
use super::net::profile::{NO_PICTURE, Profile};
use super::net::sink::Part;

/// Moves the free points of a control net in one or several steps, each in the direction of the previous one, rotated by an angle. Fixed
/// points stay.
///
/// A part that stands out and sinks, such as a nose pushed into the face, becomes flat first: each point moves at least in proportion to
/// its height over the surroundings, also those on the border of the region. So no crest remains along the border. The profiles `Plateau`
/// and `Picture` are exceptions.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct OffsetNet {
    /// The net.
    pub net: In<value::ControlNet>,
    /// The first direction; the mean normal of the net before any offset if omitted.
    pub normal: Option<In<Direction>>,
    /// Gray levels for the profile `Picture`.
    pub picture: Option<In<Field>>,
    /// Moves only the points in this part of the range grid; all free points if omitted.
    pub region: Option<In<Region>>,
    /// The steps, in order.
    pub steps: Vec<OffsetStep>,
    /// Profile of the offset between the free points' center and the fixed points.
    #[serde(default)]
    pub profile: Profile,
}

/// One step of an offset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OffsetStep {
    /// Distance in mm; negative values go back.
    #[schemars(extend("unit" = "mm"))]
    pub distance: f64,
    /// Rotation of the direction before this step, in degrees.
    #[schemars(range(min = -360.0, max = 360.0), extend("unit" = "deg"))]
    #[serde(default)]
    pub angle: f64,
    /// Rotation axis, counter-clockwise seen against this vector. (0, 0, 0) is automatic: a positive angle leans the offset along the
    /// longest extent of the net, towards growing coordinates.
    #[serde(default)]
    pub axis: [f64; 3],
}

impl Node for OffsetNet {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn check(&self) -> Result<(), FieldError> {
        if self.profile == Profile::Picture && self.picture.is_none() {
            let help = "link a field, as `picture: \"node\"`, or choose another profile";
            return Err(FieldError::new("profile", NO_PICTURE, help));
        }
        Ok(())
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let normal = self.normal.as_ref().map(|normal| cx.get(normal).vector());
        let picture = self.picture.as_ref().map(|picture| cx.get(picture));
        let region = self.region.as_ref().map(|region| cx.get(region));
        if picture.is_some() && self.profile != Profile::Picture {
            cx.warn("the field at the port `picture` is not used: the profile is not `Picture`");
        }
        let net = cx.get(&self.net);
        Ok((offset_net(net, normal, picture, region, &self.steps, self.profile, cx.progress())?,))
    }
}

/// Returns the net with its free points (those in `region`, if given) moved by the sum of all steps, times the profile. Points of a part
/// that stands out and sinks move at least in proportion to their height. A point that is moved by 0 keeps its bits. The first direction is
/// `normal`, or the mean normal of the net's base.
///
/// # Errors
/// Returns an error if a step has no rotation axis, the direction or the profile cannot be computed, or the region does not fit the net.
pub fn offset_net(
    net: &value::ControlNet,
    normal: Option<Unit<Vector3<f64>>>,
    picture: Option<&Field>,
    region: Option<&Region>,
    steps: &[OffsetStep],
    profile: Profile,
    progress: &Progress<'_>,
) -> Result<value::ControlNet, Error> {
    let within = match region {
        Some(region) => points_in_region(net, region)?,
        None => vec![1; net.points().len()],
    };
    let fixed = net.fixed_points().iter();
    let free: Vec<u8> =
        fixed.zip(&within).map(|(&fixed, within)| within & u8::from(fixed == 0)).collect();
    let rim_distances = rim_distances_in(net, region);
    let depths: Option<Vec<f64>> = rim_distances
        .as_ref()
        .map(|distances| distances.iter().map(|distance| distance - FIXED_DEPTH).collect());
    let normal = match normal {
        Some(normal) => normal,
        None => mean_normal(net).map_err(no_normal)?.vector(),
    };
    let offset = sum_of_steps(net, normal, steps)?;
    let distance = offset.norm();
    let factors = profile.factors(net, &free, depths.as_deref(), distance, picture, progress)?;
    let mut factors: Vec<f64> =
        factors.iter().zip(&free).map(|(factor, &free)| factor * f64::from(free)).collect();
    let sinks = mean_normal(net).is_ok_and(|normal| normal.vector().dot(&offset) < 0.0);
    if let Some(direction) = Unit::try_new(offset, 0.0).filter(|_| sinks && profile.is_hill()) {
        let inside = inside_points(net, &free, &within);
        let part = Part { net, inside: &inside, rim_distances: rim_distances.as_deref() };
        if let Some(relief) = part.relief(direction, progress)? {
            for (at, factor) in factors.iter_mut().enumerate() {
                *factor = relief.sink(at, *factor * distance, distance) / distance;
            }
        }
    }
    let moved = net.points().iter().zip(factors).map(|(point, factor)| {
        let offset = offset * factor;
        // Adding a zero offset would change a coordinate of -0 to 0.
        if offset == Vector3::zeros() { *point } else { point + offset }
    });
    Ok(net.clone().with_points(moved.collect::<Vec<_>>())?)
}

/// The fixed points of a region are on average this far inside of its rim, in cells.
const FIXED_DEPTH: f64 = 0.5;

/// Returns the distance of each point of the net from the rim of its region, or of `region`, the part to which the offset is restricted; in
/// points of the net, positive inside. `None` if one has no rim.
fn rim_distances_in(net: &value::ControlNet, region: Option<&Region>) -> Option<Vec<f64>> {
    let mut distances = net.rim_distances()?.to_vec();
    if let Some(region) = region {
        let part = rim_distances(region, rectangle(net)?)?;
        distances.iter_mut().zip(part).for_each(|(distance, part)| *distance = distance.min(part));
    }
    Some(distances)
}

/// Returns the rectangle of cells that are the points of a net; `None` if the net has no cells.
fn rectangle(net: &value::ControlNet) -> Option<Rectangle> {
    let chart = net.chart()?;
    let (cell, [row, column]) = (*chart.cells.first()? as usize, chart.coordinates.first()?);
    let at = [cell % chart.grid[0], cell / chart.grid[0]];
    let low = [at[0].checked_sub(*column as usize)?, at[1].checked_sub(*row as usize)?];
    Some(Rectangle { low, size: [net.columns(), net.rows()] })
}

/// Returns 1 for each point that may sink. If the points are cells, as those of a net with a rim are, these are the cells of the region,
/// its border included; else they are the free points.
fn inside_points(net: &value::ControlNet, free: &[u8], within: &[u8]) -> Vec<u8> {
    let Some(chart) = net.chart().filter(|_| net.rim_distances().is_some()) else {
        return free.to_vec();
    };
    let mut inside = vec![0; free.len()];
    for &[row, column] in chart.coordinates.iter() {
        if (0.0..net.rows() as f64).contains(&row) && (0.0..net.columns() as f64).contains(&column)
        {
            let at = row as usize * net.columns() + column as usize;
            inside[at] = within[at];
        }
    }
    inside
}

fn no_normal(error: DirectionError) -> Error {
    Error::new(format!("the net has no mean normal: link one to the port `normal`: {error}"))
}

/// Returns `sum_r s_r n_r`, where `s_r` is the distance of step r and `n_r` its direction. Each direction is the previous one, rotated by
/// Rodrigues' formula `n cos + (axis x n) sin + axis (axis . n) (1 - cos)`.
fn sum_of_steps(
    net: &value::ControlNet,
    normal: Unit<Vector3<f64>>,
    steps: &[OffsetStep],
) -> Result<Vector3<f64>, Error> {
    let mut direction = normal.into_inner();
    let mut sum = Vector3::zeros();
    for (index, step) in steps.iter().enumerate() {
        if step.angle != 0.0 {
            let axis = match Vector3::from(step.axis) {
                axis if axis == Vector3::zeros() => leaning_axis(net, normal),
                axis => Unit::try_new(axis, 0.0),
            };
            let axis = axis.filter(|axis| axis.cross(&direction).norm() > PARALLEL);
            let Some(axis) = axis.map(Unit::into_inner) else {
                bail!(
                    "step {index} has no rotation axis: give an `axis` that is not parallel to the direction ({:.3}, {:.3}, {:.3})",
                    direction.x,
                    direction.y,
                    direction.z
                );
            };
            let angle = step.angle * (std::f64::consts::PI / 180.0);
            let (sin, cos) = (libm::sin(angle), libm::cos(angle));
            direction = direction * cos
                + axis.cross(&direction) * sin
                + axis * (axis.dot(&direction) * (1.0 - cos));
        }
        sum += direction * step.distance;
    }
    Ok(sum)
}

/// Two vectors count as parallel if the sine of the angle between them is below this value. The direction of the cross product of such
/// vectors would be rounding noise.
const PARALLEL: f64 = 1e-9;

/// Returns the axis around which a positive angle leans the normal along the first principal axis of the net's base, in the direction in
/// which the principal axis's largest coordinate grows.
///
/// With U the opposite of this principal direction, the axis is `U x normal`.
fn leaning_axis(net: &value::ControlNet, normal: Unit<Vector3<f64>>) -> Option<Unit<Vector3<f64>>> {
    let count = net.base().len() as f64;
    let center = net.base().iter().map(|point| point.coords / count).sum::<Vector3<f64>>();
    let covariance = net.base().iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, point| {
        let spoke = point.coords - center;
        sum + spoke * spoke.transpose() / count
    });
    if !covariance.iter().all(|x| x.is_finite()) {
        return None;
    }
    let eigen = covariance.try_symmetric_eigen(f64::EPSILON, 1000)?;
    // If several eigenvalues are equally large, the first of them counts as the largest.
    fn larger(a: usize, b: usize, values: &Vector3<f64>) -> usize {
        if values[a] < values[b] { b } else { a }
    }
    let widest = larger(larger(0, 1, &eigen.eigenvalues), 2, &eigen.eigenvalues);
    let principal = eigen.eigenvectors.column(widest).into_owned();
    fn largest(a: usize, b: usize, principal: Vector3<f64>) -> usize {
        if principal[a].abs() < principal[b].abs() { b } else { a }
    }
    let sign = principal[largest(largest(0, 1, principal), 2, principal)].signum();
    Unit::try_new(normal.cross(&(principal * sign)), PARALLEL)
}

/// Returns the mean of the unit normals of the base's quads. They point in the direction of the cross product of the u and v directions.
fn mean_normal(net: &value::ControlNet) -> Result<Direction, DirectionError> {
    let (columns, base) = (net.columns(), net.base());
    let mut sum = Vector3::zeros();
    let mut count = 0.0;
    for row in 1..net.rows() {
        for column in 1..columns {
            let at = row * columns + column;
            let falling = base[at] - base[at - columns - 1];
            let rising = base[at - columns] - base[at - 1];
            if let Some(normal) = falling.cross(&rising).try_normalize(0.0) {
                sum += normal;
                count += 1.0;
            }
        }
    }
    Direction::mean(if count == 0.0 { sum } else { sum / count })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::super::control_net::tests::{range, region};
    use super::super::control_net::{NetMethod, control_net};
    use super::*;

    const TOWARDS_SENSOR: [f64; 3] = [0.0, 0.0, -1.0];

    fn towards_sensor() -> Option<Unit<Vector3<f64>>> {
        Some(Unit::new_unchecked(TOWARDS_SENSOR.into()))
    }

    /// Returns the net of a wide rectangle on a plane with signed zeros.
    fn net() -> value::ControlNet {
        let range = range(24, 14, |_, _| -0.0);
        control_net(
            &region(&range, |x, y| (4..20).contains(&x) && (4..10).contains(&y)),
            &range,
            NetMethod::Grid,
            0,
            0,
            &Progress::silent(),
        )
        .unwrap()
    }

    fn step(distance: f64, angle: f64, axis: [f64; 3]) -> OffsetStep {
        OffsetStep { distance, angle, axis }
    }

    fn displacement(steps: &[OffsetStep]) -> Result<Vector3<f64>, Error> {
        let net = net();
        let free = net.fixed_points().iter().position(|&fixed| fixed == 0).unwrap();
        let after = offset_net(
            &net,
            towards_sensor(),
            None,
            None,
            steps,
            Profile::Plateau,
            &Progress::silent(),
        )?;
        Ok(after.points()[free] - net.points()[free])
    }

    #[test]
    fn an_offset_of_zero_keeps_every_bit() {
        let net = net();
        fn bits(net: &value::ControlNet) -> Vec<[u64; 3]> {
            net.points().iter().map(|point| [0, 1, 2].map(|k| point[k].to_bits())).collect()
        }
        for steps in [
            &[][..],
            &[step(0.0, 0.0, [0.0; 3])],
            &[step(3.0, 0.0, [0.0; 3]), step(-3.0, 0.0, [0.0; 3])],
        ] {
            for profile in [Profile::Cosine, Profile::Plateau] {
                let same = offset_net(
                    &net,
                    towards_sensor(),
                    None,
                    None,
                    steps,
                    profile,
                    &Progress::silent(),
                )
                .unwrap();
                assert_eq!(bits(&same), bits(&net));
            }
        }
    }

    #[test]
    fn a_plateau_moves_free_points_the_whole_way_and_no_others() {
        let net = net();
        let steps = [step(12.0, 0.0, [0.0; 3])];
        let after = offset_net(
            &net,
            towards_sensor(),
            None,
            None,
            &steps,
            Profile::Plateau,
            &Progress::silent(),
        )
        .unwrap();
        let whole = Vector3::from(TOWARDS_SENSOR) * 12.0;
        for (at, point) in net.points().iter().enumerate() {
            let expected = if net.fixed_points()[at] == 1 { *point } else { point + whole };
            assert_eq!(after.points()[at], expected);
        }
        assert_eq!(after.base(), net.points());
    }

    #[test]
    fn a_second_direction_at_a_right_angle_is_the_axis_times_the_first() {
        let axis = [1.0, 0.0, 0.0];
        let offset = displacement(&[step(5.0, 0.0, axis), step(2.0, 90.0, axis)]).unwrap();
        let first = Vector3::from(TOWARDS_SENSOR);
        let expected = first * 5.0 + Vector3::from(axis).cross(&first) * 2.0;
        assert!((offset - expected).norm() <= 1e-12, "{offset}");
    }

    #[test]
    fn the_chosen_axis_leans_the_offset_along_the_net() {
        let offset = displacement(&[step(1.0, 0.0, [0.0; 3]), step(1.0, 30.0, [0.0; 3])]).unwrap();
        let expected = Vector3::new(0.5, 0.0, -1.0 - 0.75f64.sqrt());
        assert!((offset - expected).norm() <= 1e-12, "{offset}");
    }

    #[test]
    fn an_axis_along_the_direction_turns_nothing() {
        let parallel = displacement(&[step(1.0, 0.0, [0.0; 3]), step(1.0, 10.0, [0.0, 0.0, 2.0])]);
        let parallel = parallel.unwrap_err().to_string();
        assert!(parallel.starts_with("step 1 has no rotation axis: give an `axis`"), "{parallel}");
        let along_x = Some(Unit::new_unchecked(Vector3::x()));
        let steps = [step(1.0, 10.0, [0.0; 3])];
        let chosen =
            offset_net(&net(), along_x, None, None, &steps, Profile::Plateau, &Progress::silent());
        let chosen = chosen.unwrap_err().to_string();
        assert!(
            chosen.ends_with("not parallel to the direction (1.000, 0.000, 0.000)"),
            "{chosen}"
        );
    }

    #[test]
    fn without_a_normal_a_capture_grows_towards_the_sensor() {
        let steps = [step(2.0, 0.0, [0.0; 3])];
        let after =
            offset_net(&net(), None, None, None, &steps, Profile::Plateau, &Progress::silent())
                .unwrap();
        let lowest = after.points().iter().map(|point| point.z).fold(0.0, f64::min);
        assert!((lowest + 2.0).abs() <= 1e-12);
        let point = value::ControlNet::new(2, 2, vec![Point3::origin(); 4]).unwrap();
        let none =
            offset_net(&point, None, None, None, &steps, Profile::Plateau, &Progress::silent());
        let none = none.unwrap_err().to_string();
        assert!(none.starts_with("the net has no mean normal: link one to"), "{none}");
    }

    #[test]
    fn an_offset_beyond_the_largest_coordinate_is_refused() {
        let error = displacement(&[step(1e308, 0.0, [0.0; 3])]).unwrap_err().to_string();
        let text = "is not finite: a net's coordinates and weights stay below 3.4e38 in size, which files can hold";
        assert!(error.starts_with("control point (") && error.ends_with(text), "{error}");
        assert!(displacement(&[step(1e30, 0.0, [0.0; 3])]).is_ok());
    }

    #[test]
    fn a_region_restricts_the_offset() {
        let net = net();
        let left = region(&range(24, 14, |_, _| 0.0), |x, _| x < 10);
        let steps = [step(1.0, 0.0, [0.0; 3])];
        let after = offset_net(
            &net,
            towards_sensor(),
            None,
            Some(&left),
            &steps,
            Profile::Plateau,
            &Progress::silent(),
        )
        .unwrap();
        for (at, point) in after.points().iter().enumerate() {
            let expected = net.fixed_points()[at] == 0 && point.x < 10.0;
            assert_eq!(point.z != 0.0, expected, "{point}");
        }
        let other = region(&range(5, 5, |_, _| 0.0), |_, _| true);
        let refused = offset_net(
            &net,
            towards_sensor(),
            None,
            Some(&other),
            &steps,
            Profile::Plateau,
            &Progress::silent(),
        );
        let size = "the region is part of a grid of [5, 5] cells, the net of one of [24, 14]";
        assert_eq!(refused.unwrap_err().to_string(), size);
    }
}
