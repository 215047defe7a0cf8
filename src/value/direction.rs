//! A direction in space.

use nalgebra::{Point3, Unit, Vector3};
use thiserror::Error;

use super::{
    Arrows, Axes, DecodeError, Decoder, ElementKind, Encoder, Layer, Meaning, Part, Parts,
    PartsError, Summary, Value,
};

/// Error of building a direction.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DirectionError {
    /// The vectors cancel out.
    #[error("the directions cancel out: their mean is {length:e} long")]
    Vanishes {
        /// The length of the mean of the vectors, which is less than 1e-6.
        length: f64,
    },
    /// Any other violation of the invariant of [`Direction`]; contains the message.
    #[error("{0}")]
    Invalid(String),
}

/// A unit vector that is the mean of other unit vectors, and the *resultant*: the length of that mean before normalization, which measures
/// how well the vectors agree.
///
/// Invariant, checked by [`Direction::mean`] and [`Direction::new`]: the vector is finite and of length 1; the resultant is from 1e-6 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    vector: Unit<Vector3<f64>>,
    resultant: f64,
}

/// The minimum length of a mean of unit vectors. The direction of a shorter mean is noise: the limit is about 1000 times the rounding error
/// of a million summands.
const MIN_RESULTANT: f64 = 1e-6;

impl Direction {
    /// Builds the direction of `mean`, which is the mean of unit vectors. The length of `mean` becomes the resultant.
    ///
    /// # Errors
    /// If the mean is shorter than 1e-6 or not finite.
    pub fn mean(mean: Vector3<f64>) -> Result<Self, DirectionError> {
        let length = mean.norm();
        if !length.is_finite() {
            return Err(not_finite());
        }
        if length < MIN_RESULTANT {
            return Err(DirectionError::Vanishes { length });
        }
        Ok(Self { vector: Unit::new_unchecked(mean / length), resultant: length.min(1.0) })
    }

    /// Builds a direction from a unit vector and a resultant.
    ///
    /// # Errors
    /// If the length of the vector is not 1 up to rounding (1e-9), or the resultant is not from 1e-6 to 1.
    pub fn new(vector: Vector3<f64>, resultant: f64) -> Result<Self, DirectionError> {
        let length = vector.norm();
        if !length.is_finite() {
            return Err(not_finite());
        }
        if (length - 1.0).abs() > 1e-9 {
            return Err(DirectionError::Invalid(format!("a direction is {length} long, not 1")));
        }
        if !(MIN_RESULTANT..=1.0).contains(&resultant) {
            let why = format!("the resultant {resultant} is not from 1e-6 to 1");
            return Err(DirectionError::Invalid(why));
        }
        Ok(Self { vector: Unit::new_unchecked(vector), resultant })
    }

    /// The unit vector.
    pub fn vector(&self) -> Unit<Vector3<f64>> {
        self.vector
    }

    /// The resultant: the length of the mean of the unit vectors. It is 1 if all of them are equal, and near 0 if they point in all
    /// directions.
    pub fn resultant(&self) -> f64 {
        self.resultant
    }
}

fn not_finite() -> DirectionError {
    DirectionError::Invalid("a direction must be finite".to_owned())
}

impl Value for Direction {
    const NAME: &'static str = "Direction";

    fn encode(&self, to: &mut Encoder) {
        let vector: [f64; 3] = self.vector.into_inner().into();
        to.plain(&vector).plain(&self.resultant);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let vector: [f64; 3] = from.plain()?;
        Ok(Self { vector: Unit::new_unchecked(vector.into()), resultant: from.plain()? })
    }

    fn size(&self) -> usize {
        size_of::<Self>()
    }

    fn describe(&self) -> Summary {
        let vector: [f64; 3] = self.vector.into_inner().into();
        Summary::default()
            .with_fact("direction", vector.to_vec())
            .with_fact("resultant", self.resultant)
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.push("direction", ElementKind::Whole, Meaning::Direction, 3, self.vector.as_slice());
        parts.push("resultant", ElementKind::Whole, Meaning::Number, 1, vec![self.resultant]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let vector = parts.require("direction", 3)?.single::<3>()?;
        let resultant = parts.column_of("resultant", 1)?.map(Part::single::<1>).transpose()?;
        let [resultant] = resultant.unwrap_or([1.0]);
        Self::new(vector.into(), resultant).map_err(PartsError::from_error)
    }

    /// Draws an arrow whose length is the resultant, in mm.
    fn show(&self) -> Vec<Layer> {
        let to = Point3::from(self.vector.into_inner() * self.resultant);
        let (from, to) = (vec![Point3::origin()].into(), vec![to].into());
        vec![Layer::Arrows(Arrows { from, to, axes: Axes::Sensor })]
    }

    fn edge_cases() -> Vec<Self> {
        Self::mean(Vector3::new(0.0, 1e-5, 0.0)).into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_that_cancel_out_have_no_direction() {
        assert!(matches!(
            Direction::mean(Vector3::new(1e-9, 0.0, 0.0)),
            Err(DirectionError::Vanishes { .. })
        ));
        assert_eq!(Direction::mean(Vector3::new(f64::NAN, 0.0, 0.0)), Err(not_finite()));
    }
}
