//! Keeps only the pixels on the border of a mask.

use maquette_node::{Context, Error, In, Node};
use maquette_value::Mask;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Keeps the pixels of a mask that have a neighbor outside the mask, above, below, left or right.
///
/// Pixels beyond the picture are outside, so the outline of a part at the border of the picture is closed. The outline is connected by
/// corners and at most two pixels thick; `FillContour` restores the mask from it, without its holes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Outline {
    /// Mask.
    pub mask: In<Mask>,
}

impl Node for Outline {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((outline(cx.get(&self.mask)),))
    }
}

/// Returns the pixels of `mask` that share a side with a pixel outside the mask, or with the border of the picture.
pub fn outline(mask: &Mask) -> Mask {
    let (width, height) = (mask.width(), mask.height());
    let mut border = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let is_inner = column > 0
                && row > 0
                && mask.contains([column - 1, row])
                && mask.contains([column, row - 1])
                && mask.contains([column + 1, row])
                && mask.contains([column, row + 1]);
            border.push(mask.contains([column, row]) && !is_inner);
        }
    }
    Mask::from_bools(width, height, border).expect("as many pixels as before")
}

#[cfg(test)]
mod tests {
    use expect_test::expect;

    use super::*;

    #[test]
    fn inner_pixels_are_removed_and_the_border_of_the_picture_closes_the_line() {
        let mask = Mask::from_rows(&["####..", "####..", "#####.", "####.."]);
        expect![[r#"
            ####..
            #..#..
            #...#.
            ####..
        "#]]
        .assert_eq(&outline(&mask).draw());
    }

    #[test]
    fn a_hole_has_an_outline() {
        let mask = Mask::from_rows(&["#####", "#####", "##.##", "#####", "#####"]);
        expect![[r#"
            #####
            #.#.#
            ##.##
            #.#.#
            #####
        "#]]
        .assert_eq(&outline(&mask).draw());
    }
}
