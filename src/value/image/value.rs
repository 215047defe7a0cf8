//! The implementation of `Value` for pictures.

use super::{Color, Image, Lab};
use crate::content::content_of_fields;
use crate::edge_cases::uniform_pictures;
use crate::{
    ElementKind, Layer, Meaning, Mesh, Parts, PartsError, Picture, Pinhole, Property, Summary,
    Value, Violation,
};

/// The name of the column of [`Value::parts`] that holds the camera. Tests ignore this column.
const CAMERA: &str = "camera";

impl Value for Image {
    const NAME: &'static str = "Image";

    content_of_fields! { width height pixels camera }

    fn properties() -> &'static [Property<Self>] {
        const {
            &[Property::new("NonEmpty", "It has pixels.", |value: &Self| {
                value.pixels().is_empty().then(|| Violation::lack_of("pixels"))
            })]
        }
    }

    fn describe(&self) -> Summary {
        let count = self.pixels.len().max(1) as f64;
        let mean = [0, 1, 2].map(|k| {
            (self.pixels.iter().map(|pixel| f64::from(pixel[k])).sum::<f64>() / count).round()
        });
        Summary::default()
            .with_fact("size", format!("{} x {}", self.width, self.height))
            .with_fact("mean color", Color(mean.map(|channel| channel as u8)).to_string())
            .with_histogram(
                "lightness",
                self.pixels.iter().map(|&p| f64::from(Lab::from_srgb(p).l)),
            )
    }

    fn probe(&self, [column, row]: [usize; 2]) -> Summary {
        if self.width <= column || self.height <= row {
            return Summary::default();
        }
        let color = Color(self.pixel([column, row]));
        let lab = color.lab();
        let rounded = [lab.l, lab.a, lab.b].map(|x| (f64::from(x) * 10.0).round() / 10.0);
        Summary::default().with_fact("sRGB", color.to_string()).with_fact("Lab", rounded.to_vec())
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.push("color", ElementKind::Pixel, Meaning::Level, 3, &self.pixels[..]);
        if let Some(camera) = self.camera {
            parts.push_hidden(CAMERA, ElementKind::Whole, Meaning::Number, 4, camera.numbers());
        }
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size()?;
        let image = Self::new(width, height, parts.require("color", 3)?.colors()?);
        Ok(image.map_err(PartsError::from_error)?.with_camera(Pinhole::from_parts(parts, CAMERA)?))
    }

    fn show(&self) -> Vec<Layer> {
        Picture::from_true_colors::<PartsError>(Ok(self.clone()))
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn edge_cases() -> Vec<Self> {
        uniform_pictures(&[[9, 8, 7]], Self::new)
    }
}
