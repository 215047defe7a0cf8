//! Opening and closing of masks by squares: Serra, *Image Analysis and Mathematical Morphology* (1982), chapter 2.
//!
//! A square of radius r has (2 r + 1)^2 pixels. All pixels beyond the border of the picture are background. An object at the border is
//! neither extended along the border nor eroded from it.

use maquette_value::Mask;

/// Removes the parts of the mask that no square of the radius `radius` inside the mask covers: erosion, then dilation. Radius 0 changes
/// nothing.
pub fn open(mask: &Mask, radius: usize) -> Mask {
    spread_both(mask, radius, [0, 1])
}

/// Fills the gaps of the mask that no square of the radius `radius` outside the mask covers: dilation, then erosion. Radius 0 changes
/// nothing.
pub fn close(mask: &Mask, radius: usize) -> Mask {
    spread_both(mask, radius, [1, 0])
}

/// Dilates the mask: returns all pixels that are in a square of the radius `radius` around a pixel of the mask. Radius 0 changes nothing.
pub fn dilate(mask: &Mask, radius: usize) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    let mut pixels = mask.pixels().to_vec();
    spread_square(&mut pixels, width, height, radius, 1);
    Mask::new(width, height, pixels).expect("as many pixels as before")
}

/// Spreads the pixels with the value `kinds[0]` by squares of the radius `radius`, then those with the value `kinds[1]`.
fn spread_both(mask: &Mask, radius: usize, kinds: [u8; 2]) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    if radius == 0 || mask.count() == 0 {
        return mask.clone();
    }
    // Add a margin around the picture. It holds the pixels beyond the border that the first step sets and the second step needs.
    let (wide, high) = (width + 2 * radius, height + 2 * radius);
    let mut pixels = vec![0; wide * high];
    for row in 0..height {
        let inner = (row + radius) * wide + radius;
        pixels[inner..inner + width].copy_from_slice(&mask.pixels()[row * width..][..width]);
    }
    kinds.into_iter().for_each(|kind| spread_square(&mut pixels, wide, high, radius, kind));
    Mask::new(
        width,
        height,
        (0..height)
            .flat_map(|row| pixels[(row + radius) * wide + radius..][..width].iter().copied())
            .collect(),
    )
    .expect("as many pixels as before")
}

/// Sets to `kind` all pixels in the squares of the radius `radius` around pixels with the value `kind`.
fn spread_square(pixels: &mut [u8], width: usize, height: usize, radius: usize, kind: u8) {
    (0..height).for_each(|row| spread(pixels, row * width, 1, width, radius, kind));
    (0..width).for_each(|column| spread(pixels, column, width, height, radius, kind));
}

/// Sets to `kind` each pixel on a line whose distance from a pixel with the value `kind` is at most `radius`. The line has `count` pixels,
/// whose indices are `step` apart.
fn spread(pixels: &mut [u8], first: usize, step: usize, count: usize, radius: usize, kind: u8) {
    let of_kind: Vec<usize> = (0..count).filter(|k| pixels[first + k * step] == kind).collect();
    let mut done = 0;
    for center in of_kind {
        for k in center.saturating_sub(radius).max(done)..(center + radius + 1).min(count) {
            pixels[first + k * step] = kind;
            done = k + 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opening_removes_a_speck_and_keeps_a_square() {
        let mask = Mask::from_rows(&["#....", "..###", "..###", "..###"]);
        assert_eq!(open(&mask, 1).draw(), ".....\n..###\n..###\n..###\n");
    }

    #[test]
    fn dilating_grows_by_squares_up_to_the_border() {
        let mask = Mask::from_rows(&["#.....", "......", "......", ".....#"]);
        assert_eq!(dilate(&mask, 1).draw(), "##....\n##....\n....##\n....##\n");
        assert_eq!(dilate(&mask, 0), mask);
        assert_eq!(dilate(&mask, 9).count(), 24);
    }

    #[test]
    fn closing_fills_a_gap_and_leaves_the_border_alone() {
        let mask = Mask::from_rows(&["##.##", "##.##", "##.##"]);
        assert_eq!(close(&mask, 1).draw(), "#####\n#####\n#####\n");
        let speck = Mask::from_rows(&["#....", "....."]);
        assert_eq!(close(&speck, 1), speck);
    }
}
