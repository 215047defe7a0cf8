//! Depth maps: z per pixel, as 16-bit PNG or as TIFF of floats, which a pinhole makes points of.

use thiserror::Error;

use super::camera::CameraFile;
use super::picture_file::Kind;
use super::range_file::{Axes, RangeFile, Rows};
use super::tiff::Depths;
use super::{excerpt, png, tiff};
use crate::value::RangeImage;

/// Why bytes are not a depth map.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DepthError {
    /// No camera.
    #[error("a depth map is no points without its camera: there is no camera file")]
    NoCamera,
    /// A camera of another size.
    #[error("the camera file is for a range grid of {expected:?}, but the depth map has {found:?}")]
    Size {
        /// Width and height in the camera file.
        expected: [usize; 2],
        /// Width and height of the depth map.
        found: [usize; 2],
    },
    /// A damaged PNG file, or one of another kind.
    #[error(transparent)]
    Png(#[from] png::PngError),
    /// A damaged TIFF file, or one of another kind.
    #[error(transparent)]
    Tiff(#[from] tiff::TiffError),
    /// Something else.
    #[error("byte 0: the file begins with `{text}`: this is no PNG or TIFF depth map")]
    Unknown {
        /// How it begins.
        text: String,
    },
}

/// The points of a depth map, seen by the camera's range pinhole. A depth of 0, below 0 or not finite is a hole.
///
/// Depths are z, not distances along rays, in steps of `depth_png.units_per_mm` of the camera file; if that is not given, the
/// unit is not known. A TIFF of floats has whole units: such a scale is only for whole numbers.
///
/// # Errors
/// If the bytes are no depth map, or its camera is missing or of another size.
pub fn read(bytes: &[u8], camera: Option<&CameraFile>) -> Result<RangeFile, DepthError> {
    let Depths { width, height, depths, whole } = match Kind::of(bytes) {
        Some(Kind::Png) => {
            let (width, height, depths) = png::read_depth(bytes)?;
            let depths = depths.into_iter().map(f64::from).collect();
            Depths { width, height, depths, whole: true }
        }
        Some(Kind::Tiff) => tiff::read_depth(bytes)?,
        _ => return Err(DepthError::Unknown { text: excerpt(&bytes[..bytes.len().min(8)]) }),
    };
    let camera = camera.ok_or(DepthError::NoCamera)?;
    let found = [width, height];
    if let Some(expected) = camera.range.size.filter(|&expected| expected != found) {
        return Err(DepthError::Size { expected, found });
    }
    let unit = camera.depth_per_mm.filter(|_| whole).map(|steps| 1.0 / steps);
    let pinhole = camera.range.pinhole;
    let point = |(cell, &z): (usize, &f64)| {
        let z = if z > 0.0 { z } else { f64::NAN };
        pinhole.unproject([(cell % width) as f64, (cell / width) as f64], z)
    };
    let points = depths.iter().enumerate().map(point).collect();
    let range = RangeImage::new(width, height, points).expect("there is a depth for each pixel");
    let range = range.with_camera(Some(pinhole));
    Ok(RangeFile { range, unit, axes: Some(Axes::Camera), rows: Rows::TopFirst })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::range_file::tests::is_grid;
    use crate::format::{camera, hostile};

    const PNG: &[u8] = include_bytes!("../../tests/data/formats/depth16.png");
    const TIFF: &[u8] = include_bytes!("../../tests/data/formats/depth32f.tiff");

    #[test]
    fn an_open3d_intrinsic_file_is_a_camera() {
        let text =
            br#"{"width": 8, "height": 6, "intrinsic_matrix": [10, 0, 0, 0, 10, 0, 3.5, 2.5, 1]}"#;
        let camera = camera::read(text).unwrap();
        let range = read(TIFF, Some(&camera)).unwrap().normalize(1.0, Axes::Camera).unwrap();
        is_grid(&range, false, 1e-5);
        // Steps of 1/50 mm, of which the intrinsic file says nothing.
        let range = read(PNG, Some(&camera)).unwrap().normalize(0.02, Axes::YUp).unwrap();
        is_grid(&range, false, 1e-5);
    }

    #[test]
    fn a_depth_map_needs_a_camera_of_its_size() {
        assert_eq!(read(PNG, None).unwrap_err(), DepthError::NoCamera);
        let camera = br#"{"width": 9, "height": 6, "fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5}"#;
        let camera = camera::read(camera).unwrap();
        let expected =
            "the camera file is for a range grid of [9, 6], but the depth map has [8, 6]";
        assert_eq!(read(PNG, Some(&camera)).unwrap_err().to_string(), expected);
        assert!(matches!(read(b"P5", Some(&camera)), Err(DepthError::Unknown { .. })));
    }

    #[test]
    fn hostile_files_give_errors() {
        let camera = camera::read(br#"{"fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5}"#).unwrap();
        for file in [PNG, TIFF] {
            hostile::survive(file, |bytes| read(bytes, Some(&camera)).is_ok());
        }
    }
}
