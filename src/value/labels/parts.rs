//! The parts, layers and edge cases of labels.

use super::Labels;
use crate::edge_cases::SIZES;
use crate::layer::BACKGROUND;
use crate::{ElementKind, Image, Layer, Meaning, Parts, PartsError, Picture, Rgb};

pub(super) fn parts(labels: &Labels) -> Parts<'_> {
    let mut parts = Parts::default();
    parts.grid(labels.width, labels.height);
    parts.fact("components", labels.statistics.len());
    parts.push("label", ElementKind::Pixel, Meaning::Index, 1, labels.pixels());
    parts
}

pub(super) fn made_of(parts: &Parts<'_>) -> Result<Labels, PartsError> {
    let [width, height] = parts.size()?;
    let label = parts.require("label", 1)?.to_u32()?;
    Labels::new(width, height, label).map_err(PartsError::from_error)
}

/// Draws each component in a color that differs clearly from the colors of the components with the next labels.
pub(super) fn show(labels: &Labels) -> Vec<Layer> {
    let pixels = labels.pixels().iter().map(|&label| match label {
        0 => BACKGROUND,
        label => hue(label),
    });
    Picture::from_false_colors(Image::new(labels.width, labels.height, Vec::from_iter(pixels)))
}

/// A color for a label that differs clearly from the colors of the next labels. The hue advances by the golden angle around the color
/// wheel, and the brightness cycles through three levels.
fn hue(label: u32) -> Rgb {
    const STEP: f64 = 0.618_033_988_749_894_9;
    const BRIGHT: [f64; 3] = [1.0, 0.72, 0.86];
    let around = (f64::from(label) * STEP).fract() * 6.0;
    let bright = BRIGHT[label as usize % 3];
    [0.0, 4.0, 2.0].map(|shift| {
        let ramp = ((around + shift) % 6.0 - 3.0).abs() - 1.0;
        (255.0 * bright * (0.3 + 0.7 * ramp.clamp(0.0, 1.0))).round() as u8
    })
}

pub(super) fn edge_cases() -> Vec<Labels> {
    fn labels([width, height]: [usize; 2], label: u32) -> Result<Labels, crate::SizeError> {
        Labels::new(width, height, vec![label; width * height])
    }
    SIZES.into_iter().flat_map(|size| [labels(size, 0), labels(size, u32::MAX)]).flatten().collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn labels_have_distinct_colors() {
        let labels = Labels::new(20, 10, (0..200).collect()).unwrap();
        let [Layer::Picture(picture)] = &show(&labels)[..] else { panic!("one picture") };
        assert_eq!(picture.image.pixel([0, 0]), BACKGROUND);
        assert_eq!(picture.image.pixels().iter().collect::<HashSet<_>>().len(), 200);
    }
}
