//! A direction in space.

use nalgebra::{Unit, Vector3};
use thiserror::Error;

use super::{DecodeError, Decoder, Encoder, Summary, Value};

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
}

/// A unit vector, and how well the vectors that it is the mean of agree.
///
/// Invariant, checked by [`Direction::mean`]: finite; length 1; resultant from 0 to 1.
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
