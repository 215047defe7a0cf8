//! Opening and closing of masks by squares: Serra, *Image Analysis and Mathematical Morphology* (1982), chapter 2.
//!
//! A square of radius r has (2 r + 1)^2 pixels. Beyond the picture's border is background: an object at the border is
//! neither grown along it nor eaten from it.

use maquette::value::Mask;

/// Removes parts into which no square of this radius fits: erosion, then dilation. Radius 0 changes nothing.
pub fn open(mask: &Mask, radius: usize) -> Mask {
    spread_both(mask, radius, [0, 1])
}

/// Closes gaps into which no square of this radius fits: dilation, then erosion. Radius 0 changes nothing.
pub fn close(mask: &Mask, radius: usize) -> Mask {
    spread_both(mask, radius, [1, 0])
}

/// Spreads first the pixels of one kind, then those of the other.
fn spread_both(mask: &Mask, radius: usize, kinds: [u8; 2]) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    if radius == 0 || mask.count() == 0 {
        return mask.clone();
    }
    // With a margin, so that the second step finds there what the first one has left.
    let (wide, high) = (width + 2 * radius, height + 2 * radius);
    let mut pixels = vec![0; wide * high];
    for row in 0..height {
        let inner = (row + radius) * wide + radius;
        pixels[inner..inner + width].copy_from_slice(&mask.pixels()[row * width..][..width]);
    }
    for kind in kinds {
        (0..high).for_each(|row| spread(&mut pixels, row * wide, 1, wide, radius, kind));
        (0..wide).for_each(|column| spread(&mut pixels, column, wide, high, radius, kind));
    }
    let inner = |row| pixels[(row + radius) * wide + radius..][..width].iter().copied();
    Mask::new(width, height, (0..height).flat_map(inner).collect())
        .expect("as many pixels as before")
}

/// Along one line of `count` pixels, `step` apart, gives the value `kind` to all within `radius` of a pixel that has it.
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
        let mask = Mask::drawn(&["#....", "..###", "..###", "..###"]);
        assert_eq!(open(&mask, 1).draw(), ".....\n..###\n..###\n..###\n");
    }

    #[test]
    fn closing_fills_a_gap_and_leaves_the_border_alone() {
        let mask = Mask::drawn(&["##.##", "##.##", "##.##"]);
        assert_eq!(close(&mask, 1).draw(), "#####\n#####\n#####\n");
        let speck = Mask::drawn(&["#....", "....."]);
        assert_eq!(close(&speck, 1), speck);
    }
}
