//! Handles: places that pull what is around them.

use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::hostile::clouds;
use super::{
    Arrows, Axes, Column, DecodeError, Decoder, Encoder, FactValue, Layer, Meaning, On, Part,
    Parts, PartsError, Summary, Value,
};

/// One handle of a deformation: a place, where it goes, and how far around it reaches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Handle {
    /// Where it is.
    pub at: [f64; 3],
    /// Where it goes; it stays if left out.
    #[serde(default)]
    pub to: Option<[f64; 3]>,
    /// Standard deviations along x, y and z: how far it reaches. Chosen from the distances to other handles if left out.
    #[schemars(extend("items" = serde_json::json!({ "type": "number", "format": "double", "exclusiveMinimum": 0.0 })))]
    #[serde(default)]
    pub sigma: Option<[f64; 3]>,
    /// How much it counts beside the others, greater than 0; all equal weights are the same as 1.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    #[serde(default = "one")]
    pub weight: f64,
}

fn one() -> f64 {
    1.0
}

/// The space that handles are given in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum HandleSpace {
    /// The box around the object, each side of which goes from 0 to 1.
    #[default]
    Box,
    /// The cube on the box's lowest corner whose side is the box's longest: 0 to 1, the same scale along all axes.
    Cube,
    /// The object's own coordinates, in mm.
    World,
}

/// Why numbers do not make handles.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum HandlesError {
    /// A place, a deviation or a weight is NaN or infinite.
    #[error("the {what} of handle {handle} is not finite")]
    NotFinite {
        /// The offending handle, counted from 0.
        handle: usize,
        /// `place`, `target`, `deviation` or `weight`.
        what: &'static str,
    },
    /// A deviation or a weight that is not greater than 0.
    #[error("the {what} of handle {handle} is {number}, but it must be greater than 0")]
    NotPositive {
        /// The offending handle, counted from 0.
        handle: usize,
        /// `deviation` or `weight`.
        what: &'static str,
        /// The number.
        number: f64,
    },
}

/// Handles in order. Where they are, their deviations and weights are their *layout*; where they go is apart from it, since
/// what takes long depends on the layout alone.
///
/// Invariant, checked by [`Handles::new`]: places and targets finite; deviations finite and greater than 0, or all three 0,
/// which leaves them to whoever uses the handles; weights finite and greater than 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Handles {
    space: HandleSpace,
    at: Column<Point3<f64>>,
    to: Column<Point3<f64>>,
    sigma: Column<[f64; 3]>,
    weight: Column<f64>,
}

impl Handles {
    /// These handles, in this order.
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

    /// The space of all numbers.
    pub fn space(&self) -> HandleSpace {
        self.space
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.at.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    /// Where they are.
    pub fn at(&self) -> &[Point3<f64>] {
        &self.at
    }

    /// Where they go.
    pub fn to(&self) -> &[Point3<f64>] {
        &self.to
    }

    /// Their deviations; three zeros where they are to be chosen.
    pub fn sigma(&self) -> &[[f64; 3]] {
        &self.sigma
    }

    /// Their weights.
    pub fn weight(&self) -> &[f64] {
        &self.weight
    }

    /// One after the other.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Handle> {
        (0..self.len()).map(|index| Handle {
            at: self.at[index].into(),
            to: Some(self.to[index].into()),
            sigma: Some(self.sigma[index]).filter(|sigma| *sigma != [0.0; 3]),
            weight: self.weight[index],
        })
    }

    /// The same handles in mm, in the box between these corners. A box without extent along an axis has there its longest side,
    /// and one without any a side of 1 mm.
    ///
    /// # Errors
    /// If a number becomes infinite, or a deviation 0.
    pub fn in_world(&self, (low, high): (Point3<f64>, Point3<f64>)) -> Result<Self, HandlesError> {
        let sides = sides(high - low);
        let scale = match self.space {
            HandleSpace::World => return Ok(self.clone()),
            HandleSpace::Box => sides,
            HandleSpace::Cube => Vector3::repeat(sides.max()),
        };
        let place =
            |point: [f64; 3]| (low + Vector3::from(point).component_mul(&scale)).coords.into();
        let moved = self.iter().map(|handle| Handle {
            at: place(handle.at),
            to: handle.to.map(place),
            sigma: handle.sigma.map(|sigma| Vector3::from(sigma).component_mul(&scale).into()),
            ..handle
        });
        Self::new(HandleSpace::World, &Vec::from_iter(moved))
    }
}

/// The sides of a box; see [`Handles::in_world`].
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
        ("place", &given.at),
        ("target", &target),
        ("deviation", &sigma),
        ("weight", &[given.weight]),
    ];
    if let Some((what, _)) = lists.iter().find(|(_, numbers)| !finite(numbers)) {
        return Err(HandlesError::NotFinite { handle, what });
    }
    for (what, numbers) in &lists[2..] {
        if let Some(&number) = numbers.iter().find(|x| **x <= 0.0) {
            return Err(HandlesError::NotPositive { handle, what, number });
        }
    }
    Ok(())
}

impl Value for Handles {
    const NAME: &'static str = "Handles";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&(self.space as u8))
            .column(&self.at)
            .column(&self.to)
            .column(&self.sigma)
            .column(&self.weight);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let space = match from.plain::<u8>()? {
            0 => HandleSpace::Box,
            1 => HandleSpace::Cube,
            2 => HandleSpace::World,
            _ => return Err(DecodeError),
        };
        Ok(Self {
            space,
            at: from.column()?,
            to: from.column()?,
            sigma: from.column()?,
            weight: from.column()?,
        })
    }

    fn size(&self) -> usize {
        self.at.size() + self.to.size() + self.sigma.size() + self.weight.size()
    }

    fn describe(&self) -> Summary {
        let moved = self.at.iter().zip(self.to.iter()).filter(|(at, to)| at != to);
        let farthest = moved.clone().map(|(at, to)| (to - at).norm()).fold(0.0, f64::max);
        let summary = Summary::default()
            .with("handles", self.len())
            .with("space", format!("{:?}", self.space))
            .with("moved", moved.count())
            .with("farthest move", farthest);
        super::mesh::describe_bounds(summary, self.at.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("handles", self.len());
        parts.fact("space", format!("{:?}", self.space));
        parts.push("at", On::Point, Meaning::Position, 3, &self.at[..]);
        parts.push("to", On::Point, Meaning::Position, 3, &self.to[..]);
        parts.push("sigma", On::Point, Meaning::Number, 3, &self.sigma[..]);
        parts.push("weight", On::Point, Meaning::Number, 1, &self.weight[..]);
        parts
    }

    /// Without `to` the handles stay, without `sigma` it is to be chosen, without `weight` all are 1.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let space = match parts.fact_of("space") {
            None => HandleSpace::default(),
            Some(FactValue::Text(word)) if word == "Box" => HandleSpace::Box,
            Some(FactValue::Text(word)) if word == "Cube" => HandleSpace::Cube,
            Some(FactValue::Text(word)) if word == "World" => HandleSpace::World,
            Some(_) => {
                let expected = "Box, Cube or World";
                return Err(PartsError::Fact { fact: "space".into(), expected });
            }
        };
        let at = parts.need("at", 3)?.elements::<3>()?;
        let vectors = |name: &str| {
            let part = parts.column_of(name, 3)?;
            part.map(|part| part.with_count(at.len())?.elements::<3>()).transpose()
        };
        let weight = parts.column_of("weight", 1)?;
        let weight = weight.map(|part| part.with_count(at.len())).transpose()?;
        let weight = weight.map(|part: &Part<'_>| part.items.numbers());
        let (to, sigma) = (vectors("to")?, vectors("sigma")?);
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
        Self::new(space, &handles).map_err(PartsError::refused)
    }

    fn show(&self) -> Vec<Layer> {
        let (from, to) = (self.at.clone(), self.to.clone());
        vec![Layer::Arrows(Arrows { from, to, axes: Axes::Upright })]
    }

    /// None, at one place, far away, of enormous and of vanishing reach and weight, and many at almost one place.
    fn hostile() -> Vec<Self> {
        let lists = [0, 1, 2, 9].into_iter().flat_map(clouds).flat_map(|points| {
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
        let spaces = [HandleSpace::Box, HandleSpace::Cube, HandleSpace::World];
        lists.flat_map(|list| spaces.map(|space| Self::new(space, &list))).flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HANDLE: Handle = Handle { at: [0.0; 3], to: None, sigma: None, weight: 1.0 };

    #[test]
    fn numbers_that_are_no_handle_are_refused_with_its_number() {
        fn error(wrong: Handle) -> String {
            Handles::new(HandleSpace::Box, &[HANDLE, wrong]).unwrap_err().to_string()
        }
        assert_eq!(
            error(Handle { to: Some([0.0, f64::NAN, 0.0]), ..HANDLE }),
            "the target of handle 1 is not finite"
        );
        assert_eq!(
            error(Handle { sigma: Some([1.0, 0.0, 1.0]), ..HANDLE }),
            "the deviation of handle 1 is 0, but it must be greater than 0"
        );
        assert_eq!(
            error(Handle { weight: -2.0, ..HANDLE }),
            "the weight of handle 1 is -2, but it must be greater than 0"
        );
    }

    #[test]
    fn a_box_stretches_and_a_cube_does_not() {
        let handle = Handle { at: [1.0, 0.5, 0.0], to: None, sigma: Some([1.0; 3]), weight: 2.0 };
        let bounds = (Point3::new(10.0, 0.0, 5.0), Point3::new(12.0, 8.0, 5.0));
        fn there(
            space: HandleSpace,
            handle: &Handle,
            bounds: &(Point3<f64>, Point3<f64>),
        ) -> ([f64; 3], [f64; 3]) {
            let world = Handles::new(space, &[*handle]).unwrap().in_world(*bounds).unwrap();
            let handle = world.iter().next().unwrap();
            (handle.at, handle.sigma.unwrap())
        }
        // Without extent along z, the box has there its longest side.
        assert_eq!(there(HandleSpace::Box, &handle, &bounds), ([12.0, 4.0, 5.0], [2.0, 8.0, 8.0]));
        assert_eq!(there(HandleSpace::Cube, &handle, &bounds), ([18.0, 4.0, 5.0], [8.0; 3]));
        assert_eq!(there(HandleSpace::World, &handle, &bounds), ([1.0, 0.5, 0.0], [1.0; 3]));
    }

    #[test]
    fn what_is_left_out_comes_back_as_left_out() {
        let handles = Handles::new(HandleSpace::Cube, &[HANDLE]).unwrap();
        let handle = handles.iter().next().unwrap();
        assert_eq!((handle.to, handle.sigma), (Some([0.0; 3]), None));
    }
}
