//! A direction in space.

use nalgebra::{Point3, Unit, Vector3};
use thiserror::Error;

use super::{
    Arrows, Axes, DecodeError, Decoder, Encoder, Layer, Meaning, On, Part, Parts, PartsError,
    Summary, Value,
};

/// Why there is no direction.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DirectionError {
    /// The vectors cancel out.
    #[error("the directions cancel out: their mean is {length:e} long")]
    Vanishes {
        /// Length of the mean.
        length: f64,
    },
    /// A component is NaN or infinite.
    #[error("a direction must be finite")]
    NotFinite,
    /// A vector that should be of the length 1.
    #[error("a direction is {length} long, not 1")]
    NotUnit {
        /// Its length.
        length: f64,
    },
    /// A resultant that no mean of unit vectors has.
    #[error("the resultant {resultant} is not from 1e-6 to 1")]
    Resultant {
        /// What was given.
        resultant: f64,
    },
}

/// A unit vector, and how well the vectors that it is the mean of agree.
///
/// Invariant, checked by [`Direction::mean`] and [`Direction::new`]: finite; length 1; resultant from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    vector: Unit<Vector3<f64>>,
    resultant: f64,
}

/// Below this length of a mean of unit vectors its direction is noise: about the rounding of a million summands, times 1000.
const LEAST_RESULTANT: f64 = 1e-6;

impl Direction {
    /// The direction of `mean`, the mean of unit vectors; its length becomes the resultant.
    ///
    /// # Errors
    /// If the mean is shorter than 1e-6 or not finite.
    pub fn mean(mean: Vector3<f64>) -> Result<Self, DirectionError> {
        let length = mean.norm();
        if !length.is_finite() {
            return Err(DirectionError::NotFinite);
        }
        if length < LEAST_RESULTANT {
            return Err(DirectionError::Vanishes { length });
        }
        Ok(Self { vector: Unit::new_unchecked(mean / length), resultant: length.min(1.0) })
    }

    /// The direction of a unit vector.
    ///
    /// # Errors
    /// If its length is not 1 up to rounding (1e-9), or the resultant not from 1e-6 to 1.
    pub fn new(vector: Vector3<f64>, resultant: f64) -> Result<Self, DirectionError> {
        let length = vector.norm();
        if !length.is_finite() {
            return Err(DirectionError::NotFinite);
        }
        if (length - 1.0).abs() > 1e-9 {
            return Err(DirectionError::NotUnit { length });
        }
        if !(LEAST_RESULTANT..=1.0).contains(&resultant) {
            return Err(DirectionError::Resultant { resultant });
        }
        Ok(Self { vector: Unit::new_unchecked(vector), resultant })
    }

    /// The unit vector.
    pub fn vector(&self) -> Unit<Vector3<f64>> {
        self.vector
    }

    /// Length of the mean of the unit vectors behind it: 1 if all agree, near 0 if they point everywhere.
    pub fn resultant(&self) -> f64 {
        self.resultant
    }
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
        Summary::default().with("direction", vector.to_vec()).with("resultant", self.resultant)
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.push("direction", On::Whole, Meaning::Direction, 3, self.vector.as_slice());
        parts.push("resultant", On::Whole, Meaning::Number, 1, vec![self.resultant]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let vector = parts.need("direction", 3)?.only::<3>()?;
        let resultant = parts.column_of("resultant", 1)?.map(Part::only::<1>).transpose()?;
        let [resultant] = resultant.unwrap_or([1.0]);
        Self::new(vector.into(), resultant).map_err(PartsError::refused)
    }

    /// An arrow as long as the resultant, in mm.
    fn show(&self) -> Vec<Layer> {
        let to = Point3::from(self.vector.into_inner() * self.resultant);
        let (from, to) = (vec![Point3::origin()].into(), vec![to].into());
        vec![Layer::Arrows(Arrows { from, to, axes: Axes::Sensor })]
    }

    fn hostile() -> Vec<Self> {
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
        assert_eq!(
            Direction::mean(Vector3::new(f64::NAN, 0.0, 0.0)),
            Err(DirectionError::NotFinite)
        );
    }
}
