//! Finds range images whose depths are quantized so coarsely that surfaces have terraces.

use maquette_value::RangeImage;

use super::joins::longest_edge;

/// Maximum number of cells that are examined; of larger grids, evenly spaced rows.
const MAX_CELLS: usize = 200_000;

/// Minimum number of different depths. Fewer are planes that face the sensor.
const MIN_LEVELS: usize = 8;

/// Minimum fractions of neighboring cells that have the same depth, and of those whose depths are successive. Measured captures of sensors
/// that quantize have 0.4 and 0.15 and more, others below 0.15 and 0.1.
const MIN_SHARES: [f64; 2] = [0.2, 0.1];

/// Minimum step between successive depths, in median distances of neighboring cells. Lower terraces are not visible.
const MIN_STEP: f64 = 0.25;

/// The steps of quantized depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Terraces {
    /// The median step between successive depths, in mm.
    pub(crate) step: f64,
    /// The median distance of neighboring cells, in mm.
    pub(crate) spacing: f64,
}

impl Terraces {
    /// Measures the steps of a range image; `None` if there are no visible ones.
    pub(crate) fn new(range: &RangeImage) -> Option<Self> {
        let (width, height) = (range.width(), range.height());
        let stride = (width * height).div_ceil(MAX_CELLS).max(1);
        let rows = (0..height).step_by(stride).map(|row| &range.points()[row * width..][..width]);
        let pairs = rows.clone().flat_map(|row| row.array_windows::<2>().map(|[a, b]| [a.z, b.z]));
        let pairs = pairs.filter(|[a, b]| a.is_finite() && b.is_finite());
        let (count, equal) = pairs
            .clone()
            .fold((0_u32, 0_u32), |(count, equal), [a, b]| (count + 1, equal + u32::from(a == b)));
        if f64::from(equal) < MIN_SHARES[0] * f64::from(count) {
            return None;
        }
        let mut levels: Vec<f64> =
            rows.flatten().map(|point| point.z).filter(|depth| depth.is_finite()).collect();
        levels.sort_unstable_by(f64::total_cmp);
        levels.dedup();
        if levels.len() < MIN_LEVELS {
            return None;
        }
        let mut steps = Vec::new();
        for [a, b] in pairs {
            let next = levels.partition_point(|&level| level <= a.min(b));
            if levels.get(next) == Some(&a.max(b)) {
                steps.push((b - a).abs());
            }
        }
        if steps.is_empty() || (steps.len() as f64) < MIN_SHARES[1] * f64::from(count) {
            return None;
        }
        let middle = steps.len() / 2;
        let step = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
        let spacing = longest_edge(range, 1.0);
        (step >= MIN_STEP * spacing).then_some(Self { step, spacing })
    }

    /// Returns a warning with the node and the values that remove the terraces.
    pub(crate) fn warning(&self) -> String {
        let (step, spacing) = (self.step, self.spacing);
        // Depths that differ by less than three steps may be those of one surface. The radius is that of the usual width of a terrace.
        let depth = (3.0 * step * 10.0).ceil() / 10.0;
        format!(
            "the depths have steps of {step:.2} mm, where cells are {spacing:.2} mm apart, so the mesh has terraces: \
             smooth the range image by `Denoise(depth: {depth:?}, radius: 3, iterations: 3)`"
        )
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// Returns a range image of 60 x 40 cells, 1 mm apart, whose depths are multiples of `step` (0: not quantized).
    fn capture(step: f64, depth: impl Fn(f64, f64) -> f64) -> RangeImage {
        let cells = (0..60 * 40).map(|cell| [f64::from(cell % 60), f64::from(cell / 60)]);
        let points = cells.map(|[x, y]| {
            let z = depth(x, y);
            Point3::new(x, y, if step > 0.0 { (z / step).round() * step } else { z })
        });
        RangeImage::new(60, 40, points.collect()).unwrap()
    }

    fn bowl(x: f64, y: f64) -> f64 {
        let (x, y) = (x - 30.0, y - 20.0);
        700.0 + 0.01 * x * x + 0.013 * y * y
    }

    #[test]
    fn steps_of_a_coarse_sensor_are_measured() {
        let terraces = Terraces::new(&capture(0.8, bowl)).unwrap();
        assert!((terraces.step - 0.8).abs() < 1e-9, "{terraces:?}");
        let warning = terraces.warning();
        assert!(
            warning.contains("steps of 0.80 mm") && warning.contains("depth: 2.4,"),
            "{warning}"
        );
    }

    #[test]
    fn fine_steps_slopes_and_planes_have_no_terraces() {
        assert_eq!(Terraces::new(&capture(0.0, bowl)), None);
        assert_eq!(Terraces::new(&capture(0.1, bowl)), None);
        assert_eq!(Terraces::new(&capture(0.0, |x, y| 700.0 + 0.5 * x - 0.25 * y)), None);
        fn two_planes(x: f64, _: f64) -> f64 {
            if x < 30.0 { 700.0 } else { 720.0 }
        }
        assert_eq!(Terraces::new(&capture(0.0, two_planes)), None);
        assert_eq!(Terraces::new(&RangeImage::new(0, 0, Vec::new()).unwrap()), None);
    }
}
