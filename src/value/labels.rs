//! Labels: for each pixel, the component that contains it.

use std::collections::HashMap;
use std::sync::Arc;

use thiserror::Error;

use super::image::{SizeError, check_size};
use super::{Column, Mask};
use crate::memory::huge_vec;
use crate::parallel::*;

mod elements;
mod value;

use elements::Component;

/// For each pixel of a picture, the component that contains it. 0 is background; components are numbered from 1 in the order of their first
/// pixels, row by row from the top.
///
/// Invariant, checked by [`Labels::new`] and [`Labels::from_runs`]: there are width x height entries, no entry exceeds the number of
/// components, and each component has at least one pixel.
#[derive(Clone, Debug)]
pub struct Labels {
    width: usize,
    height: usize,
    pixels: Pixels,
    statistics: Vec<LabelStatistics>,
}

#[derive(Clone, Debug)]
enum Pixels {
    All(Column<u32>),
    /// One component of a picture. A picture may have thousands of components, so the pixels of each are expanded only on first use.
    Component(Arc<Component>),
}

impl PartialEq for Labels {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height) == (other.width, other.height) && self.column() == other.column()
    }
}

/// Statistics of one component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelStatistics {
    /// The number of pixels of the component.
    pub area: usize,
    /// The first pixel, row by row from the top: column, row.
    pub first: [usize; 2],
    /// The upper left pixel of the bounding box: column, row.
    pub low: [usize; 2],
    /// The lower right pixel of the bounding box (inclusive): column, row.
    pub high: [usize; 2],
    /// The mean of the pixels' centers: column, row.
    pub centroid: [f64; 2],
    /// True if a pixel of the component is in the outermost rows or columns of the picture.
    pub touches_border: bool,
}

/// Consecutive pixels of one row with the same label.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LabelRun {
    /// The row of all pixels of the run, from the top.
    pub row: u32,
    /// The column of the first pixel of the run.
    pub start: u32,
    /// The column after the last pixel of the run.
    pub end: u32,
    /// The label of the pixels, which is the number of their component, from 1.
    pub label: u32,
}

/// Error of building labels from runs. Contains the message.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct LabelsError(String);

/// The number of rows per parallel task, which is enough work to outweigh the cost of a task.
const STRIP_ROWS: usize = 64;

impl Labels {
    /// Builds labels of `width` x `height` pixels, row by row from the top. The components are renumbered in the order of their first
    /// pixels.
    ///
    /// # Errors
    /// If the number of entries is not `width` x `height`.
    pub fn new(width: usize, height: usize, pixels: Vec<u32>) -> Result<Self, SizeError> {
        check_size(width, height, pixels.len())?;
        let mut runs = runs_of(width, &pixels);
        renumber(&mut runs);
        Ok(Self::assemble(width, height, pixels, &runs))
    }

    /// Builds labels of `width` x `height` pixels from runs, row by row from the top. The components must already be numbered in the order
    /// of their first pixels. All pixels outside of the runs are background.
    ///
    /// # Errors
    /// If a run is empty or outside of the picture, or starts before the end of the previous run, or if its label is 0 or skips a number.
    pub fn from_runs(width: usize, height: usize, runs: &[LabelRun]) -> Result<Self, LabelsError> {
        let (mut behind, mut components) = ((0, 0), 0);
        for (run, &LabelRun { row, start, end, label }) in runs.iter().enumerate() {
            let inside = (row as usize) < height && end as usize <= width;
            if !inside || end <= start || (row, start) < behind {
                return Err(LabelsError(format!(
                    "run {run} is empty, outside of the picture, or not after the previous run"
                )));
            }
            if label == 0 || components + 1 < label {
                return Err(LabelsError(format!(
                    "run {run} has label {label}, but only {components} components come before it"
                )));
            }
            behind = (row, end);
            components = components.max(label);
        }
        Ok(Self::assemble(width, height, huge_vec(width * height), runs))
    }

    /// Writes the labels of the runs into `pixels`. All other entries of `pixels` must already be 0 (background).
    fn assemble(width: usize, height: usize, mut pixels: Vec<u32>, runs: &[LabelRun]) -> Self {
        let strips = pixels.par_chunks_mut(STRIP_ROWS.saturating_mul(width.max(1))).enumerate();
        strips.for_each(|(strip, pixels)| {
            let rows = STRIP_ROWS * strip..STRIP_ROWS * (strip + 1);
            let first = runs.partition_point(|run| (run.row as usize) < rows.start);
            for run in runs[first..].iter().take_while(|run| (run.row as usize) < rows.end) {
                let row = &mut pixels[(run.row as usize - rows.start) * width..][..width];
                row[run.start as usize..run.end as usize].fill(run.label);
            }
        });
        let pixels = Pixels::All(pixels.into());
        Self { width, height, pixels, statistics: statistics(width, height, runs) }
    }

    /// The width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top.
    pub fn pixels(&self) -> &[u32] {
        self.column()
    }

    fn column(&self) -> &Column<u32> {
        match &self.pixels {
            Pixels::All(pixels) => pixels,
            Pixels::Component(component) => component.pixels(),
        }
    }

    /// The label at `[column, row]`; 0 outside of the picture.
    pub fn label(&self, [column, row]: [usize; 2]) -> u32 {
        match &self.pixels {
            _ if column >= self.width || row >= self.height => 0,
            Pixels::All(pixels) => pixels[row * self.width + column],
            Pixels::Component(component) => u32::from(component.contains([column, row])),
        }
    }

    /// The pixels of one component, restricted to its bounding box. The first entry is the pixel at the component's
    /// [`low`](LabelStatistics::low), the upper left corner of the box.
    ///
    /// # Panics
    /// If there is no component with this label.
    pub fn component(&self, label: u32) -> Mask {
        let LabelStatistics { low, high, .. } = self.statistics[label as usize - 1];
        let [columns, rows] = [0, 1].map(|axis| high[axis] + 1 - low[axis]);
        let inside = (low[1]..=high[1]).flat_map(|row| (low[0]..=high[0]).map(move |at| [at, row]));
        let inside = inside.map(|at| self.label(at) == label).collect();
        Mask::from_bools(columns, rows, inside).expect("one entry per pixel of the box")
    }

    /// The statistics of each component. The component with the label `n` has the index `n - 1`.
    pub fn statistics(&self) -> &[LabelStatistics] {
        &self.statistics
    }

    /// The labels sorted by area, from the largest component to the smallest; components of equal area by label.
    pub fn by_area(&self) -> Vec<u32> {
        let mut labels: Vec<u32> = (1..=self.statistics.len() as u32).collect();
        labels.sort_by_key(|&label| std::cmp::Reverse(self.statistics[label as usize - 1].area));
        labels
    }
}

/// Renumbers the labels in the order in which the runs first use them.
fn renumber(runs: &mut [LabelRun]) {
    let mut count = 0;
    fn number(seen: &mut u32, count: &mut u32) -> u32 {
        if *seen == 0 {
            *count += 1;
            *seen = *count;
        }
        *seen
    }
    let max_label = runs.iter().map(|run| run.label as usize).max().unwrap_or(0);
    if max_label <= 4 * runs.len() {
        let mut seen = vec![0; max_label + 1];
        runs.iter_mut()
            .for_each(|run| run.label = number(&mut seen[run.label as usize], &mut count));
    } else {
        let mut seen = HashMap::new();
        runs.iter_mut()
            .for_each(|run| run.label = number(seen.entry(run.label).or_insert(0), &mut count));
    }
}

/// Splits pixels into runs, row by row from the top.
fn runs_of(width: usize, pixels: &[u32]) -> Vec<LabelRun> {
    let mut runs = Vec::new();
    for (row, pixels) in (0..).zip(pixels.chunks(width.max(1))) {
        let mut start = 0;
        for same in pixels.chunk_by(|a, b| a == b) {
            let end = start + same.len() as u32;
            if same[0] != 0 {
                runs.push(LabelRun { row, start, end, label: same[0] });
            }
            start = end;
        }
    }
    runs
}

/// Computes the statistics of each component from runs whose labels are numbered in the order of first use.
fn statistics(width: usize, height: usize, runs: &[LabelRun]) -> Vec<LabelStatistics> {
    let mut statistics: Vec<LabelStatistics> = Vec::new();
    let mut sums: Vec<[u64; 2]> = Vec::new();
    for run in runs {
        let [start, last, row] = [run.start, run.end - 1, run.row].map(|at| at as usize);
        let component = run.label as usize - 1;
        if component == statistics.len() {
            sums.push([0; 2]);
            statistics.push(LabelStatistics {
                area: 0,
                first: [start, row],
                low: [start, row],
                high: [last, row],
                centroid: [0.0; 2],
                touches_border: false,
            });
        }
        let (component, sum) = (&mut statistics[component], &mut sums[component]);
        let count = last + 1 - start;
        component.area += count;
        component.low[0] = component.low[0].min(start);
        component.high = [component.high[0].max(last), row];
        sum[0] += (count * (start + last) / 2) as u64;
        sum[1] += (count * row) as u64;
    }
    for (component, sum) in statistics.iter_mut().zip(sums) {
        component.centroid = sum.map(|sum| sum as f64 / component.area as f64);
        component.touches_border = component.low.contains(&0)
            || component.high[0] + 1 == width
            || component.high[1] + 1 == height;
    }
    statistics
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_numbered_as_they_are_met() {
        let labels = Labels::new(3, 2, vec![0, 9, 9, 4, 9, 0]).unwrap();
        assert_eq!(labels.pixels(), [0, 1, 1, 2, 1, 0]);
        let first = labels.statistics()[0];
        assert_eq!((first.area, first.first, first.low, first.high), (3, [1, 0], [1, 0], [2, 1]));
        assert_eq!(first.centroid, [4.0 / 3.0, 1.0 / 3.0]);
        assert!(first.touches_border);
        assert_eq!(labels.by_area(), [1, 2]);
    }

    #[test]
    fn of_two_equal_components_the_lower_label_comes_first() {
        assert_eq!(Labels::new(3, 1, vec![5, 0, 2]).unwrap().by_area(), [1, 2]);
    }

    #[test]
    fn labels_may_be_any_numbers() {
        let far = vec![u32::MAX, u32::MAX, 7, 0, 7, u32::MAX - 1];
        assert_eq!(Labels::new(3, 2, far).unwrap().pixels(), [1, 1, 2, 0, 2, 3]);
        let near = vec![3, 3, 2, 0, 2, 1];
        assert_eq!(Labels::new(3, 2, near).unwrap().pixels(), [1, 1, 2, 0, 2, 3]);
        assert_eq!(Labels::new(0, 5, vec![]).unwrap().statistics(), []);
    }

    #[test]
    fn runs_make_the_same_labels_as_their_pixels() {
        fn run(row: u32, start: u32, end: u32, label: u32) -> LabelRun {
            LabelRun { row, start, end, label }
        }
        let runs = [run(0, 1, 3, 1), run(1, 0, 1, 2), run(1, 1, 2, 1)];
        let labels = Labels::from_runs(3, 2, &runs).unwrap();
        assert_eq!(labels, Labels::new(3, 2, vec![0, 9, 9, 4, 9, 0]).unwrap());
    }

    #[test]
    fn runs_out_of_order_are_refused() {
        fn run(start: u32, end: u32, label: u32) -> LabelRun {
            LabelRun { row: 0, start, end, label }
        }
        for (runs, first_wrong) in [
            (vec![run(0, 4, 1)], 0),
            (vec![run(1, 1, 1)], 0),
            (vec![run(0, 2, 1), run(1, 3, 1)], 1),
            (vec![LabelRun { row: 1, ..run(0, 1, 1) }], 0),
        ] {
            let error = Labels::from_runs(3, 1, &runs);
            let wrong = "is empty, outside of the picture, or not after the previous run";
            assert_eq!(error, Err(LabelsError(format!("run {first_wrong} {wrong}"))));
        }
        let wrong = "run 1 has label 3, but only 1 components come before it";
        let error = Labels::from_runs(3, 1, &[run(0, 1, 1), run(2, 3, 3)]);
        assert_eq!(error, Err(LabelsError(wrong.into())));
    }
}
