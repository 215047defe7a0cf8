//! Unconnected points in space.

use nalgebra::Point3;
use thiserror::Error;

use super::content::content_of_fields;
use super::edge_cases::point_sets;
use super::{
    AnyValue, Attribute, AttributeError, Attributes, Axes, Cloud, Column, ElementKind, Elements,
    Layer, Meaning, NoElements, Parts, PartsError, Property, Summary, Value, Violation, value_type,
};
use crate::parallel::*;

/// Error of building points.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PointsError {
    /// A position is NaN or infinite.
    #[error("the position of point {point} is not finite")]
    NotFinite {
        /// The index of the point whose position is not finite.
        point: usize,
    },
    /// An attribute has the wrong length.
    #[error(transparent)]
    Attribute(#[from] AttributeError),
}

/// Points in space with attributes. Axes are right-handed, lengths in mm.
///
/// Invariant, checked by [`Points::new`] and [`Points::with_attribute`]: positions are finite; each attribute has one entry per point.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    positions: Column<Point3<f64>>,
    attributes: Attributes,
}

impl Points {
    /// Builds points without attributes.
    ///
    /// # Errors
    /// If a position is not finite.
    pub fn new(positions: impl Into<Column<Point3<f64>>>) -> Result<Self, PointsError> {
        let positions = positions.into();
        match first_not_finite(&positions) {
            None => Ok(Self { positions, attributes: Attributes::default() }),
            Some(point) => Err(PointsError::NotFinite { point }),
        }
    }

    /// Adds or replaces an attribute.
    ///
    /// # Errors
    /// If the number of entries differs from the number of points.
    pub fn with_attribute(mut self, name: &str, attribute: Attribute) -> Result<Self, PointsError> {
        self.attributes.insert(name, attribute, self.positions.len(), "point")?;
        Ok(self)
    }

    /// Replaces the positions, and drops the attribute `normal`.
    ///
    /// # Errors
    /// If the number of positions differs from the number of points, or one is not finite.
    pub fn with_positions(&self, positions: Vec<Point3<f64>>) -> Result<Self, PointsError> {
        AttributeError::check_len("position", positions.len(), self.positions.len())?;
        let mut moved = Self { attributes: self.attributes.clone(), ..Self::new(positions)? };
        moved.attributes.remove("normal");
        Ok(moved)
    }

    /// The points at the given indices, in this order, with their attributes.
    ///
    /// # Panics
    /// If an index is out of bounds.
    #[must_use]
    pub fn select(&self, indices: &[u32]) -> Self {
        let positions = indices.iter().map(|&index| self.positions[index as usize]);
        Self { positions: positions.collect(), attributes: self.attributes.select(indices) }
    }

    /// The positions of the points.
    pub fn positions(&self) -> &Column<Point3<f64>> {
        &self.positions
    }

    /// The attributes of the points.
    pub fn attributes(&self) -> &Attributes {
        &self.attributes
    }

    /// The minimum and maximum coordinates; `None` without points.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        super::mesh::bounds(self.positions.iter())
    }
}

impl Value for Points {
    const NAME: &'static str = "Points";

    content_of_fields! { positions attributes }

    fn properties() -> &'static [Property<Self>] {
        const {
            &[Property::new("NonEmpty", "There are points.", |value: &Self| {
                value.positions().is_empty().then(|| Violation::lack_of("points"))
            })]
        }
    }

    fn describe(&self) -> Summary {
        let names: Vec<&str> = self.attributes.iter().map(|(name, _)| name).collect();
        let summary = Summary::default()
            .with_fact("points", self.positions.len())
            .with_fact("attributes", names.join(", "));
        super::mesh::describe_bounds(summary, self.positions.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("points", self.positions.len());
        parts.push("position", ElementKind::Point, Meaning::Position, 3, &self.positions[..]);
        parts.columns.extend(self.attributes.parts("", ElementKind::Point));
        parts
    }

    /// Builds points from parts: all columns of points except `position` are attributes.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let position = parts.require("position", 3)?;
        let mut points = Self::new(position.to_points()?).map_err(PartsError::from_error)?;
        for part in &parts.columns {
            if part.element_kind == ElementKind::Point && !std::ptr::eq(part, position) {
                let attribute = Attribute::from_part(part)?;
                points =
                    points.with_attribute(&part.name, attribute).map_err(PartsError::from_error)?;
            }
        }
        Ok(points)
    }

    /// Splits points into single points, each with its attributes.
    fn elements() -> Vec<Elements<Self>> {
        let kind = value_type::<Self>();
        vec![Elements {
            word: "",
            name: "points",
            kind,
            cut: |it, max_count, _| one_by_one(it, max_count),
        }]
    }

    fn show(&self) -> Vec<Layer> {
        vec![Layer::Points(Cloud { points: self.clone(), axes: Axes::Upright })]
    }

    fn edge_cases() -> Vec<Self> {
        [0, 1, 2, 9].into_iter().flat_map(point_sets).flat_map(Self::new).collect()
    }
}

fn one_by_one(points: &Points, max_count: usize) -> Result<Vec<AnyValue>, NoElements> {
    let count = points.positions.len();
    if max_count < count {
        return Err(NoElements::TooMany { count });
    }
    fn single_point(index: u32, points: &Points) -> Points {
        Points {
            positions: vec![points.positions[index as usize]].into(),
            attributes: points.attributes.select(&[index]),
        }
    }
    Ok((0..count as u32).map(|index| AnyValue::new(single_point(index, points))).collect())
}

/// The number of points per parallel task.
const BLOCK: usize = 8192;

/// The index of the first point with a coordinate that is NaN or infinite.
pub fn first_not_finite(points: &[Point3<f64>]) -> Option<usize> {
    points.par_chunks(BLOCK).enumerate().find_map_first(|(block, points)| {
        // The loop has no branch per point, so that vector instructions can test several coordinates at once.
        let coordinates = bytemuck::cast_slice::<_, f64>(points);
        if coordinates.iter().fold(true, |all, x| all & x.is_finite()) {
            return None;
        }
        points
            .iter()
            .position(|point| !point.coords.iter().all(|x| x.is_finite()))
            .map(|index| block * BLOCK + index)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_with_nan_are_refused() {
        let positions = vec![Point3::origin(), Point3::new(0.0, f64::NAN, 0.0)];
        assert_eq!(Points::new(positions), Err(PointsError::NotFinite { point: 1 }));
    }

    #[test]
    fn attributes_have_an_entry_per_point_and_normals_do_not_survive_a_move() {
        let points = Points::new(vec![Point3::origin(); 2]).unwrap();
        fn normals(count: usize) -> Attribute {
            Attribute::Vector(vec![[0.0, 0.0, 1.0]; count].into())
        }
        assert!(points.clone().with_attribute("normal", normals(3)).is_err());
        let colors = Attribute::Color(vec![[1, 2, 3]; 2].into());
        let points = points.with_attribute("normal", normals(2)).unwrap();
        let points = points.with_attribute("color", colors).unwrap();
        let moved = points.with_positions(vec![Point3::new(1.0, 2.0, 3.0); 2]).unwrap();
        assert_eq!(moved.attributes().iter().map(|(name, _)| name).collect::<Vec<_>>(), ["color"]);
        assert!(points.with_positions(vec![Point3::origin()]).is_err());
    }
}
