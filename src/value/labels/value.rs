//! The implementation of `Value` for labels.

use super::{Labels, Pixels, elements, runs_of, statistics};
use crate::edge_cases::uniform_pictures;
use crate::{
    BACKGROUND, Column, DecodeError, Decoder, ElementKind, Elements, Encoder, Image, Layer,
    Meaning, Mesh, Parts, PartsError, Picture, Property, Rgb, Summary, Value, Violation,
    value_type,
};

impl Value for Labels {
    const NAME: &'static str = "Labels";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.width, self.height]);
        match &self.pixels {
            Pixels::All(pixels) => to.column(pixels),
            Pixels::Component(component) => {
                to.column_of_hash(component.hash(), || component.pixels().clone())
            }
        };
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [width, height] = from.counts()?;
        let pixels: Column<u32> = from.column()?;
        let statistics = statistics(width, height, &runs_of(width, &pixels));
        Ok(Self { width, height, pixels: Pixels::All(pixels), statistics })
    }

    fn properties() -> &'static [Property<Self>] {
        const {
            &[Property::new("NonEmpty", "There is a labelled component.", |value: &Self| {
                value.statistics().is_empty().then(|| Violation::lack_of("label"))
            })]
        }
    }

    fn size(&self) -> usize {
        let pixels = match &self.pixels {
            Pixels::All(pixels) => pixels.size(),
            Pixels::Component(component) => component.size(),
        };
        pixels + size_of_val(&self.statistics[..])
    }

    fn describe(&self) -> Summary {
        let summary = Summary::default()
            .with_fact("size", format!("{} x {}", self.width, self.height))
            .with_fact("components", self.statistics.len());
        self.by_area().into_iter().take(8).fold(summary, |summary, label| {
            let component = &self.statistics[label as usize - 1];
            let ([left, top], [right, bottom]) = (component.low, component.high);
            let [x, y] = component.centroid;
            let fact = format!(
                "{} pixels in ({left}, {top})-({right}, {bottom}), center ({x:.1}, {y:.1})",
                component.area
            );
            summary.with_fact(&format!("label {label}"), fact)
        })
    }

    fn probe(&self, at: [usize; 2]) -> Summary {
        Summary::default().with_fact("label", self.label(at))
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.fact("components", self.statistics.len());
        parts.push("label", ElementKind::Pixel, Meaning::Index, 1, self.pixels());
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size()?;
        let label = parts.require("label", 1)?.to_u32()?;
        Self::new(width, height, label).map_err(PartsError::from_error)
    }

    /// Splits labels into components: for each component, labels of the whole picture in which that component has the label 1 and all else
    /// is background.
    fn elements() -> Vec<Elements<Self>> {
        let kind = value_type::<Self>();
        vec![Elements { word: "", name: "components", kind, cut: elements::cut }]
    }

    /// Draws each component in a color that differs clearly from the colors of the components with the next labels.
    fn show(&self) -> Vec<Layer> {
        let pixels = self.pixels().iter().map(|&label| match label {
            0 => BACKGROUND,
            label => hue(label),
        });
        Picture::from_false_colors(Image::new(self.width, self.height, Vec::from_iter(pixels)))
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn edge_cases() -> Vec<Self> {
        uniform_pictures(&[0, u32::MAX], Self::new)
    }
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

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn labels_have_distinct_colors() {
        let labels = Labels::new(20, 10, (0..200).collect()).unwrap();
        let [Layer::Picture(picture)] = &labels.show()[..] else { panic!("one picture") };
        assert_eq!(picture.image.pixel([0, 0]), BACKGROUND);
        assert_eq!(picture.image.pixels().iter().collect::<HashSet<_>>().len(), 200);
    }
}
