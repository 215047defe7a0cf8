//! Labels the connected components of a mask.
//!
//! Two passes over runs of pixels: He, Chao and Suzuki, "A run-based two-scan labeling algorithm", IEEE Transactions on Image Processing 17
//! (2008). Strips of rows are processed in parallel, each with as many provisional labels as it has runs. The final numbering does not
//! depend on the division into strips.

use std::ops::Range;

use maquette_value::parallel::*;
use maquette_value::{LabelRun, Labels, Mask};

use crate::connectivity::Connectivity;

/// The number of rows in a strip: enough work for a parallel task.
const STRIP_ROWS: usize = 64;

/// Numbers the connected components of `mask`, in the order of their first pixels, row by row from the top.
pub fn label(mask: &Mask, connectivity: Connectivity) -> Labels {
    let (width, height) = (mask.width(), mask.height());
    let reach = match connectivity {
        Connectivity::Eight => 1,
        Connectivity::Four => 0,
    };
    let strips: Vec<Strip> = mask
        .pixels()
        .par_chunks(STRIP_ROWS * width.max(1))
        .enumerate()
        .map(|(strip, pixels)| Strip::new(pixels, width, STRIP_ROWS * strip, reach))
        .collect();
    let count = strips.iter().map(|strip| strip.runs.len()).sum();
    let mut all = Strip::with_capacity(count);
    strips.into_iter().for_each(|strip| all.append(strip, reach));
    Labels::from_runs(width, height, &all.into_labels())
        .expect("runs are found row by row, and a part is numbered at its first run")
}

/// Rows of a mask as runs (pixels of a row that are inside the mask without a gap), and the connections between the runs.
#[derive(Default)]
pub(crate) struct Strip {
    /// The runs, row by row from the top; their labels are not set yet.
    runs: Vec<LabelRun>,
    /// For each run, the index of a connected run, not greater than its own index. The first run of a component refers to itself.
    parents: Vec<u32>,
    /// The number of runs in the first row of the strip.
    first: usize,
    /// The number of runs in the last row of the strip.
    last: usize,
}

impl Strip {
    fn with_capacity(runs: usize) -> Self {
        Self {
            runs: Vec::with_capacity(runs),
            parents: Vec::with_capacity(runs),
            ..Self::default()
        }
    }

    fn new(pixels: &[u8], width: usize, first_row: usize, reach: u32) -> Self {
        let mut strip = Self::default();
        for (row, pixels) in pixels.chunks(width).enumerate() {
            let start = strip.runs.len();
            push_runs(pixels, (first_row + row) as u32, &mut strip.runs);
            let end = strip.runs.len();
            strip.parents.extend(start as u32..end as u32);
            strip.join_rows(start - strip.last..start, start..end, reach);
            strip.last = end - start;
            if row == 0 {
                strip.first = strip.last;
            }
        }
        strip
    }

    /// Appends the strip of rows below `self`, and connects its first row with the last row of `self`.
    fn append(&mut self, below: Self, reach: u32) {
        let start = self.runs.len();
        self.runs.extend(below.runs);
        self.parents.extend(below.parents.iter().map(|parent| parent + start as u32));
        self.join_rows(start - self.last..start, start..start + below.first, reach);
        self.last = below.last;
    }

    /// Connects the runs of two adjacent rows that share a side of pixels; with `reach` 1 also those that share only a corner.
    fn join_rows(&mut self, above: Range<usize>, below: Range<usize>, reach: u32) {
        let mut upper = above.start;
        for lower in below {
            let LabelRun { start, end, .. } = self.runs[lower];
            // A run above that ends before the current run does not touch later runs of the row either.
            while upper < above.end && self.runs[upper].end + reach <= start {
                upper += 1;
            }
            let mut next = upper;
            while next < above.end && self.runs[next].start < end + reach {
                self.join(next as u32, lower as u32);
                next += 1;
            }
        }
    }

    /// Connects the components of two runs. The earlier of their first runs becomes the first run of the union.
    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }

    /// Finds the first run of the component that contains `run`, with path halving: Tarjan and van Leeuwen, "Worst-case analysis of set
    /// union algorithms" (1984).
    fn find(&mut self, mut run: u32) -> u32 {
        while self.parents[run as usize] != run {
            let parent = self.parents[run as usize];
            self.parents[run as usize] = self.parents[parent as usize];
            run = self.parents[run as usize];
        }
        run
    }

    /// Returns the runs with the labels of their components, numbered from 1.
    fn into_labels(mut self) -> Vec<LabelRun> {
        let mut count = 0;
        for run in 0..self.runs.len() {
            let parent = self.parents[run] as usize;
            self.runs[run].label = if parent == run {
                count += 1;
                count
            } else {
                self.runs[parent].label
            };
        }
        self.runs
    }
}

/// Appends the runs of one row of pixels to `runs`.
fn push_runs(pixels: &[u8], row: u32, runs: &mut Vec<LabelRun>) {
    let mut start = 0;
    while start < pixels.len() {
        let end = start + run_length(&pixels[start..]);
        if pixels[start] == 1 {
            runs.push(LabelRun { row, start: start as u32, end: end as u32, label: 0 });
        }
        start = end;
    }
}

/// Returns the number of pixels at the start of the list that are equal to the first pixel.
fn run_length(pixels: &[u8]) -> usize {
    // Compare 16 pixels at once, with one instruction of the processor.
    let sixteen = [pixels[0]; 16];
    let length = 16 * pixels.chunks_exact(16).take_while(|chunk| **chunk == sixteen).count();
    let rest = &pixels[length..];
    length + rest.iter().position(|&pixel| pixel != pixels[0]).unwrap_or(rest.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [Connectivity; 2] = [Connectivity::Eight, Connectivity::Four];

    /// Labels a mask by the definition: floods from each pixel that has no label yet, row by row from the top.
    fn flood(mask: &Mask, connectivity: Connectivity) -> Vec<u32> {
        let (width, height) = (mask.width() as isize, mask.height() as isize);
        let mut labels = vec![0; mask.pixels().len()];
        let mut count = 0;
        for start in 0..labels.len() {
            if mask.pixels()[start] == 0 || labels[start] != 0 {
                continue;
            }
            count += 1;
            labels[start] = count;
            let mut stack = vec![start];
            while let Some(pixel) = stack.pop() {
                let (column, row) = (pixel as isize % width, pixel as isize / width);
                for (x, y) in (-1..=1).flat_map(|y| (-1..=1).map(move |x| (x, y))) {
                    let next = (column + x, row + y);
                    let is_neighbor = connectivity == Connectivity::Eight || x == 0 || y == 0;
                    if !is_neighbor
                        || !(0..width).contains(&next.0)
                        || !(0..height).contains(&next.1)
                    {
                        continue;
                    }
                    let next = (next.1 * width + next.0) as usize;
                    if mask.pixels()[next] == 1 && labels[next] == 0 {
                        labels[next] = count;
                        stack.push(next);
                    }
                }
            }
        }
        labels
    }

    /// Returns a mask in which about `density` percent of the pixels are inside: Marsaglia's xorshift, seeded by the size of the mask.
    fn noise(width: usize, height: usize, density: u64) -> Mask {
        let mut state = ((1 + width * 1000 + height) as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let pixels = (0..width * height).map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            u8::from((state >> 11) % 100 < density)
        });
        Mask::new(width, height, pixels.collect()).unwrap()
    }

    #[test]
    fn labels_are_those_of_flooding_at_every_size() {
        let densities = [5, 25, 40, 50, 60, 75, 95];
        for (width, height) in (1..=65).flat_map(|width| (1..=65).map(move |h| (width, h))) {
            let mask = noise(width, height, densities[(width * 3 + height) % densities.len()]);
            for connectivity in BOTH {
                let labels = label(&mask, connectivity);
                assert_eq!(labels.pixels(), flood(&mask, connectivity), "{width} x {height}");
            }
        }
    }

    #[test]
    fn labels_are_those_of_flooding_at_every_density_and_for_any_number_of_threads() {
        for density in (5..=95).step_by(5) {
            let mask = noise(150, 200, density);
            for connectivity in BOTH {
                let expected = flood(&mask, connectivity);
                for threads in [1, 2, 8] {
                    let pool =
                        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                    let labels = pool.install(|| label(&mask, connectivity));
                    assert_eq!(labels.pixels(), expected, "{density} {threads}");
                }
            }
        }
    }

    #[test]
    fn a_checkerboard_is_one_part_by_corners_and_as_many_as_pixels_by_sides() {
        let pixels = (0..70 * 130).map(|index| u8::from((index % 70 + index / 70) % 2 == 0));
        let mask = Mask::new(70, 130, pixels.collect()).unwrap();
        assert_eq!(label(&mask, Connectivity::Eight).statistics().len(), 1);
        assert_eq!(label(&mask, Connectivity::Four).statistics().len(), mask.count());
    }

    #[test]
    fn a_full_mask_is_one_part_and_an_empty_one_has_none() {
        for connectivity in BOTH {
            let full = label(&Mask::new(5, 4, vec![1; 20]).unwrap(), connectivity);
            assert_eq!((full.statistics().len(), full.statistics()[0].area), (1, 20));
            for (width, height) in [(5, 4), (0, 4), (5, 0)] {
                let empty = Mask::new(width, height, vec![0; width * height]).unwrap();
                assert_eq!(label(&empty, connectivity).statistics(), []);
            }
        }
    }

    #[test]
    fn each_dot_of_a_dotted_row_is_a_part() {
        let labels = label(&Mask::from_rows(&["#.#.#"]), Connectivity::Eight);
        assert_eq!(labels.pixels(), [1, 0, 2, 0, 3]);
    }

    #[test]
    fn parts_that_meet_late_have_one_number() {
        let mask = Mask::from_rows(&["#.#.#", "#.###", "###.."]);
        assert_eq!(label(&mask, Connectivity::Four).statistics().len(), 1);
        let mask = Mask::from_rows(&["#...#", ".#.#.", "..#..", "#...."]);
        assert_eq!(label(&mask, Connectivity::Eight).statistics().len(), 2);
        assert_eq!(label(&mask, Connectivity::Four).statistics().len(), 6);
    }
}
