//! Combines two masks pixel by pixel.

use maquette_node::{Context, Error, Forecast, In, Node, Sizes, bail};
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
    /// Combination of the masks.
    #[serde(default)]
    pub mode: CombineMode,
}

/// Combination of two masks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CombineMode {
    /// Pixels inside both masks.
    #[default]
    And,
    /// Pixels inside at least one mask.
    Or,
    /// Pixels inside the first mask and not the second.
    Minus,
    /// Pixels inside exactly one mask.
    Xor,
}

impl Node for CombineMasks {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Some(Forecast::by_law(sizes.get(&self.a)?))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((combine_masks(cx.get(&self.a), cx.get(&self.b), self.mode)?,))
    }
}

/// Combines the masks `a` and `b` by `mode`.
///
/// # Errors
/// Returns an error if the masks have different sizes.
pub fn combine_masks(a: &Mask, b: &Mask, mode: CombineMode) -> Result<Mask, Error> {
    let [size_a, size_b] = [a, b].map(|mask| [mask.width(), mask.height()]);
    if size_a != size_b {
        bail!("the masks must have the same size: `a` has {size_a:?} pixels, `b` has {size_b:?}");
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
        let (a, b) = (Mask::from_rows(&["##.."]), Mask::from_rows(&["#.#."]));
        fn combine(mode: CombineMode, a: &Mask, b: &Mask) -> String {
            combine_masks(a, b, mode).unwrap().draw()
        }
        assert_eq!(combine(CombineMode::And, &a, &b), "#...\n");
        assert_eq!(combine(CombineMode::Or, &a, &b), "###.\n");
        assert_eq!(combine(CombineMode::Minus, &a, &b), ".#..\n");
        assert_eq!(combine(CombineMode::Xor, &a, &b), ".##.\n");
    }

    #[test]
    fn masks_of_different_sizes_are_an_error() {
        let error = combine_masks(
            &Mask::from_rows(&["##"]),
            &Mask::from_rows(&["#", "#"]),
            CombineMode::Or,
        );
        let expected = "the masks must have the same size: `a` has [2, 1] pixels, `b` has [1, 2]";
        assert_eq!(error.unwrap_err().to_string(), expected);
    }
}
