//! Lamps and colors. All light is linear here; a picture's sRGB is made at the end.

use std::sync::LazyLock;

use super::each;
use crate::value::{Rgb, linear_from_srgb, srgb_from_linear};

/// Untextured surfaces: a warm light gray, sRGB (206, 199, 190).
pub(super) const CLAY: [f32; 3] = [0.617, 0.571, 0.515];

/// The inner side of faces: a dull red, sRGB (172, 66, 58).
pub(super) const INNER: [f32; 3] = [0.413, 0.054, 0.042];

/// Light from one direction: a unit vector in view space, and the lamp's color.
struct Lamp {
    from: [f32; 3],
    color: [f32; 3],
    /// How far the light reaches around the edge of what it lights, 0 to 1: large lamps are soft.
    soft: f32,
}

/// Key light from the left above, fill light from the right, rim light from behind.
const LAMPS: [Lamp; 3] = [
    Lamp { from: [-0.4505, 0.6007, 0.6604], color: [0.82, 0.79, 0.745], soft: 0.05 },
    Lamp { from: [0.7547, 0.0503, 0.6541], color: [0.155, 0.165, 0.18], soft: 0.4 },
    Lamp { from: [0.2492, 0.4485, -0.8583], color: [0.27, 0.275, 0.29], soft: 0.0 },
];

/// Half way between the key light and a viewer straight in front: where the surface shines.
const SHINE_TOWARDS: [f32; 3] = [-0.2472, 0.3296, 0.9112];

/// How much of the key light shines.
const SHINE: f32 = 0.05;

/// What comes from the whole sky above and from the floor below.
const SKY: [f32; 3] = [0.24, 0.252, 0.28];
const FLOOR: [f32; 3] = [0.095, 0.087, 0.08];

/// The light that a surface of this color sends to the viewer; `normal` is a unit vector in view space.
pub(super) fn lit(color: [f32; 3], normal: [f32; 3]) -> [f32; 3] {
    let towards = |from: [f32; 3]| normal[0] * from[0] + normal[1] * from[1] + normal[2] * from[2];
    let up = 0.5 + 0.5 * normal[1];
    let mut light = each(|k| FLOOR[k] + (SKY[k] - FLOOR[k]) * up);
    for lamp in &LAMPS {
        let strength = ((towards(lamp.from) + lamp.soft) / (1.0 + lamp.soft)).max(0.0);
        (0..3).for_each(|k| light[k] += strength * lamp.color[k]);
    }
    // Blinn's highlight with the exponent 32, by squaring five times.
    let shine = (0..5).fold(towards(SHINE_TOWARDS).max(0.0), |shine, _| shine * shine);
    each(|k| color[k] * light[k] + SHINE * shine)
}

/// The background, linear, at a height from 0 (top) to 1: a dark gray-blue that gets darker downwards.
pub(super) fn background(height: f64) -> [f32; 3] {
    let (top, bottom) = ([0.060, 0.070, 0.086], [0.021, 0.025, 0.031]);
    each(|k| top[k] + (bottom[k] - top[k]) * height as f32)
}

/// The linear light of an sRGB color whose channels, 0 to 255, need not be whole.
pub(super) fn linear(color: [f64; 3]) -> [f32; 3] {
    each(|k| {
        let channel = color[k].clamp(0.0, 255.0);
        let below = channel as u8;
        let (low, high) = (linear_from_srgb(below), linear_from_srgb(below.saturating_add(1)));
        low + (high - low) * (channel - f64::from(below)) as f32
    })
}

/// The pixel of a linear light. By a table: its steps are less than half of a pixel's even in the dark.
pub(super) fn srgb(light: [f32; 3]) -> Rgb {
    const STEPS: usize = 16_384;
    static TABLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        (0..=STEPS).map(|step| srgb_from_linear(step as f64 / STEPS as f64)).collect()
    });
    // Halves are added in double precision, where none is lost: this rounds as `round` does, without its call.
    let table = &TABLE;
    each(|k| table[(f64::from(light[k].clamp(0.0, 1.0) * STEPS as f32) + 0.5) as usize])
}
