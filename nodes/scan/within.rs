//! Parts of space.

use maquette_value::{Attribute, Attributes};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::keep_error::KeepError;
use super::plane::Plane;
use super::scan::{Scan, is_there};

/// A part of space. Its border belongs to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Within {
    /// A box with its sides along the axes.
    Box {
        /// Its lowest corner.
        #[schemars(extend("unit" = "mm", "most" = "max"))]
        min: [f64; 3],
        /// Its highest corner.
        #[schemars(extend("unit" = "mm"))]
        max: [f64; 3],
    },
    /// A ball.
    Sphere {
        /// Its middle.
        #[schemars(extend("unit" = "mm"))]
        center: [f64; 3],
        /// Its radius.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        radius: f64,
    },
    /// The side of a plane to which its normal points.
    Plane {
        /// A place on the plane.
        #[schemars(extend("unit" = "mm"))]
        through: [f64; 3],
        /// Where it looks; its length means nothing.
        #[schemars(extend("direction" = true))]
        normal: [f64; 3],
    },
    /// What is so far away along z: of a capture, from its sensor.
    Depth {
        /// From so far on; from the beginning, if it is left out.
        #[schemars(extend("unit" = "mm", "most" = "to"))]
        #[serde(default)]
        from: Option<f64>,
        /// Up to so far; without end, if it is left out.
        #[schemars(extend("unit" = "mm"))]
        #[serde(default)]
        to: Option<f64>,
    },
    /// Where an attribute of points or vertices has such a value; a flag that is set has 1.
    Attribute {
        /// Its name.
        name: String,
        /// From this value on; from any, if it is left out.
        #[schemars(extend("most" = "to"))]
        #[serde(default)]
        from: Option<f64>,
        /// Up to this value; up to any, if it is left out.
        #[serde(default)]
        to: Option<f64>,
    },
}

impl Within {
    /// Whether each place of a scan is in it. A cell without a point is nowhere.
    ///
    /// # Errors
    /// The box, the depth, the normal or the attribute is none.
    pub fn of(&self, scan: &Scan) -> Result<Vec<bool>, KeepError> {
        fn places(
            is_in: &dyn Fn(&Point3<f64>) -> bool,
            scan: &Scan,
        ) -> Result<Vec<bool>, KeepError> {
            Ok(scan.places().iter().map(is_in).collect::<Vec<_>>())
        }
        match self {
            Self::Box { min, max } => {
                for (axis, (&min, &max)) in "xyz".chars().zip(min.iter().zip(max)) {
                    if max < min {
                        return Err(KeepError::Box { axis, min, max });
                    }
                }
                let axes = || min.iter().zip(max);
                places(
                    &|at| at.iter().zip(axes()).all(|(x, (min, max))| (min..=max).contains(&x)),
                    scan,
                )
            }
            Self::Sphere { center, radius } => {
                let center = Point3::from(*center);
                places(&|at| (at - center).norm() <= *radius, scan)
            }
            Self::Plane { through, normal } => {
                let plane = Plane::through(Point3::from(*through), Vector3::from(*normal));
                let plane = plane.ok_or(KeepError::NoNormal)?;
                places(&|at| plane.height(at) >= 0.0, scan)
            }
            Self::Depth { from: Some(from), to: Some(to) } if to < from => {
                Err(KeepError::Depth { from: *from, to: *to })
            }
            Self::Depth { from, to } => places(&|at| is_between(at.z, *from, *to), scan),
            Self::Attribute { name, from, to } => {
                let attributes = match scan {
                    Scan::RangeImage(_) => None,
                    Scan::Points(points) => Some(points.attributes()),
                    Scan::Mesh(mesh) => Some(mesh.vertex()),
                };
                let found = attributes.and_then(|all| numbers(all.get(name)?));
                let numbers = found.ok_or_else(|| KeepError::NoAttribute {
                    name: name.clone(),
                    elements: scan.elements(),
                    known: known(attributes),
                })?;
                Ok(numbers.into_iter().map(|number| is_between(number, *from, *to)).collect())
            }
        }
    }
}

/// What of a scan is `within` and has a flag in `also`; with `invert` what has not both.
pub(super) fn kept(
    scan: &Scan,
    within: Option<&Within>,
    also: Option<Vec<bool>>,
    invert: bool,
) -> Result<Scan, KeepError> {
    let mut kept = match within {
        Some(within) => within.of(scan)?,
        None => scan.places().iter().map(is_there).collect(),
    };
    if let Some(also) = also {
        kept.iter_mut().zip(also).for_each(|(kept, also)| *kept &= also);
    }
    kept.iter_mut().for_each(|kept| *kept ^= invert);
    Ok(scan.only(&kept))
}

fn is_between(number: f64, from: Option<f64>, to: Option<f64>) -> bool {
    !number.is_nan() && from.is_none_or(|from| from <= number) && to.is_none_or(|to| number <= to)
}

/// The numbers of an attribute that has one for each element.
fn numbers(attribute: &Attribute) -> Option<Vec<f64>> {
    match attribute {
        Attribute::Number(column) => Some(column.to_vec()),
        Attribute::Index(column) => Some(column.iter().map(|&x| f64::from(x)).collect()),
        Attribute::Flag(column) => Some(column.iter().map(|&x| f64::from(x)).collect()),
        Attribute::Pair(_) | Attribute::Vector(_) | Attribute::Color(_) => None,
    }
}

/// The names of the attributes that have numbers.
fn known(attributes: Option<&Attributes>) -> String {
    let all = attributes.into_iter().flat_map(Attributes::iter);
    let names = all.filter(|(_, it)| numbers(it).is_some()).map(|(name, _)| format!("`{name}`"));
    match &Vec::from_iter(names)[..] {
        [] => "is none".into(),
        [one] => format!("is {one}"),
        several => format!("are {}", several.join(", ")),
    }
}
