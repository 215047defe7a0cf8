//! Regions of space that select parts of a scan.

use maquette_node::{Error, bail};
use maquette_value::{Attribute, Attributes};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::plane::Plane;
use super::scan::{Scan, has_point};

/// A region of space. It includes its boundary.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "Within")]
pub enum Region {
    /// An axis-aligned box.
    Box {
        /// The corner with the lowest coordinates.
        #[schemars(extend("unit" = "mm", "most" = "max"))]
        min: [f64; 3],
        /// The corner with the highest coordinates.
        #[schemars(extend("unit" = "mm"))]
        max: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// The center.
        #[schemars(extend("unit" = "mm"))]
        center: [f64; 3],
        /// The radius.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        radius: f64,
    },
    /// The side of a plane to which its normal points.
    Plane {
        /// A point on the plane.
        #[schemars(extend("unit" = "mm"))]
        through: [f64; 3],
        /// The direction of the normal, of any length.
        #[schemars(extend("direction" = true))]
        normal: [f64; 3],
    },
    /// A range of z coordinates: of a capture, the distance from its sensor along the view direction.
    Depth {
        /// The minimum. If omitted, there is none.
        #[schemars(extend("unit" = "mm", "most" = "to"))]
        #[serde(default)]
        from: Option<f64>,
        /// The maximum. If omitted, there is none.
        #[schemars(extend("unit" = "mm"))]
        #[serde(default)]
        to: Option<f64>,
    },
    /// The points or vertices whose attribute is in a range. A flag counts as 0 or 1.
    Attribute {
        /// The name of the attribute.
        name: String,
        /// The minimum value. If omitted, there is none.
        #[schemars(extend("most" = "to"))]
        #[serde(default)]
        from: Option<f64>,
        /// The maximum value. If omitted, there is none.
        #[serde(default)]
        to: Option<f64>,
    },
}

impl Region {
    /// Returns for each position of a scan true if it is inside the region. A cell without a point is never inside.
    ///
    /// # Errors
    /// Returns an error if a minimum of the box or the depth is above its maximum, the normal is zero, or the scan has no such attribute.
    pub fn contains_each(&self, scan: &Scan) -> Result<Vec<bool>, Error> {
        fn test_positions(
            is_in: &dyn Fn(&Point3<f64>) -> bool,
            scan: &Scan,
        ) -> Result<Vec<bool>, Error> {
            Ok(scan.positions().iter().map(is_in).collect::<Vec<_>>())
        }
        match self {
            Self::Box { min, max } => {
                for (axis, (&min, &max)) in "xyz".chars().zip(min.iter().zip(max)) {
                    if max < min {
                        bail!(
                            "the box goes from {min} to {max} along {axis}: `min` must not be above `max`"
                        );
                    }
                }
                let axes = min.iter().zip(max);
                test_positions(
                    &|at| {
                        at.iter().zip(axes.clone()).all(|(x, (min, max))| (min..=max).contains(&x))
                    },
                    scan,
                )
            }
            Self::Sphere { center, radius } => {
                let center = Point3::from(*center);
                test_positions(&|at| (at - center).norm() <= *radius, scan)
            }
            Self::Plane { through, normal } => {
                let plane =
                    Plane::from_point_and_normal(Point3::from(*through), Vector3::from(*normal));
                let Some(plane) = plane else {
                    bail!("the normal (0, 0, 0) of the plane has no direction");
                };
                test_positions(&|at| plane.height(at) >= 0.0, scan)
            }
            Self::Depth { from: Some(from), to: Some(to) } if to < from => {
                bail!("the depth goes from {from} to {to}: `from` must not be above `to`")
            }
            Self::Depth { from, to } => test_positions(&|at| is_between(at.z, *from, *to), scan),
            Self::Attribute { name, from, to } => {
                let attributes = match scan {
                    Scan::RangeImage(_) => None,
                    Scan::Points(points) => Some(points.attributes()),
                    Scan::Mesh(mesh) => Some(mesh.vertex()),
                };
                let found = attributes.and_then(|all| numbers(all.get(name)?));
                let Some(numbers) = found else {
                    bail!(
                        "there is no attribute `{name}` with a number on each of its {}; there {}",
                        scan.elements(),
                        describe_numeric_attributes(attributes)
                    );
                };
                Ok(numbers.into_iter().map(|number| is_between(number, *from, *to)).collect())
            }
        }
    }
}

/// Returns the part of a scan that is inside `within` and marked in `also`; either condition is ignored if it is `None`. With `invert`,
/// returns the rest of the scan.
pub(super) fn select_parts(
    scan: &Scan,
    within: Option<&Region>,
    also: Option<Vec<bool>>,
    invert: bool,
) -> Result<Scan, Error> {
    let mut kept = match within {
        Some(within) => within.contains_each(scan)?,
        None => scan.positions().iter().map(has_point).collect(),
    };
    if let Some(also) = also {
        kept.iter_mut().zip(also).for_each(|(kept, also)| *kept &= also);
    }
    kept.iter_mut().for_each(|kept| *kept ^= invert);
    Ok(scan.select(&kept))
}

fn is_between(number: f64, from: Option<f64>, to: Option<f64>) -> bool {
    !number.is_nan() && from.is_none_or(|from| from <= number) && to.is_none_or(|to| number <= to)
}

/// Converts an attribute with one number per element to a list of numbers; returns `None` for other types.
fn numbers(attribute: &Attribute) -> Option<Vec<f64>> {
    match attribute {
        Attribute::Number(column) => Some(column.to_vec()),
        Attribute::Index(column) => Some(column.iter().map(|&x| f64::from(x)).collect()),
        Attribute::Flag(column) => Some(column.iter().map(|&x| f64::from(x)).collect()),
        Attribute::Pair(_) | Attribute::Vector(_) | Attribute::Color(_) => None,
    }
}

/// Lists the names of the numeric attributes, as the end of an error message that begins with "there".
fn describe_numeric_attributes(attributes: Option<&Attributes>) -> String {
    let all = attributes.into_iter().flat_map(Attributes::iter);
    let names = all.filter(|(_, it)| numbers(it).is_some()).map(|(name, _)| format!("`{name}`"));
    match &names.collect::<Vec<_>>()[..] {
        [] => "is none".into(),
        [one] => format!("is {one}"),
        several => format!("are {}", several.join(", ")),
    }
}
