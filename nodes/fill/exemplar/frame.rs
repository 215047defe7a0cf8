//! Local coordinate frames on a surface, whose `y` axes point upward.

use nalgebra::{Point3, Vector3};

/// Three unit vectors at a point of a surface: `z` is the normal, `x` is horizontal, `y` is the direction of steepest ascent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) origin: Point3<f64>,
    pub(super) x: Vector3<f64>,
    pub(super) y: Vector3<f64>,
    pub(super) z: Vector3<f64>,
    /// True if the normal is nearly parallel to the up vector: then the directions of `x` and `y` are arbitrary.
    pub(super) is_free: bool,
}

/// Minimum sine of the angle between the normal and the up vector; below it, the frame's rotation about the normal is arbitrary. With a
/// smaller value, the noise of a normal (about 1e-4 in a scan) rotates frames by more than the sample distance of a patch. With a larger
/// value, frames with a definite direction lose it.
const MIN_SINE: f64 = 1e-3;

impl Frame {
    /// Returns the frame at a point with a normal of any length. Kawai, Sato and Yokoya (2008), equations 4 and 5; if the normal is
    /// parallel to `up`, the projection of the x axis, or of the z axis, replaces the horizontal direction.
    pub(super) fn new(at: Point3<f64>, normal: Vector3<f64>, up: Vector3<f64>) -> Self {
        let z = normal.try_normalize(0.0).unwrap_or(Vector3::z());
        let up = up.try_normalize(0.0).unwrap_or(Vector3::y());
        let level = up.cross(&z);
        let free = level.norm() < MIN_SINE;
        fn project(axis: Vector3<f64>, z: Vector3<f64>) -> Vector3<f64> {
            axis - z * axis.dot(&z)
        }
        let x = match free {
            false => level,
            true if project(Vector3::x(), z).norm() < 0.1 => project(Vector3::z(), z),
            true => project(Vector3::x(), z),
        };
        let x = x.normalize();
        Self { origin: at, x, y: z.cross(&x), z, is_free: free }
    }

    /// Returns the coordinates of a direction in this frame.
    #[inline(always)]
    pub(super) fn local(&self, direction: Vector3<f64>) -> [f64; 3] {
        [direction.dot(&self.x), direction.dot(&self.y), direction.dot(&self.z)]
    }

    /// Returns the direction that has the given coordinates in this frame.
    pub(super) fn global(&self, [x, y, z]: [f64; 3]) -> Vector3<f64> {
        self.x * x + self.y * y + self.z * z
    }
}

/// The orientation of an exemplar relative to the frame of a patch: a rotation about the normal, optionally after a reflection of `x`.
///
/// Stores the rows of the 2 x 2 matrix that maps the patch's horizontal coordinates to the exemplar's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Orientation([[f64; 2]; 2]);

/// Maximum number of rotations in which an exemplar is tried.
const MAX_ROTATIONS: u32 = 32;

impl Orientation {
    /// Returns `rotations` evenly spaced rotations, the first of which is the identity, and with `mirror` also their mirror images.
    pub(super) fn list(rotations: u32, mirror: bool) -> Vec<Self> {
        let count = rotations.clamp(1, MAX_ROTATIONS);
        let flips: &[f64] = if mirror { &[1.0, -1.0] } else { &[1.0] };
        let orientations = flips.iter().flat_map(|&flip| {
            (0..count).map(move |k| {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count);
                let (sine, cosine) = libm::sincos(angle);
                Self([[cosine * flip, -sine], [sine * flip, cosine]])
            })
        });
        orientations.collect()
    }

    #[inline(always)]
    pub(super) fn apply(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [[a, b], [c, d]] = self.0;
        [a * u + b * v, c * u + d * v]
    }

    /// Returns the inverse rotation or reflection, which maps the horizontal coordinates of the exemplar to those of the patch.
    pub(super) fn inverse(&self) -> Self {
        let [[a, b], [c, d]] = self.0;
        Self([[a, c], [b, d]])
    }
}
