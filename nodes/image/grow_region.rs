//! Grows a region of like color from seeds.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maquette_node::{Context, Error, In, Node};
use maquette_value::{Image, Lab, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::picture_error::{PictureError, check_inside, check_size};

/// Grows a region from some pixels over neighbors whose color is near to the mean color of what it has already.
///
/// It grows up, down, left and right, over the nearest color first. Unlike a threshold it stays in one piece with its seeds, and
/// follows a color that changes slowly.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct GrowRegion {
    /// The picture.
    pub image: In<Image>,
    /// Where it may grow; everywhere if left out. Seeds outside of it do not count.
    pub within: Option<In<Mask>>,
    /// Pixels that belong to the region in any case: column, row.
    pub seeds: Vec<(u32, u32)>,
    /// Largest distance from the region's mean color that still belongs to it, in CIE L*a*b* (CIE76); 2.3 is just noticeable.
    #[schemars(range(min = 0.0, max = 400.0))]
    #[serde(default = "twelve")]
    pub distance: f64,
    /// How much differences of lightness count: 1 as all others, 0 not at all, which ignores shading.
    #[schemars(range(min = 0.0, max = 10.0))]
    #[serde(default = "one")]
    pub lightness: f64,
}

fn twelve() -> f64 {
    12.0
}

fn one() -> f64 {
    1.0
}

impl Node for GrowRegion {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let within = self.within.as_ref().map(|mask| cx.get(mask));
        let image = cx.get(&self.image);
        let mask = grow_region(image, within, &self.seeds, self.distance, self.lightness)?;
        if mask.is_empty() {
            cx.warn("the region is empty: there is no seed, or none inside of `within`");
        }
        Ok((mask,))
    }
}

/// The pixels inside `within` (everywhere if left out) over which a region grows from `seeds` (column, row). A pixel beside the
/// region joins it if its distance from the mean color of the region at that time, in Lab with differences of lightness weighed
/// by `lightness`, is at most `distance`.
///
/// Adams and Bischof, "Seeded region growing", IEEE Transactions on Pattern Analysis and Machine Intelligence 16 (1994), for one
/// region: candidates wait in the order of the distance that they had when the region reached them, equal ones from the top row
/// by row. A candidate that is too far when its turn comes gets another when the region reaches it from another side.
///
/// # Errors
/// If a seed is outside of the picture, or `within` has another size.
pub fn grow_region(
    image: &Image,
    within: Option<&Mask>,
    seeds: &[(u32, u32)],
    distance: f64,
    lightness: f64,
) -> Result<Mask, PictureError> {
    check_size(image, within)?;
    seeds.iter().try_for_each(|&seed| check_inside(image, seed))?;
    let (width, height) = (image.width(), image.height());
    let mut region = Region {
        image,
        lightness,
        inside: vec![false; width * height],
        sum: [0.0; 3],
        count: 0.0,
        waiting: BinaryHeap::new(),
    };
    let may_grow = |index: usize| within.is_none_or(|mask| mask.pixels()[index] == 1);
    let seeds = seeds.iter().map(|&(column, row)| row as usize * width + column as usize);
    let seeds: Vec<usize> = seeds.filter(|&seed| may_grow(seed)).collect();
    seeds.iter().for_each(|&seed| region.join(seed));
    seeds.iter().for_each(|&seed| region.reach_from(seed, &may_grow));
    while let Some(Reverse((_, index))) = region.waiting.pop() {
        if !region.inside[index] && region.distance_sq(index) <= distance * distance {
            region.join(index);
            region.reach_from(index, &may_grow);
        }
    }
    Ok(Mask::from_bools(width, height, region.inside).expect("one mark per pixel"))
}

struct Region<'a> {
    image: &'a Image,
    lightness: f64,
    inside: Vec<bool>,
    /// Of the colors inside: L, a, b.
    sum: [f64; 3],
    count: f64,
    /// The nearest first: the bits of the squared distance, whose order is that of the distances, and the pixel.
    waiting: BinaryHeap<Reverse<(u64, usize)>>,
}

impl Region<'_> {
    fn color(&self, index: usize) -> [f64; 3] {
        let lab = Lab::from_srgb(self.image.pixels()[index]);
        [lab.l, lab.a, lab.b].map(f64::from)
    }

    fn join(&mut self, index: usize) {
        if !std::mem::replace(&mut self.inside[index], true) {
            let color = self.color(index);
            self.sum.iter_mut().zip(color).for_each(|(sum, channel)| *sum += channel);
            self.count += 1.0;
        }
    }

    /// The squared distance from the mean color.
    fn distance_sq(&self, index: usize) -> f64 {
        let color = self.color(index);
        let [l, a, b] = [0, 1, 2].map(|k| color[k] - self.sum[k] / self.count);
        l * l * self.lightness * self.lightness + a * a + b * b
    }

    fn reach_from(&mut self, index: usize, may_grow: &impl Fn(usize) -> bool) {
        let (width, count) = (self.image.width(), self.inside.len());
        let column = index % width;
        let neighbors = [
            (width <= index).then(|| index - width),
            (column > 0).then(|| index - 1),
            (column + 1 < width).then_some(index + 1),
            Some(index + width).filter(|below| *below < count),
        ];
        for next in neighbors.into_iter().flatten() {
            if !self.inside[next] && may_grow(next) {
                self.waiting.push(Reverse((self.distance_sq(next).to_bits(), next)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gray picture, one digit a pixel, ten levels a digit.
    fn gray(rows: &[&str]) -> Image {
        let pixels =
            rows.iter().flat_map(|row| row.bytes()).map(|digit| [(digit - b'0') * 10 + 50; 3]);
        Image::new(rows[0].len(), rows.len(), Vec::from_iter(pixels)).unwrap()
    }

    fn grown(rows: &[&str], seeds: &[(u32, u32)], distance: f64, lightness: f64) -> String {
        grow_region(&gray(rows), None, seeds, distance, lightness).unwrap().draw()
    }

    #[test]
    fn it_stops_at_another_color_and_does_not_jump() {
        assert_eq!(grown(&["11911", "11911"], &[(0, 0)], 5.0, 1.0), "##...\n##...\n");
        assert_eq!(grown(&["11911", "11911"], &[(0, 0), (4, 1)], 5.0, 1.0), "##.##\n##.##\n");
        assert_eq!(grown(&["19", "91"], &[(0, 0)], 5.0, 1.0), "#.\n..\n");
    }

    #[test]
    fn it_follows_a_color_that_changes_slowly() {
        // A step is about 4 in lightness; the mean lags behind by half of what has been gone.
        assert_eq!(grown(&["0123456789"], &[(0, 0)], 9.0, 1.0), "####......\n");
        assert_eq!(grown(&["0123456789"], &[(0, 0)], 3.0, 1.0), "#.........\n");
    }

    #[test]
    fn without_lightness_all_grays_are_alike() {
        assert_eq!(grown(&["0199", "9190"], &[(2, 1)], 1.0, 0.0), "####\n####\n");
    }

    #[test]
    fn it_stays_within_the_mask() {
        let within = Mask::drawn(&["##.#"]);
        let mask = grow_region(&gray(&["1111"]), Some(&within), &[(0, 0), (2, 0)], 5.0, 1.0);
        assert_eq!(mask.unwrap().draw(), "##..\n");
    }

    #[test]
    fn without_seeds_it_is_empty() {
        assert!(grow_region(&gray(&["11"]), None, &[], 5.0, 1.0).unwrap().is_empty());
    }

    #[test]
    fn seeds_and_masks_that_do_not_fit_are_errors() {
        let image = gray(&["11"]);
        let outside = grow_region(&image, None, &[(0, 0), (0, 1)], 5.0, 1.0);
        assert_eq!(outside, Err(PictureError::Outside { column: 0, row: 1, width: 2, height: 1 }));
        let within = Mask::drawn(&["#"]);
        let error = grow_region(&image, Some(&within), &[], 5.0, 1.0);
        assert_eq!(error, Err(PictureError::Size { mask: [1, 1], image: [2, 1] }));
    }
}
