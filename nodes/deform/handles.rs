//! Places handles on an object by a rule.

use std::sync::atomic::{AtomicBool, Ordering};

use maquette_mesh::Movable;
use maquette_node::{Cancelled, Context, Error, In, Node, Progress};
use maquette_value as value;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Handle, HandleSpace, HandlesError};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::free_form::object::{bounds, points};
use super::gaussian::layout::{Bounds, MOST_HANDLES};

/// Places handles on an object by a rule, all at rest. `Ffd` takes them as its `layout`, and drags some of them by its
/// `targets`.
///
/// The handles are in mm, wherever the object is.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Handles {
    /// What they are placed on: a mesh, a range image, points, a curve or a control net.
    pub mesh: In<Movable>,
    /// Where.
    #[serde(default)]
    pub on: On,
    /// The space of all lengths and places here: the object's box, a cube, or its own coordinates.
    #[serde(default)]
    pub space: HandleSpace,
    /// Standard deviations of all along x, y and z; chosen from their distances if left out.
    #[schemars(extend("items" = serde_json::json!({ "type": "number", "format": "double", "exclusiveMinimum": 0.0 })))]
    #[serde(default)]
    pub sigma: Option<[f64; 3]>,
}

/// Where handles are placed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum On {
    /// At the eight corners of the object's box: x first, then y, then z.
    #[default]
    Box,
    /// At the points where the object touches its box: the lowest and the highest along x, y and z.
    Bounds,
    /// At this many of its points, each as far as possible from those before it.
    Farthest(#[schemars(range(min = 1, max = 2000))] usize),
    /// At points of a part of it, each as far as possible from those before it.
    Region {
        /// Which part.
        within: Within,
        /// How many.
        #[schemars(range(min = 1, max = 2000))]
        #[serde(default = "eight")]
        count: usize,
    },
}

fn eight() -> usize {
    8
}

/// A part of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Within {
    /// The points in a ball.
    Ball {
        /// Its center.
        at: [f64; 3],
        /// Its radius.
        #[schemars(range(min = 0.0))]
        radius: f64,
    },
    /// The points in a box, its sides included.
    Box {
        /// Its lowest corner.
        #[schemars(extend("most" = "high"))]
        low: [f64; 3],
        /// Its highest corner.
        high: [f64; 3],
    },
    /// The vertices at which this attribute of a mesh or of points is greater than 0.
    Marked(String),
}

/// Why no handles can be placed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlaceHandlesError {
    /// An object without points.
    #[error("there is no point to place a handle on")]
    Nothing,
    /// A region without points.
    #[error("the region has no point of the object")]
    EmptyRegion,
    /// No handles, or too many.
    #[error("{count} handles cannot be placed; at least 1 and at most {most} can")]
    Count {
        /// The number asked for.
        count: usize,
        /// The most.
        most: usize,
    },
    /// No such attribute.
    #[error("there is no attribute `{name}` of one number per vertex")]
    NoAttribute {
        /// Its name.
        name: String,
    },
    /// Numbers that are no handles.
    #[error(transparent)]
    Handles(#[from] HandlesError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl Node for Handles {
    type Outputs = (value::Handles,);
    const OUTPUTS: [&'static str; 1] = ["handles"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let what = cx.get(&self.mesh);
        let handles = place_handles(&what, &self.on, self.space, self.sigma, cx.progress())?;
        let wanted = match self.on {
            On::Box | On::Bounds => 0,
            On::Farthest(count) | On::Region { count, .. } => count,
        };
        if handles.len() < wanted {
            cx.warn(format!(
                "there are only {} different points for {wanted} handles",
                handles.len()
            ));
        }
        Ok((handles,))
    }
}

/// Handles at rest on an object, in mm; fewer than asked for if the object has fewer different points.
///
/// The numbers of `on` and `sigma` are in `space`. Places are taken as in Gonzalez, "Clustering to minimize the maximum
/// intercluster distance" (1985); the first is the one farthest from the mean of all, and of equal ones always the first.
///
/// # Errors
/// If there is no point to place a handle on, no such attribute, or a number is not finite or not greater than 0 where it must
/// be.
pub fn place_handles(
    what: &Movable,
    on: &On,
    space: HandleSpace,
    sigma: Option<[f64; 3]>,
    progress: &Progress<'_>,
) -> Result<value::Handles, PlaceHandlesError> {
    let bounds = bounds(what).ok_or(PlaceHandlesError::Nothing)?;
    let unit =
        Handle { at: [0.0; 3], to: None, sigma: Some(sigma.unwrap_or([1.0; 3])), weight: 1.0 };
    let scaled = value::Handles::new(space, &[unit])?.in_world(bounds)?.sigma()[0];
    let there = points(what).iter().copied().filter(|point| !point.x.is_nan());
    let places: Vec<Point3<f64>> = match on {
        On::Box => corners(bounds),
        On::Bounds => extremes(&Vec::from_iter(there)),
        On::Farthest(count) => farthest(&Vec::from_iter(there), *count, progress)?,
        On::Region { within, count } => {
            let part = part(what, within, space, bounds)?;
            farthest(&part, *count, progress)?
        }
    };
    let sigma = sigma.map(|_| scaled);
    Ok(value::Handles::new(
        HandleSpace::World,
        &places
            .into_iter()
            .map(|place: Point3<f64>| Handle { at: place.into(), to: None, sigma, weight: 1.0 })
            .collect::<Vec<_>>(),
    )?)
}

fn corners((low, high): Bounds) -> Vec<Point3<f64>> {
    (0..8)
        .map(|k: usize| {
            let axis = |axis: usize| if k >> axis & 1 == 1 { high[axis] } else { low[axis] };
            Point3::new(axis(0), axis(1), axis(2))
        })
        .collect()
}

/// The lowest and the highest point along each axis; one that is several of them once.
fn extremes(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut places: Vec<Point3<f64>> = Vec::new();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            fn beyond(a: &Point3<f64>, b: &Point3<f64>, sign: f64, axis: usize) -> bool {
                sign * b[axis] < sign * a[axis]
            }
            let lowest = points
                .iter()
                .copied()
                .reduce(|a, b| if beyond(&a, &b, sign, axis) { b } else { a });
            places.extend(lowest.filter(|place| !places.contains(place)));
        }
    }
    places
}

/// The points of an object that are in a region.
fn part(
    what: &Movable,
    within: &Within,
    space: HandleSpace,
    bounds: Bounds,
) -> Result<Vec<Point3<f64>>, PlaceHandlesError> {
    let unit = Handle { at: [0.0; 3], to: None, sigma: Some([1.0; 3]), weight: 1.0 };
    let unit = value::Handles::new(space, &[unit])?.in_world(bounds)?;
    let (origin, scale) = (unit.at()[0], Vector3::from(unit.sigma()[0]));
    let inside: Box<dyn Fn(usize, Vector3<f64>) -> bool> = match within {
        Within::Ball { at, radius } => {
            let (at, radius) = (Vector3::from(*at), *radius);
            Box::new(move |_, place| (place - at).norm() <= radius)
        }
        Within::Box { low, high } => {
            let (low, high) = (*low, *high);
            Box::new(move |_, place| (0..3).all(|k| low[k] <= place[k] && place[k] <= high[k]))
        }
        Within::Marked(name) => {
            let marks = marks(what, name)
                .ok_or_else(|| PlaceHandlesError::NoAttribute { name: name.clone() })?;
            Box::new(move |index, _| marks[index])
        }
    };
    let all = points(what).iter().enumerate().filter(|(_, point)| !point.x.is_nan());
    let part: Vec<Point3<f64>> = all
        .filter(|(index, point)| inside(*index, (*point - origin).component_div(&scale)))
        .map(|(_, point)| *point)
        .collect();
    if part.is_empty() { Err(PlaceHandlesError::EmptyRegion) } else { Ok(part) }
}

fn marks(what: &Movable, name: &str) -> Option<Vec<bool>> {
    let attribute = match what {
        Movable::Mesh(mesh) => mesh.vertex().get(name),
        Movable::Points(points) => points.attributes().get(name),
        Movable::RangeImage(_) | Movable::Curve(_) | Movable::ControlNet(_) => None,
    };
    match attribute? {
        Attribute::Flag(flags) => Some(flags.iter().map(|flag| *flag > 0).collect()),
        Attribute::Index(numbers) => Some(numbers.iter().map(|number| *number > 0).collect()),
        Attribute::Number(numbers) => Some(numbers.iter().map(|number| *number > 0.0).collect()),
        Attribute::Pair(_) | Attribute::Vector(_) | Attribute::Color(_) => None,
    }
}

/// Points that one task looks at.
const CHUNK: usize = 4096;

/// Up to `count` of the points, each the farthest from those before it.
fn farthest(
    points: &[Point3<f64>],
    count: usize,
    progress: &Progress<'_>,
) -> Result<Vec<Point3<f64>>, PlaceHandlesError> {
    if count == 0 || MOST_HANDLES < count {
        return Err(PlaceHandlesError::Count { count, most: MOST_HANDLES });
    }
    let sum = points.iter().map(|point| point.coords).sum::<Vector3<f64>>();
    let mean = sum / points.len() as f64;
    let mut place = Point3::from(mean);
    let mut nearest = vec![f64::INFINITY; points.len()];
    let mut places = Vec::new();
    for step in 0..=count {
        progress.tick(step as f64 / count as f64)?;
        // The distances to the mean only choose the first place.
        let keep = step > 1;
        let is_cancelled = AtomicBool::new(false);
        let best = nearest.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).enumerate();
        let best = best.map(|(chunk, (nearest, points))| {
            is_cancelled.fetch_or(progress.check().is_err(), Ordering::Relaxed);
            let mut best = (f64::NEG_INFINITY, 0);
            for (index, (nearest, point)) in nearest.iter_mut().zip(points).enumerate() {
                let distance = (point - place).norm_squared();
                *nearest = if keep { nearest.min(distance) } else { distance };
                if *nearest > best.0 {
                    best = (*nearest, chunk * CHUNK + index);
                }
            }
            best
        });
        // In the order of the points, so that of equal ones the first is taken.
        let best =
            best.collect::<Vec<_>>().into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a });
        if is_cancelled.into_inner() {
            return Err(Cancelled.into());
        }
        let Some((distance, index)) = best else { break };
        if step == count || (step > 0 && distance <= 0.0) {
            break;
        }
        place = points[index];
        places.push(place);
    }
    Ok(places)
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

    fn places(on: On, space: HandleSpace) -> Result<Vec<[f64; 3]>, PlaceHandlesError> {
        let handles = place_handles(&grid(), &on, space, None, &Progress::none())?;
        assert_eq!(handles.at(), handles.to());
        Ok(handles.at().iter().map(|&at| at.into()).collect())
    }

    #[test]
    fn the_farthest_points_of_a_square_are_its_corners_and_its_middle() {
        fn corner(x: f64, y: f64) -> [f64; 3] {
            [4.0 * x, 4.0 * y, 0.0]
        }
        let expected =
            [corner(0., 0.), corner(1., 1.), corner(1., 0.), corner(0., 1.), corner(0.5, 0.5)];
        assert_eq!(places(On::Farthest(5), HandleSpace::Box).unwrap(), expected);
        assert_eq!(places(On::Farthest(99), HandleSpace::Box).unwrap().len(), 25);
    }

    #[test]
    fn boxes_have_corners_and_objects_touch_them() {
        assert_eq!(places(On::Box, HandleSpace::Box).unwrap()[3], [4.0, 4.0, 0.0]);
        let touching = places(On::Bounds, HandleSpace::Box).unwrap();
        assert_eq!(touching, [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
    }

    #[test]
    fn regions_are_given_in_their_space() {
        fn region(within: Within) -> On {
            On::Region { within, count: 2 }
        }
        let ball = region(Within::Ball { at: [0.25, 0.25, 0.0], radius: 0.2 });
        assert_eq!(places(ball, HandleSpace::Box).unwrap(), [[1.0, 1.0, 0.0]]);
        let part = region(Within::Box { low: [2.0, 0.0, 0.0], high: [3.0, 0.5, 1.0] });
        assert_eq!(places(part, HandleSpace::World).unwrap(), [[2., 0., 0.], [3., 0., 0.]]);
        let marked = region(Within::Marked("mark".into()));
        assert_eq!(places(marked, HandleSpace::Box).unwrap(), [[2., 1., 0.], [3., 1., 0.]]);
        let error = places(region(Within::Marked("uv".into())), HandleSpace::Box).unwrap_err();
        assert_eq!(error, PlaceHandlesError::NoAttribute { name: "uv".into() });
        let nowhere = region(Within::Ball { at: [9.0; 3], radius: 0.1 });
        assert_eq!(places(nowhere, HandleSpace::Box), Err(PlaceHandlesError::EmptyRegion));
    }

    #[test]
    fn deviations_are_given_in_the_space_and_kept_in_mm() {
        fn place(sigma: Option<[f64; 3]>) -> maquette_value::Handles {
            place_handles(&grid(), &On::Box, HandleSpace::Box, sigma, &Progress::none()).unwrap()
        }
        assert_eq!(place(Some([0.5, 0.25, 1.0])).sigma()[0], [2.0, 1.0, 4.0]);
        assert_eq!(place(None).sigma()[0], [0.0; 3]);
    }
}
