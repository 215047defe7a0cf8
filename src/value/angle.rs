//! An angle.

use nalgebra::Point3;

use super::{
    Arrows, Axes, DecodeError, Decoder, Encoder, Layer, Meaning, On, Parts, PartsError, Summary,
    Value,
};

/// An angle in radians. Invariant, checked by [`Angle::new`]: finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angle {
    radians: f64,
}

/// An angle that is NaN or infinite.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("an angle must be finite")]
pub struct AngleError;

impl Angle {
    /// The angle of so many radians.
    ///
    /// # Errors
    /// If it is NaN or infinite.
    pub fn new(radians: f64) -> Result<Self, AngleError> {
        if radians.is_finite() { Ok(Self { radians }) } else { Err(AngleError) }
    }
}

impl Value for Angle {
    const NAME: &'static str = "Angle";

    fn encode(&self, to: &mut Encoder) {
        to.plain(&self.radians);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self { radians: from.plain()? })
    }

    fn size(&self) -> usize {
        size_of::<Self>()
    }

    fn describe(&self) -> Summary {
        Summary::default().with("radians", self.radians)
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.push("radians", On::Whole, Meaning::Number, 1, vec![self.radians]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [radians] = parts.need("radians", 1)?.only::<1>()?;
        Self::new(radians).map_err(PartsError::refused)
    }

    /// An arrow from the x axis towards the y axis, 1 mm long.
    fn show(&self) -> Vec<Layer> {
        let (sine, cosine) = libm::sincos(self.radians);
        let to = vec![Point3::new(cosine, sine, 0.0)].into();
        vec![Layer::Arrows(Arrows { from: vec![Point3::origin()].into(), to, axes: Axes::Sensor })]
    }

    fn hostile() -> Vec<Self> {
        [0.0, -1e300].into_iter().map(|radians| Self { radians }).collect()
    }
}
