//! Which pixels belong to something.

use super::hostile::SIZES;
use super::image::{SizeError, check_size};
use super::{
    Column, DecodeError, Decoder, Encoder, Image, Layer, Meaning, Mesh, Offence, On, Parts,
    PartsError, Picture, Property, Rgb, Summary, Value,
};
use crate::parallel::*;

/// Which pixels of a picture belong to something; row 0 on top.
///
/// Invariant, checked by [`Mask::new`]: as many entries as width x height, each 0 (outside) or 1 (inside).
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    width: usize,
    height: usize,
    pixels: Column<u8>,
}

impl Mask {
    /// A mask of `width` x `height` pixels, row by row from the top; every entry that is not 0 counts as inside.
    ///
    /// # Errors
    /// If there are more or fewer entries than that.
    pub fn new(width: usize, height: usize, mut pixels: Vec<u8>) -> Result<Self, SizeError> {
        check_size(width, height, pixels.len())?;
        pixels.iter_mut().for_each(|pixel| *pixel = u8::from(*pixel != 0));
        Ok(Self { width, height, pixels: pixels.into() })
    }

    /// A mask of `width` x `height` pixels, row by row from the top. As [`Mask::new`], without its pass over the entries.
    ///
    /// # Errors
    /// If there are more or fewer entries than that.
    pub fn from_bools(width: usize, height: usize, pixels: Vec<bool>) -> Result<Self, SizeError> {
        check_size(width, height, pixels.len())?;
        let pixels: Vec<u8> = bytemuck::cast_vec(pixels);
        Ok(Self { width, height, pixels: pixels.into() })
    }

    /// A mask drawn as text, one line a row: `#` is inside, everything else outside. For tests and examples.
    ///
    /// # Panics
    /// If the lines are not equally long.
    pub fn drawn(rows: &[&str]) -> Self {
        let width = rows.first().map_or(0, |row| row.len());
        let pixels = rows.iter().flat_map(|row| row.bytes().map(|c| u8::from(c == b'#')));
        Self::new(width, rows.len(), pixels.collect())
            .expect("rows of a drawn mask are equally long")
    }

    /// The mask as text, the inverse of [`Mask::drawn`] with `.` outside.
    pub fn draw(&self) -> String {
        let mut text = String::new();
        for row in 0..self.height {
            let pixels = &self.pixels[row * self.width..][..self.width];
            text.extend(pixels.iter().map(|&inside| if inside == 1 { '#' } else { '.' }));
            text.push('\n');
        }
        text
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top: 1 inside, 0 outside.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Whether the pixel at `[column, row]` is inside; a pixel outside the picture is not.
    pub fn contains(&self, [column, row]: [usize; 2]) -> bool {
        column < self.width && row < self.height && self.pixels[row * self.width + column] == 1
    }

    /// How many pixels are inside.
    pub fn count(&self) -> usize {
        fn count(pixels: &[u8]) -> u32 {
            pixels.iter().map(|&pixel| u32::from(pixel)).sum::<u32>()
        }
        self.pixels.par_chunks(1 << 18).map(|pixels| count(pixels) as usize).sum()
    }

    /// Whether no pixel is inside.
    pub fn is_empty(&self) -> bool {
        !self.pixels.contains(&1)
    }
}

impl Value for Mask {
    const NAME: &'static str = "Mask";

    fn encode(&self, to: &mut Encoder) {
        to.counts(&[self.width, self.height]).column(&self.pixels);
    }

    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let [width, height] = from.counts()?;
        Ok(Self { width, height, pixels: from.column()? })
    }

    fn properties() -> &'static [Property<Self>] {
        const PROPERTIES: &[Property<Mask>] =
            &[Property::new("NonEmpty", "A pixel is inside.", |value| {
                value.is_empty().then(|| Offence::nothing("pixel inside"))
            })];
        PROPERTIES
    }

    fn size(&self) -> usize {
        self.pixels.size()
    }

    fn describe(&self) -> Summary {
        let inside = self.count();
        let share = 100.0 * inside as f64 / self.pixels.len().max(1) as f64;
        Summary::default()
            .with("size", format!("{} x {}", self.width, self.height))
            .with("inside", format!("{inside} pixels ({share:.2} %)"))
    }

    fn probe(&self, at: [usize; 2]) -> Summary {
        Summary::default().with("inside", self.contains(at))
    }

    fn parts(&self) -> Parts<'_> {
        let mut parts = Parts::default();
        parts.grid(self.width, self.height);
        parts.push("inside", On::Pixel, Meaning::Exact, 1, &self.pixels[..]);
        parts
    }

    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let [width, height] = parts.size()?;
        let inside = parts.need("inside", 1)?.small(1)?;
        Self::new(width, height, inside).map_err(PartsError::refused)
    }

    /// White inside, black outside.
    fn show(&self) -> Vec<Layer> {
        let pixels: Vec<Rgb> = self.pixels.iter().map(|&inside| [255 * inside; 3]).collect();
        Picture::own(Image::new(self.width, self.height, pixels))
    }

    fn as_mesh(&self) -> Option<Mesh> {
        None
    }

    fn hostile() -> Vec<Self> {
        fn mask([width, height]: [usize; 2], inside: u8) -> Result<Mask, SizeError> {
            Mask::new(width, height, vec![inside; width * height])
        }
        SIZES.into_iter().flat_map(|size| [mask(size, 0), mask(size, 1)]).flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawn_mask_draws_the_same() {
        let mask = Mask::drawn(&["#.#", "..."]);
        assert_eq!(mask.draw(), "#.#\n...\n");
        assert_eq!(mask.count(), 2);
        assert!(mask.contains([2, 0]) && !mask.contains([3, 0]));
    }

    #[test]
    fn a_mask_of_bools_is_the_one_of_their_numbers() {
        let mask = Mask::from_bools(2, 1, vec![false, true]).unwrap();
        assert_eq!(mask, Mask::new(2, 1, vec![0, 7]).unwrap());
        assert!(Mask::from_bools(2, 1, vec![true]).is_err());
    }

    #[test]
    fn only_a_mask_without_pixels_inside_is_empty() {
        assert!(Mask::drawn(&["..."]).is_empty() && Mask::drawn(&[]).is_empty());
        assert!(!Mask::drawn(&["..#"]).is_empty());
    }
}
