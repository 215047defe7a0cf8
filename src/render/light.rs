//! Lamps and colors. All light is linear here; a picture's sRGB is made at the end.

use std::sync::LazyLock;

use maquette_value::{Rgb, linear_from_srgb, srgb_from_linear};

use super::{each, four, padded};

/// Untextured surfaces: a warm light gray, sRGB (206, 199, 190).
pub(super) const CLAY: Light = [0.617, 0.571, 0.515, 0.0];

/// The inner side of faces: a dull red, sRGB (172, 66, 58).
pub(super) const INNER: Light = [0.413, 0.054, 0.042, 0.0];

/// Red, green and blue, linear, and a zero.
pub(super) type Light = [f32; 4];

/// The colors of the lamps: key light from the left above, fill light from the right, rim light from behind.
const LAMPS: [Light; 3] =
    [[0.82, 0.79, 0.745, 0.0], [0.155, 0.165, 0.18, 0.0], [0.27, 0.275, 0.29, 0.0]];

/// Where the lamps are, in view space: the x of all, then y, then z; last the direction half way between the key light and a
/// viewer straight in front, in which the surface shines.
const TOWARDS: [[f32; 4]; 3] = [
    [-0.4505, 0.7547, 0.2492, -0.2472],
    [0.6007, 0.0503, 0.4485, 0.3296],
    [0.6604, 0.6541, -0.8583, 0.9112],
];

/// How far a lamp's light reaches around the edge of what it lights, 0 to 1: large lamps are soft.
const SOFT: [f32; 4] = [0.05, 0.4, 0.0, 0.0];

/// How much of the key light shines.
const SHINE: f32 = 0.05;

/// What comes from the whole sky above and from the floor below.
const SKY: Light = [0.24, 0.252, 0.28, 0.0];
const FLOOR: Light = [0.095, 0.087, 0.08, 0.0];

/// The light that a surface of this color sends to the viewer; `normal` is a unit vector in view space.
#[inline(always)]
pub(super) fn lit(color: Light, normal: [f32; 4]) -> Light {
    let towards = four(|lamp| {
        let [x, y, z] = each(|k| normal[k] * TOWARDS[k][lamp]);
        x + y + z
    });
    let [key, fill, rim, shine] =
        four(|lamp| ((towards[lamp] + SOFT[lamp]) / (1.0 + SOFT[lamp])).max(0.0));
    let up = 0.5 + 0.5 * normal[1];
    // Blinn's highlight with the exponent 32, by squaring five times.
    let shine = (0..5).fold(shine, |shine, _| shine * shine);
    four(|k| {
        let sky = FLOOR[k] + (SKY[k] - FLOOR[k]) * up;
        let light = sky + key * LAMPS[0][k] + fill * LAMPS[1][k] + rim * LAMPS[2][k];
        color[k] * light + SHINE * shine
    })
}

/// The background, linear, at a height from 0 (top) to 1: a dark gray-blue that gets darker downwards.
pub(super) fn background(height: f64) -> Light {
    let (top, bottom) = ([0.060, 0.070, 0.086, 0.0], [0.021, 0.025, 0.031, 0.0]);
    four(|k| top[k] + (bottom[k] - top[k]) * height as f32)
}

/// The linear light of an sRGB color whose channels, 0 to 255, need not be whole.
pub(super) fn linear(color: [f64; 3]) -> Light {
    let channels = each(|k| {
        let channel = color[k].clamp(0.0, 255.0);
        let below = channel as u8;
        let (low, high) = (linear_from_srgb(below), linear_from_srgb(below.saturating_add(1)));
        low + (high - low) * (channel - f64::from(below)) as f32
    });
    padded(channels)
}

/// The pixel of a linear light. By a table: its steps are less than half of a pixel's even in the dark.
#[inline(always)]
pub(super) fn srgb(light: Light) -> Rgb {
    const STEPS: usize = 16_384;
    static TABLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        (0..=STEPS).map(|step| srgb_from_linear(step as f64 / STEPS as f64)).collect()
    });
    // Halves are added in double precision, where none is lost: this rounds as `round` does, without its call.
    let table = &TABLE;
    each(|k| table[(f64::from(light[k].clamp(0.0, 1.0) * STEPS as f32) + 0.5) as usize])
}
