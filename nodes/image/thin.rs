//! Thins a mask to lines of one pixel.
//!
//! Pixels inside the mask are connected by sides and corners, pixels outside it by sides only. The eight neighbors of a pixel are numbered
//! clockwise, beginning above it. In a neighborhood (`u8`), bit k is set if neighbor k is inside the mask.

use maquette_node::{Context, Error, In, Node, bail};
use maquette_value::parallel::*;
use maquette_value::{Field, Mask};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Thins a mask to lines of one pixel: removes pixels from its border as long as no part is split or vanishes, no hole opens or closes, and
/// no line gets shorter.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Thin {
    /// Mask to thin, such as edges.
    pub mask: In<Mask>,
    /// Weight of each pixel, such as the gradient of edges: border pixels of least weight are removed first. If omitted, those closest to
    /// the outside are removed first. Only `Ordered` uses it.
    pub keep: Option<In<Field>>,
    /// Thinning method.
    #[serde(default)]
    pub method: ThinMethod,
}

/// Method to choose the pixels that are removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum ThinMethod {
    /// Pixels one after the other, layer by layer: no part is split or vanishes, and no removable pixel is left.
    #[default]
    Ordered,
    /// Guo and Hall's method, all pixels at once in two alternating passes. For comparison; it may change the connectivity.
    GuoHall,
    /// Zhang and Suen's method, all pixels at once in two alternating passes. For comparison; it loses squares of two by two pixels.
    ZhangSuen,
}

impl Node for Thin {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let keep = self.keep.as_ref().map(|field| cx.get(field));
        Ok((thin(cx.get(&self.mask), keep, self.method)?,))
    }
}

/// Thins `mask` to lines of one pixel. Pixels beyond the picture are outside.
///
/// [`ThinMethod::Ordered`] visits the pixels of the border layer by layer, in the order of `keep`: least first, NaN before all numbers.
/// Without `keep`, they are ordered by their distance from the outside. Pixels with equal keys are visited row by row from the top. A pixel
/// is removed if it is simple when it is visited and is not the end of a line. It is simple if Yokoi's number is 1, that is, if its removal
/// changes no connection: Yokoi, Toriwaki and Fukumura, "An analysis of topological properties of digitized binary pictures using local
/// features" (1975). The number of parts and of holes is kept, and thinning the result again changes nothing.
///
/// [`ThinMethod::GuoHall`]: Guo and Hall, "Parallel thinning with two-subiteration algorithms" (1989), algorithm A1.
/// [`ThinMethod::ZhangSuen`]: Zhang and Suen, "A fast parallel algorithm for thinning digital patterns" (1984).
///
/// # Errors
/// Returns an error if `keep` does not have the size of the mask.
pub fn thin(mask: &Mask, keep: Option<&Field>, method: ThinMethod) -> Result<Mask, Error> {
    let size = [mask.width(), mask.height()];
    if let Some(keep) = keep.map(|field| [field.width(), field.height()]).filter(|k| *k != size) {
        bail!("the field `keep` has {keep:?} pixels, but the mask has {size:?}");
    }
    let mut canvas = Canvas::new(mask);
    match method {
        ThinMethod::Ordered => {
            let keys = keep.map_or_else(|| canvas.distances(), |field| canvas.ranks(field));
            canvas.thin_in_order(&keys);
        }
        ThinMethod::GuoHall => canvas.thin_at_once(guo_hall),
        ThinMethod::ZhangSuen => canvas.thin_at_once(zhang_suen),
    }
    Ok(canvas.mask())
}

/// A mask surrounded by a margin of one pixel that is outside.
struct Canvas {
    size: [usize; 2],
    stride: usize,
    pixels: Vec<u8>,
}

impl Canvas {
    fn new(mask: &Mask) -> Self {
        let size = [mask.width(), mask.height()];
        let stride = size[0] + 2;
        let mut pixels = vec![0; stride * (size[1] + 2)];
        for row in 0..size[1] {
            let first = (row + 1) * stride + 1;
            pixels[first..][..size[0]].copy_from_slice(&mask.pixels()[row * size[0]..][..size[0]]);
        }
        Self { size, stride, pixels }
    }

    fn mask(&self) -> Mask {
        let [width, height] = self.size;
        let rows = (0..height).map(|row| &self.pixels[(row + 1) * self.stride + 1..][..width]);
        let pixels = rows.flatten().map(|&pixel| pixel == 1);
        Mask::from_bools(width, height, pixels.collect()).expect("as many pixels as before")
    }

    fn inside_pixels(&self) -> impl Iterator<Item = usize> {
        (0..self.pixels.len()).until_stopped().filter(|&index| self.pixels[index] == 1)
    }

    fn neighbors(&self, index: usize) -> [usize; 8] {
        let (above, below) = (index - self.stride, index + self.stride);
        [above, above + 1, index + 1, below + 1, below, below - 1, index - 1, above - 1]
    }

    fn neighborhood(&self, index: usize) -> u8 {
        let bits = self.neighbors(index).map(|neighbor| self.pixels[neighbor]);
        bits.iter().rev().fold(0, |bits, bit| bits << 1 | bit)
    }

    fn is_on_border(&self, index: usize) -> bool {
        self.neighborhood(index) & SIDES != SIDES
    }

    fn thin_in_order(&mut self, keys: &[u32]) {
        let mut listed = vec![false; self.pixels.len()];
        let border = self.inside_pixels().filter(|&index| self.is_on_border(index));
        let mut border: Vec<(u32, usize)> = border.map(|index| (keys[index], index)).collect();
        while !border.is_empty() {
            border.par_sort_unstable();
            let mut touched = Vec::new();
            for &(_, index) in border.iter().until_stopped() {
                if CAN_GO[usize::from(self.neighborhood(index))] {
                    self.pixels[index] = 0;
                    touched.extend(self.neighbors(index));
                }
            }
            border.clear();
            // Only pixels near removed ones can be in the next layer. The others have been tried, and their neighborhoods have not changed
            // since.
            for &index in touched.iter().until_stopped() {
                if self.pixels[index] == 1 && !listed[index] && self.is_on_border(index) {
                    listed[index] = true;
                    border.push((keys[index], index));
                }
            }
            border.iter().for_each(|&(_, index)| listed[index] = false);
        }
    }

    /// Removes the pixels whose neighborhoods `can_go` accepts. In each pass they are removed all at once; pass 0 and pass 1 alternate
    /// until no pixel is removed.
    fn thin_at_once(&mut self, can_go: fn(u8, usize) -> bool) {
        let tables = [0, 1].map(|pass| -> [bool; 256] {
            std::array::from_fn(|neighborhood| can_go(neighborhood as u8, pass))
        });
        let mut inside: Vec<usize> = self.inside_pixels().collect();
        let mut before = usize::MAX;
        while inside.len() < before {
            before = inside.len();
            for table in &tables {
                let (removed, kept): (Vec<_>, _) = inside
                    .into_iter()
                    .until_stopped()
                    .partition(|index| table[usize::from(self.neighborhood(*index))]);
                removed.into_iter().for_each(|index| self.pixels[index] = 0);
                inside = kept;
            }
        }
    }

    /// Returns, for each pixel, about three times its distance from the outside of the mask: the 3-4 chamfer distance, Borgefors, "Distance
    /// transformations in digital images" (1986).
    fn distances(&self) -> Vec<u32> {
        let mut distances: Vec<u32> =
            self.pixels.iter().map(|&pixel| if pixel == 1 { u32::MAX / 2 } else { 0 }).collect();
        // The first pass compares each pixel with the neighbors before it (left and above), the second pass with those after it.
        for (backwards, earlier) in [(false, [6, 7, 0, 1]), (true, [2, 3, 4, 5])] {
            let count = distances.len();
            for step_index in (0..count).until_stopped() {
                let index = if backwards { count - 1 - step_index } else { step_index };
                if self.pixels[index] == 1 {
                    let neighbors = self.neighbors(index);
                    for k in earlier {
                        let step = if k % 2 == 0 { 3 } else { 4 };
                        distances[index] = distances[index].min(distances[neighbors[k]] + step);
                    }
                }
            }
        }
        distances
    }

    /// Returns, for each pixel, an integer that sorts like the number of the field at this pixel; 0 for NaN.
    fn ranks(&self, field: &Field) -> Vec<u32> {
        let mut ranks = vec![0; self.pixels.len()];
        let rows = ranks.chunks_mut(self.stride).skip(1);
        for (ranks, numbers) in rows.zip(field.pixels().chunks(self.size[0].max(1))) {
            ranks[1..].iter_mut().zip(numbers).for_each(|(to, number)| *to = rank(*number));
        }
        ranks
    }
}

fn rank(number: f32) -> u32 {
    // Adding 0 converts -0 to 0.
    let bits = (number + 0.0).to_bits();
    match number {
        _ if number.is_nan() => 0,
        _ if bits >> 31 == 1 => !bits,
        _ => bits | 1 << 31,
    }
}

/// The bits in a neighborhood of the neighbors that share a side with the pixel.
const SIDES: u8 = 0b0101_0101;

/// For each neighborhood, true if the pixel may be removed: it is simple (its removal changes no connection) and not the end of a line.
const CAN_GO: [bool; 256] = {
    let mut table = [false; 256];
    let mut neighborhood = 0;
    while neighborhood < 256 {
        table[neighborhood] = can_go(neighborhood as u8);
        neighborhood += 1;
    }
    table
};

const fn can_go(neighborhood: u8) -> bool {
    let outside = !neighborhood;
    let mut yokoi = 0;
    let mut k = 0;
    while k < 8 {
        // The lowest three bits of `three` are the neighbors k, k + 1 and k + 2.
        let three = outside.rotate_right(k) & 0b111;
        if three & 1 == 1 && three != 0b111 {
            yokoi += 1;
        }
        k += 2;
    }
    yokoi == 1 && neighborhood.count_ones() > 1
}

/// Returns true if a pixel with this neighborhood is removed in the given pass, 0 or 1. Checks the conditions (a) to (d) of Zhang and Suen,
/// whose neighbors P2 to P9 are bits 0 to 7.
fn zhang_suen(neighborhood: u8, pass: usize) -> bool {
    let starts = neighborhood & !neighborhood.rotate_left(1);
    fn has_all(bits: u8, neighborhood: u8) -> bool {
        neighborhood & bits == bits
    }
    let (north, east, south, west) = (1, 1 << 2, 1 << 4, 1 << 6);
    let stays = match pass {
        0 => {
            has_all(north | east | south, neighborhood)
                || has_all(east | south | west, neighborhood)
        }
        _ => {
            has_all(north | east | west, neighborhood)
                || has_all(north | south | west, neighborhood)
        }
    };
    (2..=6).contains(&neighborhood.count_ones()) && starts.count_ones() == 1 && !stays
}

/// Returns true if a pixel with this neighborhood is removed in the given pass, 0 or 1. Checks the conditions of Guo and Hall's algorithm
/// A1. Its neighbors P1 to P8 are counted clockwise from the upper left, so they are bits 7, 0, 1, ... 6 here.
fn guo_hall(neighborhood: u8, pass: usize) -> bool {
    let [n, ne, e, se, s, sw, w, nw] = std::array::from_fn(|k| neighborhood >> k & 1 == 1);
    fn count(conditions: [bool; 4]) -> usize {
        conditions.iter().filter(|is_met| **is_met).count()
    }
    let parts = count([!n && (ne || e), !e && (se || s), !s && (sw || w), !w && (nw || n)]);
    let pairs = count([nw || n, ne || e, se || s, sw || w]);
    let other_pairs = count([n || ne, e || se, s || sw, w || nw]);
    let stays = match pass {
        0 => (n || ne || !se) && e,
        _ => (s || sw || !nw) && w,
    };
    parts == 1 && (2..=3).contains(&pairs.min(other_pairs)) && !stays
}

#[cfg(test)]
mod tests {
    use super::super::{Connectivity, label};
    use super::*;

    const ALL: [ThinMethod; 3] = [ThinMethod::Ordered, ThinMethod::GuoHall, ThinMethod::ZhangSuen];

    /// Returns a pseudorandom number and advances `state`: Marsaglia's xorshift.
    fn random(state: &mut u64) -> u64 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        *state >> 11
    }

    /// Returns a mask of random noise, for some seeds smoothed to blobs. Size and density depend on the seed.
    fn blobs(seed: u64) -> Mask {
        let mut state = (seed + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let [width, height] = [28 - (seed % 5) as usize, 28 - (seed % 3) as usize];
        let density = 25 + seed % 60;
        let noise: Vec<_> =
            (0..width * height).map(|_| random(&mut state) % 100 < density).collect();
        Mask::from_bools(
            width,
            height,
            (0..width * height)
                .map(|index: usize| {
                    let (column, row) = (index % width, index / width);
                    fn is_near(x: usize, center: usize, seed: u64) -> bool {
                        x.abs_diff(center) <= (seed % 3) as usize
                    }
                    let window = (0..width * height).filter(|k| {
                        is_near(k % width, column, seed) && is_near(k / width, row, seed)
                    });
                    let (count, inside) =
                        window.fold((0, 0), |sum, k| (sum.0 + 1, sum.1 + u32::from(noise[k])));
                    count < 2 * inside
                })
                .collect(),
        )
        .unwrap()
    }

    /// Returns the number of parts inside the mask (connected by sides and corners) and the number of parts outside (connected by sides).
    /// Everything beyond the picture belongs to one part outside.
    fn parts(mask: &Mask) -> [usize; 2] {
        let inside = label(mask, Connectivity::Eight).statistics().len();
        let canvas = Canvas::new(mask);
        let outside = canvas.pixels.iter().map(|&pixel| pixel == 0).collect();
        let outside = Mask::from_bools(mask.width() + 2, mask.height() + 2, outside).unwrap();
        [inside, label(&outside, Connectivity::Four).statistics().len()]
    }

    fn field(mask: &Mask, seed: u64) -> Field {
        let mut state = seed + 7;
        let numbers = mask.pixels().iter().map(|_| (random(&mut state) % 9) as f32 - 4.0);
        Field::new(mask.width(), mask.height(), numbers.collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn ordered_thinning_keeps_parts_and_holes_and_leaves_no_removable_pixel() {
        for seed in 0..1000 {
            let mask = blobs(seed);
            let keep = (seed % 2 == 0).then(|| field(&mask, seed));
            let thinned = thin(&mask, keep.as_ref(), ThinMethod::Ordered).unwrap();
            assert_eq!(parts(&thinned), parts(&mask), "seed {seed}");
            let canvas = Canvas::new(&thinned);
            let removable =
                canvas.inside_pixels().find(|&index| can_go(canvas.neighborhood(index)));
            assert_eq!(removable, None, "seed {seed}");
            assert_eq!(thin(&thinned, keep.as_ref(), ThinMethod::Ordered).unwrap(), thinned);
        }
    }

    #[test]
    fn thinning_adds_no_pixel() {
        for (seed, method) in (0..60).flat_map(|seed| ALL.map(|method| (seed, method))) {
            let mask = blobs(seed);
            let thinned = thin(&mask, None, method).unwrap();
            let mut pairs = thinned.pixels().iter().zip(mask.pixels());
            assert!(pairs.all(|(after, before)| after <= before), "{seed} {method:?}");
        }
    }

    #[test]
    fn a_line_of_one_pixel_stays() {
        for line in [
            &["......", ".####.", "......"][..],
            &["#....", ".#...", "..#..", "...##"],
            &["#"],
            &["##"],
            &["..#..", ".#.#.", "#...#", ".#.#.", "..#.."],
        ] {
            let mask = Mask::from_rows(line);
            assert_eq!(thin(&mask, None, ThinMethod::Ordered).unwrap(), mask);
        }
    }

    #[test]
    fn the_side_of_a_band_with_greater_weight_is_kept() {
        let mask = Mask::from_rows(&["########", "########"]);
        for strong in [0, 1] {
            let numbers = (0..16).map(|index| f32::from(u8::from(index / 8 == strong)));
            let keep = Field::new(8, 2, numbers.collect::<Vec<_>>()).unwrap();
            let thinned = thin(&mask, Some(&keep), ThinMethod::Ordered).unwrap();
            let inner = (1..7).map(|column| thinned.contains([column, strong]));
            assert!(inner.into_iter().all(|inside| inside), "{}", thinned.draw());
            assert_eq!(parts(&thinned), [1, 1]);
        }
    }

    #[test]
    fn every_method_makes_a_line_of_a_bar() {
        let bar =
            Mask::from_rows(&[".........", ".#######.", ".#######.", ".#######.", "........."]);
        for method in ALL {
            let thinned = thin(&bar, None, method).unwrap();
            let middle = (3..6).map(|column| [1, 2, 3].map(|row| thinned.contains([column, row])));
            assert!(
                middle.into_iter().all(|rows| rows == [false, true, false]),
                "{}",
                thinned.draw()
            );
        }
    }

    #[test]
    fn zhang_and_suen_lose_a_square_and_thinning_in_order_does_not() {
        let square = Mask::from_rows(&["....", ".##.", ".##.", "...."]);
        assert!(thin(&square, None, ThinMethod::ZhangSuen).unwrap().is_empty());
        assert!(!thin(&square, None, ThinMethod::Ordered).unwrap().is_empty());
    }

    #[test]
    fn ranks_have_the_order_of_their_numbers() {
        let numbers =
            [f32::NAN, f32::NEG_INFINITY, -3.0, -0.5, 0.0, 1e-40, 0.5, 7.0, f32::INFINITY];
        assert!(numbers.map(rank).is_sorted_by(|a, b| a < b));
        assert_eq!(rank(-0.0), rank(0.0));
    }

    #[test]
    fn a_field_of_another_size_is_an_error() {
        let keep = Field::new(1, 1, vec![0.0]).unwrap();
        let error = thin(&Mask::from_rows(&["##"]), Some(&keep), ThinMethod::Ordered);
        let expected = "the field `keep` has [1, 1] pixels, but the mask has [2, 1]";
        assert_eq!(error.unwrap_err().to_string(), expected);
    }
}
