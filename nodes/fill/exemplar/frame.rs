//! Local frames that agree on what is up.

use nalgebra::{Point3, Vector3};

/// Three unit vectors at a place of a surface: `z` is its normal, `x` level, `y` as far up as the surface goes there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) at: Point3<f64>,
    pub(super) x: Vector3<f64>,
    pub(super) y: Vector3<f64>,
    pub(super) z: Vector3<f64>,
    /// Whether the normal is nearly parallel to the up vector, so that the directions of `x` and `y` are arbitrary.
    pub(super) free: bool,
}

/// Sine of the angle between the normal and the up vector below which a frame is free. With less, the noise of a normal (some 1e-4
/// in a scan) turns frames by more than the samples of a patch are apart; with more, frames that agree lose their direction.
const LEAST_SINE: f64 = 1e-3;

impl Frame {
    /// The frame at a place with this normal, of any length. Kawai, Sato and Yokoya (2008), equations 4 and 5; where the normal is
    /// along `up`, the projection of the x axis, or of the z axis, takes the place of the level direction.
    pub(super) fn new(at: Point3<f64>, normal: Vector3<f64>, up: Vector3<f64>) -> Self {
        let z = normal.try_normalize(0.0).unwrap_or(Vector3::z());
        let up = up.try_normalize(0.0).unwrap_or(Vector3::y());
        let level = up.cross(&z);
        let free = level.norm() < LEAST_SINE;
        fn along(axis: Vector3<f64>, z: Vector3<f64>) -> Vector3<f64> {
            axis - z * axis.dot(&z)
        }
        let x = match free {
            false => level,
            true if along(Vector3::x(), z).norm() < 0.1 => along(Vector3::z(), z),
            true => along(Vector3::x(), z),
        };
        let x = x.normalize();
        Self { at, x, y: z.cross(&x), z, free }
    }

    /// A direction in the coordinates of this frame.
    #[inline(always)]
    pub(super) fn local(&self, direction: Vector3<f64>) -> [f64; 3] {
        [direction.dot(&self.x), direction.dot(&self.y), direction.dot(&self.z)]
    }

    /// The direction with these coordinates.
    pub(super) fn global(&self, [x, y, z]: [f64; 3]) -> Vector3<f64> {
        self.x * x + self.y * y + self.z * z
    }
}

/// How an exemplar is turned against the frame of a patch: a rotation about the normal, perhaps after a reflection of `x`.
///
/// The rows of a 2 x 2 matrix that takes the patch's level coordinates to the exemplar's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Turn([[f64; 2]; 2]);

/// Rotations, at most.
const MOST: u32 = 32;

impl Turn {
    /// `rotations` equal turns, the first of which is none, and their mirror images.
    pub(super) fn all(rotations: u32, mirror: bool) -> Vec<Self> {
        let count = rotations.clamp(1, MOST);
        let turn = |flip: f64| {
            move |k: u32| {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count);
                let (sine, cosine) = libm::sincos(angle);
                Self([[cosine * flip, -sine], [sine * flip, cosine]])
            }
        };
        let mut turns: Vec<Self> = (0..count).map(turn(1.0)).collect();
        if mirror {
            turns.extend((0..count).map(turn(-1.0)));
        }
        turns
    }

    #[inline(always)]
    pub(super) fn apply(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [[a, b], [c, d]] = self.0;
        [a * u + b * v, c * u + d * v]
    }

    /// The inverse, which maps the level coordinates of the exemplar to those of the patch.
    pub(super) fn inverse(&self) -> Self {
        let [[a, b], [c, d]] = self.0;
        Self([[a, c], [b, d]])
    }
}
