//! Keeps the border of a mask.

use maquette_node::{Context, Error, In, Node};
use maquette_value::Mask;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Keeps the pixels of a mask that have a neighbor outside of it, above, below, left or right.
///
/// Beyond the picture is outside, so that the outline of what touches the picture's border is closed. It is a line that hangs
/// together by corners, at most two pixels thick; `FillContour` makes the mask of it again, without its holes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Outline {
    /// The mask.
    pub mask: In<Mask>,
}

impl Node for Outline {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((outline(cx.get(&self.mask)),))
    }
}

/// The pixels of `mask` that share a side with a pixel outside of it, or with the picture's border.
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
    fn inner_pixels_go_and_the_border_of_the_picture_closes_the_line() {
        let mask = Mask::drawn(&["####..", "####..", "#####.", "####.."]);
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
        let mask = Mask::drawn(&["#####", "#####", "##.##", "#####", "#####"]);
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
