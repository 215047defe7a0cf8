//! Points in space that nothing connects.

use nalgebra::Point3;
use thiserror::Error;

use super::hostile::clouds;
use super::{
    AnyValue, Attribute, AttributeError, Attributes, Axes, Cloud, Column, DecodeError, Decoder,
    Elements, Encoder, Layer, Meaning, NoElements, Offence, On, Parts, PartsError, Property,
    Summary, Value, value_type,
};
use crate::parallel::*;

/// Why places do not make points.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PointsError {
    /// A position that is NaN or infinite.
    #[error("point {point} is not at a finite place")]
    NotFinite {
        /// The offending point.
        point: usize,
    },
    /// An attribute of the wrong length.
    #[error(transparent)]
    Attribute(#[from] AttributeError),
}

/// Points in space with data on each: right-handed axes, lengths in mm.
///
/// Invariant, checked by [`Points::new`] and [`Points::with_attribute`]: positions finite; each attribute has an entry per
/// point.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    positions: Column<Point3<f64>>,
    attributes: Attributes,
}

impl Points {
    /// Points without attributes.
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

    /// The same points with an attribute.
    ///
    /// # Errors
    /// If there are more or fewer entries than points.
    pub fn with_attribute(mut self, name: &str, attribute: Attribute) -> Result<Self, PointsError> {
        self.attributes.insert(name, attribute, self.positions.len(), "point")?;
        Ok(self)
    }

    /// The same points moved; the attribute `normal` is dropped.
    ///
    /// # Errors
    /// If there are more or fewer positions than points, or one is not finite.
    pub fn with_positions(&self, positions: Vec<Point3<f64>>) -> Result<Self, PointsError> {
        if positions.len() != self.positions.len() {
            let (count, elements) = (positions.len(), self.positions.len());
            let error = AttributeError::Length { name: "position".into(), count, elements };
            return Err(error.into());
        }
        let mut moved = Self { attributes: self.attributes.clone(), ..Self::new(positions)? };
        moved.attributes.remove("normal");
        Ok(moved)
    }

    /// The points at these places, in this order, with what lies on them.
    ///
    /// # Panics
    /// If a place is behind the last point.
    #[must_use]
    pub fn select(&self, places: &[u32]) -> Self {
        let positions = places.iter().map(|&place| self.positions[place as usize]);
        Self { positions: positions.collect(), attributes: self.attributes.select(places) }
    }

    /// Where they are.
    pub fn positions(&self) -> &Column<Point3<f64>> {
        &self.positions
    }

    /// The data on each.
    pub fn attributes(&self) -> &Attributes {
        &self.attributes
    }

    /// Lowest and highest coordinates; none without points.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        super::mesh::bounds(self.positions.iter())
    }
}

impl Value for Points {
    const NAME: &'static str = "Points";

    fn encode(&self, to: &mut Encoder) {
        to.column(&self.positions);
        self.attributes.encode(to);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self { positions: from.column()?, attributes: Attributes::decode(from)? })
    }

    fn properties() -> &'static [Property<Self>] {
        const PROPERTIES: &[Property<Points>] =
            &[Property::new("NonEmpty", "There are points.", |value| {
                value.positions().is_empty().then(|| Offence::nothing("points"))
            })];
        PROPERTIES
    }

    fn size(&self) -> usize {
        self.positions.size() + self.attributes.size()
    }

    fn describe(&self) -> Summary {
        let names: Vec<&str> = self.attributes.iter().map(|(name, _)| name).collect();
        let summary = Summary::default()
            .with("points", self.positions.len())
            .with("attributes", names.join(", "));
        super::mesh::describe_bounds(summary, self.positions.iter())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.fact("points", self.positions.len());
        parts.push("position", On::Point, Meaning::Position, 3, &self.positions[..]);
        parts.columns.extend(self.attributes.parts("", On::Point));
        parts
    }

    /// Whatever lies on points beside `position` is an attribute.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let position = parts.need("position", 3)?;
        let mut points = Self::new(position.places()?).map_err(PartsError::refused)?;
        for part in &parts.columns {
            if part.on == On::Point && !std::ptr::eq(part, position) {
                let attribute = Attribute::of(part)?;
                points =
                    points.with_attribute(&part.name, attribute).map_err(PartsError::refused)?;
            }
        }
        Ok(points)
    }

    /// Each point by itself, with its attributes.
    fn elements() -> Vec<Elements<Self>> {
        let kind = value_type::<Self>();
        vec![Elements { word: "", name: "points", kind, cut: |it, most, _| one_by_one(it, most) }]
    }

    fn show(&self) -> Vec<Layer> {
        vec![Layer::Points(Cloud { points: self.clone(), axes: Axes::Upright })]
    }

    fn hostile() -> Vec<Self> {
        [0, 1, 2, 9].into_iter().flat_map(clouds).flat_map(Self::new).collect()
    }
}

fn one_by_one(points: &Points, most: usize) -> Result<Vec<AnyValue>, NoElements> {
    let count = points.positions.len();
    if most < count {
        return Err(NoElements::TooMany { count });
    }
    fn one(place: u32, points: &Points) -> Points {
        Points {
            positions: vec![points.positions[place as usize]].into(),
            attributes: points.attributes.select(&[place]),
        }
    }
    Ok((0..count as u32).map(|place| AnyValue::new(one(place, points))).collect())
}

/// Points that one task looks at.
const BLOCK: usize = 8192;

/// The first point with a coordinate that is no number or infinite.
pub fn first_not_finite(points: &[Point3<f64>]) -> Option<usize> {
    points.par_chunks(BLOCK).enumerate().find_map_first(|(block, points)| {
        // Without a branch for each point, so that wide vectors look at several coordinates at once.
        let coordinates = bytemuck::cast_slice::<_, f64>(points);
        if coordinates.iter().fold(true, |all, x| all & x.is_finite()) {
            return None;
        }
        points
            .iter()
            .position(|point| !point.coords.iter().all(|x| x.is_finite()))
            .map(|place| block * BLOCK + place)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_at_no_place_is_refused() {
        let places = vec![Point3::origin(), Point3::new(0.0, f64::NAN, 0.0)];
        assert_eq!(Points::new(places), Err(PointsError::NotFinite { point: 1 }));
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
