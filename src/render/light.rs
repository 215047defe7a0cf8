//! Lamps and colors. All light is linear; only the final color is converted to sRGB.

use std::sync::LazyLock;

use maquette_value::{Rgb, linear_from_srgb, srgb_from_linear};

use super::{array3, array4, pad};

/// The color of untextured surfaces: a warm light gray, sRGB (206, 199, 190).
pub(super) const CLAY: Light = [0.617, 0.571, 0.515, 0.0];

/// The color of the inner side of faces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BackFaces {
    /// Red, so that faces with a wrong orientation are noticed.
    #[default]
    Marked,
    /// A dark gray.
    Neutral,
}

/// Returns the color of the inner side of faces: a dull red, sRGB (172, 66, 58), or a dark gray, sRGB (120, 117, 113).
pub(super) fn back_face(color: BackFaces) -> Light {
    match color {
        BackFaces::Marked => [0.413, 0.054, 0.042, 0.0],
        BackFaces::Neutral => [0.188, 0.178, 0.165, 0.0],
    }
}

/// Linear light: red, green, blue, and a fourth number that is 0.
pub(super) type Light = [f32; 4];

/// The colors of the lamps. The key light is at the upper left, the fill light at the right, and the rim light behind the object.
const LAMPS: [Light; 3] =
    [[0.82, 0.79, 0.745, 0.0], [0.155, 0.165, 0.18, 0.0], [0.27, 0.275, 0.29, 0.0]];

/// The directions towards the lamps in view space: first the x of all directions, then all y, then all z. The fourth direction is for the
/// highlight: halfway between the key light and a viewer straight in front.
const TOWARDS: [[f32; 4]; 3] = [
    [-0.4505, 0.7547, 0.2492, -0.2472],
    [0.6007, 0.0503, 0.4485, 0.3296],
    [0.6604, 0.6541, -0.8583, 0.9112],
];

/// For each lamp, and last for the highlight: how far the light reaches beyond the shadow line, as the sine of an angle (0 to 1). A large
/// lamp gives a soft shadow.
const SOFTNESS: [f32; 4] = [0.05, 0.4, 0.0, 0.0];

/// The strength of the highlight that the key light causes.
const SHINE: f32 = 0.05;

/// The ambient light, which comes from the sky (above) and from the floor (below).
const SKY: Light = [0.24, 0.252, 0.28, 0.0];
const FLOOR: Light = [0.095, 0.087, 0.08, 0.0];

/// Returns the light that a surface of this color reflects to the viewer. `normal` is a unit vector in view space.
#[inline(always)]
pub(super) fn lit(color: Light, normal: [f32; 4]) -> Light {
    let towards = array4(|lamp| {
        let [x, y, z] = array3(|k| normal[k] * TOWARDS[k][lamp]);
        x + y + z
    });
    let [key, fill, rim, shine] =
        array4(|lamp| ((towards[lamp] + SOFTNESS[lamp]) / (1.0 + SOFTNESS[lamp])).max(0.0));
    let up = 0.5 + 0.5 * normal[1];
    // Blinn's highlight with the exponent 32 is computed by squaring five times.
    let shine = (0..5).fold(shine, |shine, _| shine * shine);
    array4(|k| {
        let sky = FLOOR[k] + (SKY[k] - FLOOR[k]) * up;
        let light = sky + key * LAMPS[0][k] + fill * LAMPS[1][k] + rim * LAMPS[2][k];
        color[k] * light + SHINE * shine
    })
}

/// Returns the background color in linear light, at a height from 0 (top) to 1 (bottom). It is a dark gray-blue that becomes darker
/// downwards.
pub(super) fn background(height: f64) -> Light {
    let (top, bottom) = ([0.060, 0.070, 0.086, 0.0], [0.021, 0.025, 0.031, 0.0]);
    array4(|k| top[k] + (bottom[k] - top[k]) * height as f32)
}

/// Converts an sRGB color to linear light. The channels are from 0 to 255 and may have fractions.
pub(super) fn linear(color: [f64; 3]) -> Light {
    let channels = array3(|k| {
        let channel = color[k].clamp(0.0, 255.0);
        let below = channel as u8;
        let (low, high) = (linear_from_srgb(below), linear_from_srgb(below.saturating_add(1)));
        low + (high - low) * (channel - f64::from(below)) as f32
    });
    pad(channels)
}

/// Converts linear light to an sRGB pixel by a table. The steps of the table are less than half as large as those of a pixel, even in dark
/// colors.
#[inline(always)]
pub(super) fn srgb(light: Light) -> Rgb {
    const STEPS: usize = 16_384;
    static TABLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        (0..=STEPS).map(|step| srgb_from_linear(step as f64 / STEPS as f64)).collect()
    });
    // Add 0.5 in double precision, in which it is never rounded away. This gives the same result as `round` at less cost.
    let table = &TABLE;
    array3(|k| table[(f64::from(light[k].clamp(0.0, 1.0) * STEPS as f32) + 0.5) as usize])
}
