//! Grows a region of similar color from seeds.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maquette_node::{Context, Error, In, Node};
use maquette_value::parallel::StopFlag;
use maquette_value::{Image, Lab, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::checks::{check_inside, check_size};

/// Grows a region from seed pixels over neighbors whose color is close to the mean color of the region.
///
/// The region grows up, down, left and right, to the closest color first. Unlike a threshold, the result is connected with its seeds, and
/// follows a color that changes slowly.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct GrowRegion {
    /// Picture.
    pub image: In<Image>,
    /// Limits the region to these pixels; seeds outside are ignored. If omitted, the region may grow everywhere.
    pub within: Option<In<Mask>>,
    /// Seed pixels (column, row), which always belong to the region.
    pub seeds: Vec<(u32, u32)>,
    /// Maximum distance from the mean color of the region, in CIE L*a*b* (CIE76); 2.3 is just noticeable.
    #[schemars(range(min = 0.0, max = 400.0))]
    #[serde(default = "default_distance")]
    pub distance: f64,
    /// Weight of lightness differences: 1 weights lightness like color, 0 ignores it and so shading.
    #[schemars(range(min = 0.0, max = 10.0))]
    #[serde(default = "default_lightness")]
    pub lightness: f64,
}

fn default_distance() -> f64 {
    12.0
}

fn default_lightness() -> f64 {
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
            cx.warn("the region is empty: add seeds inside `within`");
        }
        Ok((mask,))
    }
}

/// Grows a region from `seeds` (column, row) inside `within` (everywhere if `None`). A pixel next to the region joins it if the distance
/// between its color and the current mean color of the region is at most `distance`. Colors are compared in CIE L*a*b*, with lightness
/// differences weighted by `lightness`.
///
/// Adams and Bischof, "Seeded region growing", IEEE Transactions on Pattern Analysis and Machine Intelligence 16 (1994), for one region.
/// Candidate pixels are ordered by the color distance that they had when the region reached them; equally distant ones row by row from the
/// top. A candidate that was rejected is tried again when the region reaches it from another side.
///
/// Returns an error if a seed is outside the picture, or if `within` does not have the size of the picture.
pub fn grow_region(
    image: &Image,
    within: Option<&Mask>,
    seeds: &[(u32, u32)],
    distance: f64,
    lightness: f64,
) -> Result<Mask, Error> {
    check_size([image.width(), image.height()], within)?;
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
    let stop = StopFlag::current();
    while let Some(Reverse((_, index))) = region.waiting.pop() {
        stop.check();
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
    /// The sum of the colors of the region's pixels: L, a, b.
    sum: [f64; 3],
    count: f64,
    /// The candidate pixels, closest color first. An entry contains the bits of the squared color distance, which sort like the distances,
    /// and the index of the pixel.
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

    /// Returns the squared distance between a pixel's color and the mean color of the region.
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

    /// Returns a gray picture drawn with one digit per pixel; the gray level is ten times the digit, plus 50.
    fn gray(rows: &[&str]) -> Image {
        let pixels =
            rows.iter().flat_map(|row| row.bytes()).map(|digit| [(digit - b'0') * 10 + 50; 3]);
        Image::new(rows[0].len(), rows.len(), pixels.collect::<Vec<_>>()).unwrap()
    }

    fn grow(rows: &[&str], seeds: &[(u32, u32)], distance: f64, lightness: f64) -> String {
        grow_region(&gray(rows), None, seeds, distance, lightness).unwrap().draw()
    }

    #[test]
    fn it_stops_at_another_color_and_does_not_jump() {
        assert_eq!(grow(&["11911", "11911"], &[(0, 0)], 5.0, 1.0), "##...\n##...\n");
        assert_eq!(grow(&["11911", "11911"], &[(0, 0), (4, 1)], 5.0, 1.0), "##.##\n##.##\n");
        assert_eq!(grow(&["19", "91"], &[(0, 0)], 5.0, 1.0), "#.\n..\n");
    }

    #[test]
    fn it_follows_a_color_that_changes_slowly() {
        // Each step changes the lightness by about 4, and the mean color is at the center of the range that the region covers.
        assert_eq!(grow(&["0123456789"], &[(0, 0)], 9.0, 1.0), "####......\n");
        assert_eq!(grow(&["0123456789"], &[(0, 0)], 3.0, 1.0), "#.........\n");
    }

    #[test]
    fn without_lightness_all_grays_are_alike() {
        assert_eq!(grow(&["0199", "9190"], &[(2, 1)], 1.0, 0.0), "####\n####\n");
    }

    #[test]
    fn it_stays_within_the_mask() {
        let within = Mask::from_rows(&["##.#"]);
        let mask = grow_region(&gray(&["1111"]), Some(&within), &[(0, 0), (2, 0)], 5.0, 1.0);
        assert_eq!(mask.unwrap().draw(), "##..\n");
    }

    #[test]
    fn without_seeds_it_is_empty() {
        assert!(grow_region(&gray(&["11"]), None, &[], 5.0, 1.0).unwrap().is_empty());
    }

    #[test]
    fn seeds_outside_and_masks_of_another_size_are_errors() {
        let image = gray(&["11"]);
        let outside = grow_region(&image, None, &[(0, 0), (0, 1)], 5.0, 1.0);
        let expected = "pixel (0, 1) is outside the picture, which has 2 x 1 pixels";
        assert_eq!(outside.unwrap_err().to_string(), expected);
        let within = Mask::from_rows(&["#"]);
        let error = grow_region(&image, Some(&within), &[], 5.0, 1.0);
        let expected = "the mask `within` has [1, 1] pixels, but the picture has [2, 1]";
        assert_eq!(error.unwrap_err().to_string(), expected);
    }
}
