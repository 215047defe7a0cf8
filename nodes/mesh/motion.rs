//! Affine motions: translation, rotation and scaling.

use maquette_node::{Error, bail};
use maquette_value::parallel::*;
use nalgebra::{Matrix3, Point3, Vector3};

/// A linear map and a translation: `moved = linear * point + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The linear map: scaling, followed by rotation.
    pub linear: Matrix3<f64>,
    /// The translation that follows the linear map, in mm.
    pub shift: Vector3<f64>,
}

impl Motion {
    /// Creates a motion that scales, then rotates about x, y and z by angles in degrees, then translates. Multiples of 90 degrees are
    /// exact.
    ///
    /// # Errors
    /// Returns an error if a scale is 0 or not finite.
    pub fn new(translate: [f64; 3], rotate: [f64; 3], scale: [f64; 3]) -> Result<Self, Error> {
        let flat =
            ['x', 'y', 'z'].into_iter().zip(scale).find(|(_, s)| *s == 0.0 || !s.is_finite());
        if let Some((axis, scale)) = flat {
            bail!("the scale along {axis} is {scale}, but it must be a number other than 0");
        }
        let [[cx, sx], [cy, sy], [cz, sz]] = rotate.map(cosine_and_sine);
        let x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, -sx, 0.0, sx, cx);
        let y = Matrix3::new(cy, 0.0, sy, 0.0, 1.0, 0.0, -sy, 0.0, cy);
        let z = Matrix3::new(cz, -sz, 0.0, sz, cz, 0.0, 0.0, 0.0, 1.0);
        let linear = z * y * x * Matrix3::from_diagonal(&scale.into());
        Ok(Self { linear, shift: translate.into() })
    }

    /// Returns the moved point.
    pub fn apply(&self, point: Point3<f64>) -> Point3<f64> {
        Point3::from(self.linear * point.coords + self.shift)
    }

    pub(super) fn apply_all(&self, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        points.par_iter().with_min_len(4096).map(|&point| self.apply(point)).collect()
    }

    /// Returns a function that maps unit normals: it applies the inverse transpose of the linear map, since normals must stay perpendicular
    /// to the surface. Returns `None` if a scale is too small to be inverted.
    pub(super) fn normals(&self) -> Option<impl Fn(&[f64; 3]) -> [f64; 3]> {
        let inverse = self.linear.try_inverse()?;
        Some(move |normal: &[f64; 3]| {
            let turned = inverse.tr_mul(&Vector3::from(*normal));
            turned.try_normalize(0.0).unwrap_or_default().into()
        })
    }

    /// Returns true if the motion is a reflection.
    pub(super) fn is_mirror(&self) -> bool {
        self.linear.determinant() < 0.0
    }

    pub(super) fn is_identity(&self) -> bool {
        self.linear == Matrix3::identity() && self.shift == Vector3::zeros()
    }
}

fn cosine_and_sine(degrees: f64) -> [f64; 2] {
    let turned = degrees.rem_euclid(360.0);
    match [0.0, 90.0, 180.0, 270.0].iter().position(|&quarter| quarter == turned) {
        Some(quarters) => [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]][quarters],
        None => {
            let (sine, cosine) = libm::sincos(turned.to_radians());
            [cosine, sine]
        }
    }
}
