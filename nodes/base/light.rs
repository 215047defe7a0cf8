//! Linear light, in which colors are mixed, and sRGB, in which they are stored: IEC 61966-2-1 (1999).

use std::sync::LazyLock;

use maquette_value::Rgb;

static LIGHT: LazyLock<[f64; 256]> =
    LazyLock::new(|| std::array::from_fn(|channel| light(channel as f64)));

/// Returns the linear light, 0 to 1, of an sRGB channel from 0 to 255.
pub fn light(channel: f64) -> f64 {
    let x = channel / 255.0;
    if x <= 0.04045 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) }
}

/// Returns the linear light of an 8-bit color.
pub fn light_of(color: Rgb) -> [f64; 3] {
    color.map(|channel| LIGHT[usize::from(channel)])
}

/// Returns the sRGB channel, 0 to 255, of linear light; `light` is clamped to the range from 0 to 1.
pub fn channel(light: f64) -> f64 {
    let x = light.clamp(0.0, 1.0);
    255.0 * if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * libm::pow(x, 1.0 / 2.4) - 0.055 }
}

/// Returns the 8-bit color of linear light.
pub fn color_of(light: [f64; 3]) -> Rgb {
    light.map(|light| channel(light).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_channel_comes_back() {
        for channel in 0..=255 {
            assert_eq!(color_of(light_of([channel, 0, 255])), [channel, 0, 255]);
        }
        assert_eq!(color_of([-1.0, 0.5, 2.0]), [0, 188, 255]);
    }
}
