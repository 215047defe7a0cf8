//! Combines two masks pixel by pixel.

use maquette_node::{Context, Error, In, Node};
use maquette_value::Mask;
use maquette_value::parallel::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Combines two masks pixel by pixel.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct CombineMasks {
    /// The first mask.
    pub a: In<Mask>,
    /// The second mask, of the same size.
    pub b: In<Mask>,
    /// Which pixels are kept.
    #[serde(default)]
    pub mode: CombineMode,
}

/// Which pixels two masks make together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CombineMode {
    /// Those inside both.
    #[default]
    And,
    /// Those inside at least one.
    Or,
    /// Those inside the first and not the second.
    Minus,
    /// Those inside one and not the other.
    Xor,
}

/// Why masks cannot be combined.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CombineMasksError {
    /// They are for different pictures.
    #[error("mask `a` has {a:?} pixels, mask `b` {b:?}")]
    Size {
        /// The first mask's size.
        a: [usize; 2],
        /// The second mask's size.
        b: [usize; 2],
    },
}

impl Node for CombineMasks {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((combine_masks(cx.get(&self.a), cx.get(&self.b), self.mode)?,))
    }
}

/// The pixels that `a` and `b` make together.
///
/// # Errors
/// If the masks have different sizes.
pub fn combine_masks(a: &Mask, b: &Mask, mode: CombineMode) -> Result<Mask, CombineMasksError> {
    let [size_a, size_b] = [a, b].map(|mask| [mask.width(), mask.height()]);
    if size_a != size_b {
        return Err(CombineMasksError::Size { a: size_a, b: size_b });
    }
    let pairs = a.pixels().par_iter().zip(b.pixels()).with_min_len(4096);
    let pixels = pairs
        .map(|(&a, &b): (&u8, &u8)| match mode {
            CombineMode::And => a & b == 1,
            CombineMode::Or => a | b == 1,
            CombineMode::Minus => b < a,
            CombineMode::Xor => a != b,
        })
        .collect();
    Ok(Mask::from_bools(size_a[0], size_a[1], pixels).expect("one pixel for each pair"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_mode_keeps_its_pixels() {
        let (a, b) = (Mask::drawn(&["##.."]), Mask::drawn(&["#.#."]));
        fn combined(mode: CombineMode, a: &Mask, b: &Mask) -> String {
            combine_masks(a, b, mode).unwrap().draw()
        }
        assert_eq!(combined(CombineMode::And, &a, &b), "#...\n");
        assert_eq!(combined(CombineMode::Or, &a, &b), "###.\n");
        assert_eq!(combined(CombineMode::Minus, &a, &b), ".#..\n");
        assert_eq!(combined(CombineMode::Xor, &a, &b), ".##.\n");
    }

    #[test]
    fn masks_of_different_sizes_are_an_error() {
        let error =
            combine_masks(&Mask::drawn(&["##"]), &Mask::drawn(&["#", "#"]), CombineMode::Or);
        assert_eq!(error, Err(CombineMasksError::Size { a: [2, 1], b: [1, 2] }));
    }
}
