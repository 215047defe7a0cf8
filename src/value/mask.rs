//! Masks: sets of pixels.

use super::content::content_of_fields;
use super::edge_cases::uniform_pictures;
use super::image::{SizeError, check_size};
use super::{
    Column, ElementKind, Image, Layer, Meaning, Mesh, Parts, PartsError, Picture, Property, Rgb,
    Summary, Value, Violation,
};
use crate::parallel::*;

/// A set of pixels of a picture; row 0 is the top.
///
/// Invariant, checked by [`Mask::new`]: there are width x height entries, each 0 (outside) or 1 (inside).
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    width: usize,
    height: usize,
    pixels: Column<u8>,
}

impl Mask {
    /// Builds a mask of `width` x `height` pixels, row by row from the top. Every entry other than 0 counts as inside.
    ///
    /// # Errors
    /// If the number of entries is not `width` x `height`.
    pub fn new(width: usize, height: usize, mut pixels: Vec<u8>) -> Result<Self, SizeError> {
        check_size(width, height, pixels.len())?;
        pixels.iter_mut().for_each(|pixel| *pixel = u8::from(*pixel != 0));
        Ok(Self { width, height, pixels: pixels.into() })
    }

    /// Builds a mask of `width` x `height` pixels, row by row from the top. It is faster than [`Mask::new`], because no entry needs to be
    /// changed to 0 or 1.
    ///
    /// # Errors
    /// If the number of entries is not `width` x `height`.
    pub fn from_bools(width: usize, height: usize, pixels: Vec<bool>) -> Result<Self, SizeError> {
        check_size(width, height, pixels.len())?;
        let pixels: Vec<u8> = bytemuck::cast_vec(pixels);
        Ok(Self { width, height, pixels: pixels.into() })
    }

    /// Builds a mask from lines of text, one line per row: `#` is inside, everything else is outside. For tests and examples.
    ///
    /// # Panics
    /// If the lines have different lengths.
    pub fn from_rows(rows: &[&str]) -> Self {
        let width = rows.first().map_or(0, |row| row.len());
        let pixels = rows.iter().flat_map(|row| row.bytes().map(|c| u8::from(c == b'#')));
        Self::new(width, rows.len(), pixels.collect())
            .expect("rows of a drawn mask are equally long")
    }

    /// Converts the mask to text, with `#` for inside and `.` for outside. This is the inverse of [`Mask::from_rows`].
    pub fn draw(&self) -> String {
        let mut text = String::new();
        for row in 0..self.height {
            let pixels = &self.pixels[row * self.width..][..self.width];
            text.extend(pixels.iter().map(|&inside| if inside == 1 { '#' } else { '.' }));
            text.push('\n');
        }
        text
    }

    /// The width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top: 1 inside, 0 outside.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Returns true if the pixel at `[column, row]` is inside the mask; false outside of the picture.
    pub fn contains(&self, [column, row]: [usize; 2]) -> bool {
        column < self.width && row < self.height && self.pixels[row * self.width + column] == 1
    }

    /// The number of pixels inside the mask.
    pub fn count(&self) -> usize {
        fn count(pixels: &[u8]) -> u32 {
            pixels.iter().map(|&pixel| u32::from(pixel)).sum::<u32>()
        }
        self.pixels.par_chunks(1 << 18).map(|pixels| count(pixels) as usize).sum()
    }

    /// Returns true if no pixel is inside the mask.
    pub fn is_empty(&self) -> bool {
        !self.pixels.contains(&1)
    }
}

impl Value for Mask {
    const NAME: &'static str = "Mask";

    content_of_fields! { width height pixels }

    fn properties() -> &'static [Property<Self>] {
        const {
            &[Property::new("NonEmpty", "A pixel is inside.", |value: &Self| {
                value.is_empty().then(|| Violation::lack_of("pixel inside"))
            })]
        }
    }

    fn describe(&self) -> Summary {
        let inside = self.count();
        let fraction = 100.0 * inside as f64 / self.pixels.len().max(1) as f64;
        Summary::default()
            .with_fact("size", format!("{} x {}", self.width, self.height))
            .with_fact("inside", format!("{inside} pixels ({fraction:.2} %)"))
    }

    fn probe(&self, at: [usize; 2]) -> Summary {
        Summary::default().with_fact("inside", self.contains(at))
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.push("inside", ElementKind::Pixel, Meaning::Exact, 1, &self.pixels[..]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size()?;
        let inside = parts.require("inside", 1)?.to_u8(1)?;
        Self::new(width, height, inside).map_err(PartsError::from_error)
    }

    /// Draws pixels inside in white and pixels outside in black.
    fn show(&self) -> Vec<Layer> {
        let pixels: Vec<Rgb> = self.pixels.iter().map(|&inside| [255 * inside; 3]).collect();
        Picture::from_true_colors(Image::new(self.width, self.height, pixels))
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn edge_cases() -> Vec<Self> {
        uniform_pictures(&[0, 1], Self::new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawn_mask_draws_the_same() {
        let mask = Mask::from_rows(&["#.#", "..."]);
        assert_eq!(mask.draw(), "#.#\n...\n");
        assert_eq!(mask.count(), 2);
        assert!(mask.contains([2, 0]) && !mask.contains([3, 0]));
    }

    #[test]
    fn masks_from_bools_and_from_numbers_are_equal() {
        let mask = Mask::from_bools(2, 1, vec![false, true]).unwrap();
        assert_eq!(mask, Mask::new(2, 1, vec![0, 7]).unwrap());
        assert!(Mask::from_bools(2, 1, vec![true]).is_err());
    }

    #[test]
    fn only_a_mask_without_pixels_inside_is_empty() {
        assert!(Mask::from_rows(&["..."]).is_empty() && Mask::from_rows(&[]).is_empty());
        assert!(!Mask::from_rows(&["..#"]).is_empty());
    }
}
