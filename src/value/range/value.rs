//! The implementation of `Value` for range images.

use nalgebra::Vector3;

use super::{RangeImage, SeamGaps};
use crate::content::content_of_fields;
use crate::edge_cases::{SIZES, point_sets};
use crate::frame::{counts, pose_of};
use crate::mesh::describe_bounds;
use crate::{
    BACKGROUND, ElementKind, Image, Layer, Meaning, Mesh, Part, Parts, PartsError, Picture,
    Pinhole, Property, Registration, Rgb, Summary, Value, Violation,
};

/// Names of columns of [`Value::parts`] that tests ignore: the triangles that are joined whatever the depth, the size of the registered
/// picture, and the measured seam.
const JOINED: &str = "joined";
const PICTURE: &str = "picture";
const SEAM: &str = "seam";

impl Value for RangeImage {
    const NAME: &'static str = "RangeImage";

    content_of_fields! { width height points filled joined colors camera world_from_camera registration seam }

    fn properties() -> &'static [Property<Self>] {
        const {
            &[Property::new("NonEmpty", "A cell has a point.", |value: &Self| {
                (value.n_valid() == 0).then(|| Violation::lack_of("cell with a point"))
            })]
        }
    }

    fn describe(&self) -> Summary {
        let summary = Summary::default()
            .with_fact("size", format!("{} x {}", self.width, self.height))
            .with_fact("valid", self.n_valid())
            .with_fact("filled", self.filled.iter().filter(|&&filled| filled == 1).count())
            .with_histogram("depth z", self.points.iter().map(|point| point.z));
        let summary = match self.seam {
            Some(SeamGaps { angle, curvature }) => summary
                .with_fact("largest angle at the seam (deg)", angle)
                .with_fact("largest gap of curvature at the seam (1/mm)", curvature),
            None => summary,
        };
        describe_bounds(summary, self.points.iter().filter(|p| !p.x.is_nan()))
    }

    fn probe(&self, [column, row]: [usize; 2]) -> Summary {
        let [x, y] = self.registration.range_from_picture([column as f64, row as f64]);
        let (x, y) = (x.round(), y.round());
        if !(0.0 <= x && x < self.width as f64 && 0.0 <= y && y < self.height as f64) {
            return Summary::default();
        }
        let summary = Summary::default().with_fact("range cell", vec![x, y]);
        match self.point(y as usize * self.width + x as usize) {
            Some(point) => summary.with_fact("point (mm)", point.coords.as_slice().to_vec()),
            None => summary.with_fact("point (mm)", "no range here"),
        }
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.fact("valid cells", self.n_valid());
        parts.push("point", ElementKind::Pixel, Meaning::Position, 3, &self.points[..]);
        if self.filled.is_empty() {
            let none = vec![0u8; self.points.len()];
            parts.push("filled", ElementKind::Pixel, Meaning::Exact, 1, none);
        } else {
            parts.push("filled", ElementKind::Pixel, Meaning::Exact, 1, &self.filled[..]);
        }
        if let Some(colors) = self.colors() {
            parts.push("color", ElementKind::Pixel, Meaning::Level, 3, colors);
        }
        if !self.joined.is_empty() {
            parts.push_hidden(JOINED, ElementKind::Pixel, Meaning::Exact, 1, &self.joined[..]);
        }
        let Registration { scale, offset, picture } = self.registration;
        let registration = [scale, offset].concat();
        parts.push("registration", ElementKind::Whole, Meaning::Number, 4, registration);
        let picture = picture.map(|size| size as f64).to_vec();
        parts.push_hidden(PICTURE, ElementKind::Whole, Meaning::Exact, 2, picture);
        if let Some(camera) = &self.camera {
            parts.push("camera", ElementKind::Whole, Meaning::Number, 4, camera.numbers());
        }
        if let Some(SeamGaps { angle, curvature }) = self.seam {
            let gaps = vec![angle, curvature];
            parts.push_hidden(SEAM, ElementKind::Whole, Meaning::Number, 2, gaps);
        }
        if let Some(pose) = &self.world_from_camera {
            parts.push("pose", ElementKind::Whole, Meaning::Number, 16, pose.as_slice());
        }
        parts
    }

    /// Builds a range image from parts. Only the part `point` is required. Without the part `registration` the grid is registered to a
    /// picture of the grid's size, so that each cell is on one pixel.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size()?;
        let points = parts.require("point", 3)?.to_points()?;
        let mut range = Self::new(width, height, points).map_err(PartsError::from_error)?;
        if let Some(filled) = parts.column_of("filled", 1)? {
            range = range.with_filled(filled.to_u8(1)?).map_err(PartsError::from_error)?;
        }
        if let Some(joined) = parts.column_of(JOINED, 1)? {
            range = range.with_joined(joined.to_u8(15)?).map_err(PartsError::from_error)?;
        }
        if let Some(colors) = parts.column_of("color", 3)? {
            range = range.with_colors(colors.colors()?).map_err(PartsError::from_error)?;
        }
        if let Some([sx, sy, ox, oy]) =
            parts.column("registration").map(Part::single).transpose()?
        {
            let picture = parts.require(PICTURE, 2)?;
            let picture = counts(picture, 0, picture.single()?)?;
            range = range.with_registration(Registration {
                scale: [sx, sy],
                offset: [ox, oy],
                picture,
            });
        }
        if let Some([angle, curvature]) = parts.column(SEAM).map(Part::single).transpose()? {
            range = range.with_seam(Some(SeamGaps { angle, curvature }));
        }
        let camera = Pinhole::from_parts(parts, "camera")?;
        Ok(range.with_camera(camera).with_world_from_camera(pose_of(parts, "pose")?))
    }

    /// Draws near cells bright and far cells dark, with shading as if lit from the upper left.
    fn show(&self) -> Vec<Layer> {
        let (width, height) = (self.width, self.height);
        let depths = || self.points.iter().map(|point| point.z).filter(|z| !z.is_nan());
        let (near, far) = (depths().fold(f64::INFINITY, f64::min), depths().fold(0.0, f64::max));
        let light = Vector3::new(-0.45, -0.55, -0.7).normalize();
        let cells = (0..height).flat_map(|row| (0..width).map(move |column| [column, row]));
        let pixels = cells.map(|[column, row]| -> Rgb {
            let Some(point) = self.point(row * width + column) else { return BACKGROUND };
            // The vector from the previous cell to the next cell. If one of these two is invalid or missing, the cell between them takes
            // its place.
            let across = |step: usize, at: usize, count: usize| {
                let cell = row * width + column;
                let before = (at > 0).then(|| self.point(cell - step)).flatten().unwrap_or(point);
                let behind =
                    (at + 1 < count).then(|| self.point(cell + step)).flatten().unwrap_or(point);
                behind - before
            };
            let normal = across(width, row, height).cross(&across(1, column, width));
            let lit = normal.try_normalize(0.0).map_or(0.5, |normal| normal.dot(&light).max(0.0));
            let depth = if near < far { (point.z - near) / (far - near) } else { 0.0 };
            let gray = 255.0 * (1.0 - 0.6 * depth) * (0.3 + 0.7 * lit);
            [gray.round().clamp(0.0, 255.0) as u8; 3]
        });
        let image = Image::new(width, height, Vec::from_iter(pixels));
        let registration = Some(self.registration);
        image
            .into_iter()
            .map(|image| Layer::Picture(Picture { image, registration, has_false_colors: true }))
            .collect()
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn edge_cases() -> Vec<Self> {
        let sizes = SIZES.into_iter().chain([[3, 3], [8, 5]]);
        let ranges = sizes.flat_map(|[width, height]| {
            point_sets(width * height)
                .into_iter()
                .map(move |points| Self::new(width, height, points))
        });
        ranges.flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn near_cells_are_brighter_and_holes_have_the_background_color() {
        let range = RangeImage::new(
            4,
            3,
            (0..12)
                .map(|k: usize| match k {
                    5 => Point3::new(f64::NAN, 0.0, 0.0),
                    k => Point3::new(
                        (k % 4) as f64,
                        (k / 4) as f64,
                        if k % 4 < 2 { 100.0 } else { 200.0 },
                    ),
                })
                .collect(),
        )
        .unwrap();
        let [Layer::Picture(picture)] = &range.show()[..] else { panic!("one picture") };
        assert_eq!(picture.image.pixel([1, 1]), BACKGROUND);
        assert!(picture.image.pixel([0, 2])[0] > picture.image.pixel([3, 2])[0]);
    }
}
