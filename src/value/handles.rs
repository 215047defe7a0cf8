//! Handles: points that deform their surroundings when they are moved.

use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::content::{Content, content_of_fields};
use super::edge_cases::point_sets;
use super::{
    Arrows, Axes, Column, DecodeError, Decoder, ElementKind, Encoder, Layer, Meaning, Part, Parts,
    PartsError, Summary, Value,
};

/// A handle of a deformation: its position, its target, and the extent of its influence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Handle {
    /// The position of the handle.
    pub at: [f64; 3],
    /// The target position; if omitted, the handle stays.
    #[serde(default)]
    pub to: Option<[f64; 3]>,
    /// The extent of the handle's influence, as standard deviations along x, y and z. If omitted, it is chosen from the distances to other
    /// handles.
    #[schemars(extend("items" = serde_json::json!({ "type": "number", "format": "double", "exclusiveMinimum": 0.0 })))]
    #[serde(default)]
    pub sigma: Option<[f64; 3]>,
    /// The weight of the handle relative to the other handles, greater than 0. If all weights are equal, their value does not matter.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    #[serde(default = "default_weight")]
    pub weight: f64,
}

fn default_weight() -> f64 {
    1.0
}

/// The coordinate space in which the handles are given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum HandleSpace {
    /// The object's bounding box, scaled to 0 to 1 along each axis.
    #[default]
    Box,
    /// The cube whose lowest corner is that of the object's bounding box and whose side is the box's longest side, scaled to 0 to 1. The
    /// scale is the same along all axes.
    Cube,
    /// The object's own coordinates, in mm.
    World,
}

impl HandleSpace {
    const ALL: [Self; 3] = [Self::Box, Self::Cube, Self::World];
}

impl Content for HandleSpace {
    fn encode(&self, to: &mut Encoder) {
        to.plain(&(*self as u8));
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let index: u8 = from.plain()?;
        Self::ALL.get(usize::from(index)).copied().ok_or(DecodeError)
    }
}

/// Error of building handles. Contains the message.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct HandlesError(String);

/// A list of handles. The positions, deviations and weights are the *layout* of the handles. The targets are separate from the layout,
/// because expensive computations depend only on the layout.
///
/// Invariant, checked by [`Handles::new`]: positions and targets are finite. The deviations of a handle are finite and greater than 0, or
/// all three are 0, which means that the code that uses the handles chooses them. Weights are finite and greater than 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Handles {
    space: HandleSpace,
    at: Column<Point3<f64>>,
    to: Column<Point3<f64>>,
    sigma: Column<[f64; 3]>,
    weight: Column<f64>,
}

impl Handles {
    /// Builds a list of handles.
    ///
    /// # Errors
    /// If a number is not finite, or a deviation or weight is not greater than 0.
    pub fn new(space: HandleSpace, handles: &[Handle]) -> Result<Self, HandlesError> {
        for (index, handle) in handles.iter().enumerate() {
            check(index, handle)?;
        }
        Ok(Self {
            space,
            at: handles.iter().map(|handle| Point3::from(handle.at)).collect(),
            to: handles.iter().map(|handle| Point3::from(handle.to.unwrap_or(handle.at))).collect(),
            sigma: handles.iter().map(|handle| handle.sigma.unwrap_or_default()).collect(),
            weight: handles.iter().map(|handle| handle.weight).collect(),
        })
    }

    /// The space of the handles' coordinates.
    pub fn space(&self) -> HandleSpace {
        self.space
    }

    /// The number of handles.
    pub fn len(&self) -> usize {
        self.at.len()
    }

    /// Returns true if there are no handles.
    pub fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    /// The positions of the handles.
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.at
    }

    /// The target positions of the handles.
    pub fn targets(&self) -> &[Point3<f64>] {
        &self.to
    }

    /// The standard deviations of each handle along x, y and z. Three zeros mean that the code that uses the handles chooses them.
    pub fn sigma(&self) -> &[[f64; 3]] {
        &self.sigma
    }

    /// The weights of the handles.
    pub fn weight(&self) -> &[f64] {
        &self.weight
    }

    /// Iterates over the handles.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Handle> {
        (0..self.len()).map(|index| Handle {
            at: self.at[index].into(),
            to: Some(self.to[index].into()),
            sigma: Some(self.sigma[index]).filter(|sigma| *sigma != [0.0; 3]),
            weight: self.weight[index],
        })
    }

    /// Converts the handles to mm, for an object whose bounding box has the given corners. Where the box has no extent along an axis, its
    /// longest side is used instead; if it has no extent at all, 1 mm is used.
    ///
    /// # Errors
    /// If a number becomes infinite, or a deviation becomes 0.
    pub fn in_world(&self, (low, high): (Point3<f64>, Point3<f64>)) -> Result<Self, HandlesError> {
        let sides = sides(high - low);
        let scale = match self.space {
            HandleSpace::World => return Ok(self.clone()),
            HandleSpace::Box => sides,
            HandleSpace::Cube => Vector3::repeat(sides.max()),
        };
        let to_world =
            |point: [f64; 3]| (low + Vector3::from(point).component_mul(&scale)).coords.into();
        let moved = self.iter().map(|handle| Handle {
            at: to_world(handle.at),
            to: handle.to.map(to_world),
            sigma: handle.sigma.map(|sigma| Vector3::from(sigma).component_mul(&scale).into()),
            ..handle
        });
        Self::new(HandleSpace::World, &Vec::from_iter(moved))
    }
}

/// The column with this name, which must have `count` elements of three numbers; `None` if it is missing.
fn vectors(
    parts: &Parts<'_>,
    name: &str,
    count: usize,
) -> Result<Option<Vec<[f64; 3]>>, PartsError> {
    let part = parts.column_of(name, 3)?;
    part.map(|part| part.with_count(count)?.elements::<3>()).transpose()
}

/// The sides of a box. Sides of 0 are replaced as in [`Handles::in_world`].
fn sides(extent: Vector3<f64>) -> Vector3<f64> {
    let longest = extent.max();
    let instead = if longest > 0.0 { longest } else { 1.0 };
    extent.map(|side| if side > 0.0 { side } else { instead })
}

fn check(handle: usize, given: &Handle) -> Result<(), HandlesError> {
    fn finite(numbers: &[f64]) -> bool {
        numbers.iter().all(|x| x.is_finite())
    }
    let (target, sigma) = (given.to.unwrap_or(given.at), given.sigma.unwrap_or([1.0; 3]));
    let lists: [(&'static str, &[f64]); 4] = [
        ("position", &given.at),
        ("target", &target),
        ("deviation", &sigma),
        ("weight", &[given.weight]),
    ];
    if let Some((what, _)) = lists.iter().find(|(_, numbers)| !finite(numbers)) {
        return Err(HandlesError(format!("the {what} of handle {handle} is not finite")));
    }
    for (what, numbers) in &lists[2..] {
        if let Some(&number) = numbers.iter().find(|x| **x <= 0.0) {
            return Err(HandlesError(format!(
                "the {what} of handle {handle} is {number}, expected a number greater than 0"
            )));
        }
    }
    Ok(())
}

impl Value for Handles {
    const NAME: &'static str = "Handles";

    content_of_fields! { space at to sigma weight }

    fn describe(&self) -> Summary {
        let moved = self.at.iter().zip(self.to.iter()).filter(|(at, to)| at != to);
        let farthest = moved.clone().map(|(at, to)| (to - at).norm()).fold(0.0, f64::max);
        let summary = Summary::default()
            .with_fact("handles", self.len())
            .with_fact("space", format!("{:?}", self.space))
            .with_fact("moved", moved.count())
            .with_fact("farthest move", farthest);
        super::mesh::describe_bounds(summary, self.at.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("handles", self.len());
        parts.fact("space", format!("{:?}", self.space));
        parts.push("at", ElementKind::Point, Meaning::Position, 3, &self.at[..]);
        parts.push("to", ElementKind::Point, Meaning::Position, 3, &self.to[..]);
        parts.push("sigma", ElementKind::Point, Meaning::Number, 3, &self.sigma[..]);
        parts.push("weight", ElementKind::Point, Meaning::Number, 1, &self.weight[..]);
        parts
    }

    /// Builds handles from parts. Without the part `to`, the targets are the positions. Without `sigma`, the code that uses the handles
    /// chooses the deviations. Without `weight`, all weights are 1.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let space = match parts.fact_of("space") {
            None => HandleSpace::default(),
            Some(fact) => {
                let found =
                    HandleSpace::ALL.into_iter().find(|it| *fact == format!("{it:?}").into());
                found.ok_or_else(|| PartsError::wrong_fact("space", "Box, Cube or World"))?
            }
        };
        let at = parts.require("at", 3)?.elements::<3>()?;
        let weight = parts.column_of("weight", 1)?;
        let weight = weight.map(|part| part.with_count(at.len())).transpose()?;
        let weight = weight.map(|part: &Part<'_>| part.items.numbers());
        let (to, sigma) = (vectors(parts, "to", at.len())?, vectors(parts, "sigma", at.len())?);
        let handles: Vec<_> = at
            .iter()
            .enumerate()
            .map(|(k, &at)| Handle {
                at,
                to: to.as_ref().map(|to| to[k]),
                sigma: sigma.as_ref().map(|sigma| sigma[k]).filter(|sigma| *sigma != [0.0; 3]),
                weight: weight.as_ref().map_or(1.0, |weight| weight[k]),
            })
            .collect();
        Self::new(space, &handles).map_err(PartsError::from_error)
    }

    fn show(&self) -> Vec<Layer> {
        let (from, to) = (self.at.clone(), self.to.clone());
        vec![Layer::Arrows(Arrows { from, to, axes: Axes::Upright })]
    }

    /// Lists without handles, with handles at one position, with far handles of enormous and of tiny extent and weight, and with many
    /// handles at almost one position.
    fn edge_cases() -> Vec<Self> {
        let lists = [0, 1, 2, 9].into_iter().flat_map(point_sets).flat_map(|points| {
            [(1.0, 1.0), (1e-300, 1e300), (1e300, 1e-300), (1e-5, 1.0)].map(|(sigma, weight)| {
                points
                    .iter()
                    .enumerate()
                    .map(|(k, point)| {
                        let to = point + Vector3::new(0.0, k as f64, 0.0);
                        Handle {
                            at: (*point).into(),
                            to: (k % 2 == 0).then(|| to.into()),
                            sigma: (k % 3 != 0).then_some([sigma, 1.0, 2.0 * sigma]),
                            weight,
                        }
                    })
                    .collect::<Vec<_>>()
            })
        });
        lists
            .flat_map(|list| HandleSpace::ALL.map(|space| Self::new(space, &list)))
            .flatten()
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HANDLE: Handle = Handle { at: [0.0; 3], to: None, sigma: None, weight: 1.0 };

    #[test]
    fn invalid_handles_are_refused_with_their_index() {
        fn error(wrong: Handle) -> String {
            Handles::new(HandleSpace::Box, &[HANDLE, wrong]).unwrap_err().to_string()
        }
        assert_eq!(
            error(Handle { to: Some([0.0, f64::NAN, 0.0]), ..HANDLE }),
            "the target of handle 1 is not finite"
        );
        assert_eq!(
            error(Handle { sigma: Some([1.0, 0.0, 1.0]), ..HANDLE }),
            "the deviation of handle 1 is 0, expected a number greater than 0"
        );
        assert_eq!(
            error(Handle { weight: -2.0, ..HANDLE }),
            "the weight of handle 1 is -2, expected a number greater than 0"
        );
    }

    #[test]
    fn a_box_stretches_and_a_cube_does_not() {
        let handle = Handle { at: [1.0, 0.5, 0.0], to: None, sigma: Some([1.0; 3]), weight: 2.0 };
        let bounds = (Point3::new(10.0, 0.0, 5.0), Point3::new(12.0, 8.0, 5.0));
        fn position_and_sigma_in_world(
            space: HandleSpace,
            handle: &Handle,
            bounds: &(Point3<f64>, Point3<f64>),
        ) -> ([f64; 3], [f64; 3]) {
            let world = Handles::new(space, &[*handle]).unwrap().in_world(*bounds).unwrap();
            let handle = world.iter().next().unwrap();
            (handle.at, handle.sigma.unwrap())
        }
        // The box has no extent along z, so its longest side is used.
        assert_eq!(
            position_and_sigma_in_world(HandleSpace::Box, &handle, &bounds),
            ([12.0, 4.0, 5.0], [2.0, 8.0, 8.0])
        );
        assert_eq!(
            position_and_sigma_in_world(HandleSpace::Cube, &handle, &bounds),
            ([18.0, 4.0, 5.0], [8.0; 3])
        );
        assert_eq!(
            position_and_sigma_in_world(HandleSpace::World, &handle, &bounds),
            ([1.0, 0.5, 0.0], [1.0; 3])
        );
    }

    #[test]
    fn omitted_fields_stay_omitted() {
        let handles = Handles::new(HandleSpace::Cube, &[HANDLE]).unwrap();
        let handle = handles.iter().next().unwrap();
        assert_eq!((handle.to, handle.sigma), (Some([0.0; 3]), None));
    }
}
