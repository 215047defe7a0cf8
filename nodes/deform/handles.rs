//! Places handles on an object by a rule.

use std::sync::atomic::{AtomicBool, Ordering};

use maquette_mesh::Movable;
use maquette_node::{CancelledError, Context, Error, In, Node, Progress, bail};
use maquette_value as value;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Attributes, Handle, HandleSpace};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::free_form::object::{bounds, points};
use super::gaussian::layout::{Bounds, MAX_HANDLES};

/// Places handles on an object by a rule, all at rest. `Ffd` takes them as its `layout`, and moves some of them by its `targets`.
///
/// Handle positions are in mm, in the coordinates of the object.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Handles {
    /// Object on which handles are placed: a mesh, a range image, points, a curve or a control net.
    pub mesh: In<Movable>,
    /// Rule that places the handles.
    #[serde(default)]
    pub on: Placement,
    /// Coordinate space of all lengths and positions here: the object's box, a cube, or the object's own coordinates.
    #[serde(default)]
    pub space: HandleSpace,
    /// Standard deviations of all handles along x, y and z. If omitted, they are chosen from the distances between handles.
    #[schemars(extend("items" = serde_json::json!({ "type": "number", "format": "double", "exclusiveMinimum": 0.0 })))]
    #[serde(default)]
    pub sigma: Option<[f64; 3]>,
}

/// Rule that places handles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "On")]
pub enum Placement {
    /// The eight corners of the object's bounding box: x varies first, then y, then z.
    #[default]
    Box,
    /// The points at which the object touches its bounding box: minimum and maximum along x, y and z.
    Bounds,
    /// The given number of the object's points, each as far as possible from the previous ones.
    Farthest(#[schemars(range(min = 1, max = 2000))] usize),
    /// Points in a region of the object, each as far as possible from the previous ones.
    Region {
        /// Region of the object.
        within: HandleRegion,
        /// Number of handles.
        #[schemars(range(min = 1, max = 2000))]
        #[serde(default = "default_count")]
        count: usize,
    },
}

fn default_count() -> usize {
    8
}

/// A region of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename = "Within")]
pub enum HandleRegion {
    /// The points in a ball.
    Ball {
        /// Center of the ball.
        at: [f64; 3],
        /// Radius of the ball.
        #[schemars(range(min = 0.0))]
        radius: f64,
    },
    /// The points in a box, including its boundary.
    Box {
        /// Minimum corner of the box.
        #[schemars(extend("most" = "high"))]
        low: [f64; 3],
        /// Maximum corner of the box.
        high: [f64; 3],
    },
    /// The vertices at which this attribute of a mesh or of points is greater than 0.
    Marked(String),
}

impl Node for Handles {
    type Outputs = (value::Handles,);
    const OUTPUTS: [&'static str; 1] = ["handles"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let object = cx.get(&self.mesh);
        let handles = place_handles(&object, &self.on, self.space, self.sigma, cx.progress())?;
        let wanted = match self.on {
            Placement::Box | Placement::Bounds => 0,
            Placement::Farthest(count) | Placement::Region { count, .. } => count,
        };
        if handles.len() < wanted {
            cx.warn(format!(
                "the object has only {} distinct points, so that it gets {} instead of {wanted} handles",
                handles.len(),
                handles.len()
            ));
        }
        Ok((handles,))
    }
}

/// Returns handles at rest on an object, in mm; fewer than requested if the object has fewer distinct points.
///
/// Lengths in `on` and `sigma` are measured in the unit of `space`. Points are chosen as in Gonzalez, "Clustering to minimize the maximum
/// intercluster distance" (1985). The first is the point farthest from the mean of all points; of several equally far points, the first is
/// taken.
///
/// # Errors
/// Returns an error if there is no point to place a handle on, or if the attribute does not exist. Also if a number in `on` or `sigma` is
/// not finite, or a length is not greater than 0.
pub fn place_handles(
    object: &Movable,
    on: &Placement,
    space: HandleSpace,
    sigma: Option<[f64; 3]>,
    progress: &Progress<'_>,
) -> Result<value::Handles, Error> {
    let bounds =
        bounds(object).ok_or_else(|| Error::new("the object has no points to place handles on"))?;
    let unit =
        Handle { at: [0.0; 3], to: None, sigma: Some(sigma.unwrap_or([1.0; 3])), weight: 1.0 };
    let scaled = value::Handles::new(space, &[unit])?.in_world(bounds)?.sigma()[0];
    let valid = points(object).iter().copied().filter(|point| !point.x.is_nan());
    let positions: Vec<Point3<f64>> = match on {
        Placement::Box => corners(bounds),
        Placement::Bounds => extremes(&valid.collect::<Vec<_>>()),
        Placement::Farthest(count) => farthest(&valid.collect::<Vec<_>>(), *count, progress)?,
        Placement::Region { within, count } => {
            let part = points_in_region(object, within, space, bounds)?;
            farthest(&part, *count, progress)?
        }
    };
    let sigma = sigma.map(|_| scaled);
    Ok(value::Handles::new(
        HandleSpace::World,
        &positions
            .into_iter()
            .map(|position: Point3<f64>| Handle {
                at: position.into(),
                to: None,
                sigma,
                weight: 1.0,
            })
            .collect::<Vec<_>>(),
    )?)
}

fn corners((low, high): Bounds) -> Vec<Point3<f64>> {
    (0..8)
        .map(|k: usize| {
            Point3::from(
                [0, 1, 2]
                    .map(|axis: usize| if k >> axis & 1 == 1 { high[axis] } else { low[axis] }),
            )
        })
        .collect()
}

/// Returns the points with the minimum and the maximum coordinate along each axis, without duplicates.
fn extremes(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut extremes: Vec<Point3<f64>> = Vec::new();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let lowest = points
                .iter()
                .copied()
                .reduce(|a, b| if sign * b[axis] < sign * a[axis] { b } else { a });
            extremes.extend(lowest.filter(|point| !extremes.contains(point)));
        }
    }
    extremes
}

/// Returns the points of an object that are in the region `within`.
fn points_in_region(
    object: &Movable,
    within: &HandleRegion,
    space: HandleSpace,
    bounds: Bounds,
) -> Result<Vec<Point3<f64>>, Error> {
    let unit = Handle { at: [0.0; 3], to: None, sigma: Some([1.0; 3]), weight: 1.0 };
    let unit = value::Handles::new(space, &[unit])?.in_world(bounds)?;
    let (origin, scale) = (unit.positions()[0], Vector3::from(unit.sigma()[0]));
    let inside: Box<dyn Fn(usize, Vector3<f64>) -> bool> = match within {
        HandleRegion::Ball { at, radius } => {
            let (at, radius) = (Vector3::from(*at), *radius);
            Box::new(move |_, position| (position - at).norm() <= radius)
        }
        HandleRegion::Box { low, high } => {
            let (low, high) = (*low, *high);
            Box::new(move |_, position| {
                (0..3).all(|k| low[k] <= position[k] && position[k] <= high[k])
            })
        }
        HandleRegion::Marked(name) => {
            let marks = marks(object, name).ok_or_else(|| {
                Error::new(format!(
                    "the object has no attribute `{name}` of one number per vertex; {}",
                    describe_marks(object)
                ))
            })?;
            Box::new(move |index, _| marks[index])
        }
    };
    let all = points(object).iter().enumerate().filter(|(_, point)| !point.x.is_nan());
    let part: Vec<Point3<f64>> = all
        .filter(|(index, point)| inside(*index, (*point - origin).component_div(&scale)))
        .map(|(_, point)| *point)
        .collect();
    if part.is_empty() {
        let [low, high] =
            [bounds.0, bounds.1].map(|corner| (corner - origin).component_div(&scale));
        bail!(
            "the region contains no point of the object, which is between ({:.3}, {:.3}, {:.3}) and ({:.3}, {:.3}, {:.3}) in its `space`",
            low.x,
            low.y,
            low.z,
            high.x,
            high.y,
            high.z
        )
    }
    Ok(part)
}

/// Returns the attributes of an object's points, if objects of its type have attributes.
fn attributes(object: &Movable) -> Option<&Attributes> {
    match object {
        Movable::Mesh(mesh) => Some(mesh.vertex()),
        Movable::Points(points) => Some(points.attributes()),
        Movable::RangeImage(_) | Movable::Curve(_) | Movable::ControlNet(_) => None,
    }
}

/// Returns the part of an error message that lists the attributes that [`marks`] can read.
fn describe_marks(object: &Movable) -> String {
    let names = attributes(object).into_iter().flat_map(Attributes::iter).map(|(name, _)| name);
    let names = names.filter(|name| marks(object, name).is_some());
    let names: Vec<_> = names.map(|name| format!("`{name}`")).collect();
    if names.is_empty() {
        "it has none of this kind; use `Ball` or `Box`".to_owned()
    } else {
        format!("it has {}", names.join(", "))
    }
}

fn marks(object: &Movable, name: &str) -> Option<Vec<bool>> {
    match attributes(object)?.get(name)? {
        Attribute::Flag(flags) => Some(flags.iter().map(|flag| *flag > 0).collect()),
        Attribute::Index(numbers) => Some(numbers.iter().map(|number| *number > 0).collect()),
        Attribute::Number(numbers) => Some(numbers.iter().map(|number| *number > 0.0).collect()),
        Attribute::Pair(_) | Attribute::Vector(_) | Attribute::Color(_) => None,
    }
}

/// The number of points that one task processes.
const CHUNK_SIZE: usize = 4096;

/// Returns up to `count` of the points, each as far as possible from the previous ones.
fn farthest(
    points: &[Point3<f64>],
    count: usize,
    progress: &Progress<'_>,
) -> Result<Vec<Point3<f64>>, Error> {
    if count == 0 || MAX_HANDLES < count {
        bail!("expected 1 to {MAX_HANDLES} handles, found {count}");
    }
    let sum = points.iter().map(|point| point.coords).sum::<Vector3<f64>>();
    let mean = sum / points.len() as f64;
    let mut position = Point3::from(mean);
    let mut nearest = vec![f64::INFINITY; points.len()];
    let mut positions = Vec::new();
    for step in 0..=count {
        progress.tick(step as f64 / count as f64)?;
        // In the first step, the distances are those from the mean of all points. In later steps, they are those from the chosen points.
        let keep = step > 1;
        let is_cancelled = AtomicBool::new(false);
        let best =
            nearest.par_chunks_mut(CHUNK_SIZE).zip(points.par_chunks(CHUNK_SIZE)).enumerate();
        let best = best.map(|(chunk, (nearest, points))| {
            is_cancelled.fetch_or(progress.check().is_err(), Ordering::Relaxed);
            let mut best = (f64::NEG_INFINITY, 0);
            for (index, (nearest, point)) in nearest.iter_mut().zip(points).enumerate() {
                let distance = (point - position).norm_squared();
                *nearest = if keep { nearest.min(distance) } else { distance };
                if *nearest > best.0 {
                    best = (*nearest, chunk * CHUNK_SIZE + index);
                }
            }
            best
        });
        // Compare the points in their order, so that the first of several equally far points is taken.
        let best =
            best.collect::<Vec<_>>().into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a });
        if is_cancelled.into_inner() {
            return Err(CancelledError.into());
        }
        let Some((distance, index)) = best else { break };
        if step == count || (step > 0 && distance <= 0.0) {
            break;
        }
        position = points[index];
        positions.push(position);
    }
    Ok(positions)
}

#[cfg(test)]
mod tests {
    use maquette_value::Points;

    use super::*;

    fn grid() -> Movable {
        let points = Points::new(
            (0..25)
                .map(|k: usize| Point3::new((k % 5) as f64, (k / 5) as f64, 0.0))
                .collect::<Vec<_>>(),
        )
        .unwrap();
        let marks = (0..25).map(|k| u8::from(k == 7 || k == 8)).collect();
        Movable::Points(points.with_attribute("mark", Attribute::Flag(marks)).unwrap())
    }

    fn positions(on: Placement, space: HandleSpace) -> Result<Vec<[f64; 3]>, Error> {
        let handles = place_handles(&grid(), &on, space, None, &Progress::silent())?;
        assert_eq!(handles.positions(), handles.targets());
        Ok(handles.positions().iter().map(|&at| at.into()).collect())
    }

    #[test]
    fn the_farthest_points_of_a_square_are_its_corners_and_its_middle() {
        fn corner(x: f64, y: f64) -> [f64; 3] {
            [4.0 * x, 4.0 * y, 0.0]
        }
        let expected =
            [corner(0., 0.), corner(1., 1.), corner(1., 0.), corner(0., 1.), corner(0.5, 0.5)];
        assert_eq!(positions(Placement::Farthest(5), HandleSpace::Box).unwrap(), expected);
        assert_eq!(positions(Placement::Farthest(99), HandleSpace::Box).unwrap().len(), 25);
    }

    #[test]
    fn boxes_have_corners_and_objects_touch_them() {
        assert_eq!(positions(Placement::Box, HandleSpace::Box).unwrap()[3], [4.0, 4.0, 0.0]);
        let touching = positions(Placement::Bounds, HandleSpace::Box).unwrap();
        assert_eq!(touching, [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
    }

    #[test]
    fn regions_are_given_in_their_space() {
        fn region(within: HandleRegion) -> Placement {
            Placement::Region { within, count: 2 }
        }
        let ball = region(HandleRegion::Ball { at: [0.25, 0.25, 0.0], radius: 0.2 });
        assert_eq!(positions(ball, HandleSpace::Box).unwrap(), [[1.0, 1.0, 0.0]]);
        let part = region(HandleRegion::Box { low: [2.0, 0.0, 0.0], high: [3.0, 0.5, 1.0] });
        assert_eq!(positions(part, HandleSpace::World).unwrap(), [[2., 0., 0.], [3., 0., 0.]]);
        let marked = region(HandleRegion::Marked("mark".into()));
        assert_eq!(positions(marked, HandleSpace::Box).unwrap(), [[2., 1., 0.], [3., 1., 0.]]);
        let error =
            positions(region(HandleRegion::Marked("uv".into())), HandleSpace::Box).unwrap_err();
        let no_attribute =
            "the object has no attribute `uv` of one number per vertex; it has `mark`";
        assert_eq!(error.to_string(), no_attribute);
        let nowhere = region(HandleRegion::Ball { at: [9.0; 3], radius: 0.1 });
        let error = positions(nowhere, HandleSpace::Box).unwrap_err();
        let nothing = "the region contains no point of the object, which is between (";
        assert!(error.to_string().starts_with(nothing), "{error}");
    }

    #[test]
    fn deviations_are_given_in_the_space_and_kept_in_mm() {
        fn place(sigma: Option<[f64; 3]>) -> maquette_value::Handles {
            place_handles(&grid(), &Placement::Box, HandleSpace::Box, sigma, &Progress::silent())
                .unwrap()
        }
        assert_eq!(place(Some([0.5, 0.25, 1.0])).sigma()[0], [2.0, 1.0, 4.0]);
        assert_eq!(place(None).sigma()[0], [0.0; 3]);
    }
}
