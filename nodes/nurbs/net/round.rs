//! A hill with a round tip.

/// The outline of a hill over a disk, from its tip to its rim: `f(r)` with `f(0) = 1` and `f(1) = 0`.
///
/// With the height in multiples of the disk's radius, and t the angle of the slope, the sine `g(r) = sin t` rises from the tip, is
/// greatest on the wall, and falls to 0 at the rim: the curvatures of such a hill are `g'` along the outline and `g / r` around it, so
/// that they are continuous where `g'` is, and the tip is never more curved than the rise of `g`. The outline follows by
/// integrating `tan t`. A low hill is a dome; a high one has a wall that is nearly upright.
pub(crate) struct Round {
    /// Heights at equal steps of r.
    heights: Vec<f64>,
}

/// Where the wall begins and ends.
const WALL: [f64; 2] = [0.75, 0.92];

/// Steps of r at which the outline is known.
const STEPS: usize = 1000;

/// Heights above this are as steep as this.
const STEEPEST: f64 = 1000.0;

/// Halvings of the interval that the steepest slope lies in: as many as a number has digits.
const HALVINGS: usize = 60;

impl Round {
    /// The outline of a hill that is so many radii high.
    pub(crate) fn new(height: f64) -> Self {
        let height = height.abs().min(STEEPEST);
        // `1 - g^2` on the wall, as what is left of 1: next to 1 the sine itself has too few digits.
        let (mut low, mut high): (f64, f64) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(low, high);
            let tallest = outline(middle)[0];
            if tallest < height { high = middle } else { low = middle }
        }
        // A flat hill has the outline of a low one.
        let mut heights = outline(high.min(1.0 - 1e-6));
        let tip = heights[0];
        heights.iter_mut().for_each(|height| *height /= tip);
        Self { heights }
    }

    /// `f(r)` for r from 0 to 1.
    pub(crate) fn at(&self, r: f64) -> f64 {
        let place = r.clamp(0.0, 1.0) * STEPS as f64;
        let before = (place as usize).min(STEPS - 1);
        let share = place - before as f64;
        self.heights[before] * (1.0 - share) + self.heights[before + 1] * share
    }
}

/// The heights of the hill whose wall has a slope with the squared cosine `rest`.
fn outline(rest: f64) -> Vec<f64> {
    let greatest = (1.0 - rest).sqrt();
    fn slope(step: usize, greatest: f64, rest: f64) -> f64 {
        let sine = greatest * rise(step as f64 / STEPS as f64);
        sine / (1.0 - sine * sine).max(rest).sqrt()
    }
    let mut heights = vec![0.0; STEPS + 1];
    for step in (0..STEPS).rev() {
        heights[step] = heights[step + 1]
            + (slope(step, greatest, rest) + slope(step + 1, greatest, rest)) / (2 * STEPS) as f64;
    }
    heights
}

/// The share of the wall's sine at `r`: with a continuous derivative, which at the tip is 7 / 6 over where the wall begins.
fn rise(r: f64) -> f64 {
    let [begin, end] = WALL;
    if r < begin {
        let t = r / begin;
        (7.0 * t - t * (t * t * t) * (t * t * t)) / 6.0
    } else if r <= end {
        1.0
    } else {
        let t = (1.0 - r) / (1.0 - end);
        t * t * (3.0 - 2.0 * t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hill_falls_from_its_tip_to_its_rim() {
        for height in [0.0, 0.1, 1.0, 6.0, 100.0, 1e9, -1.0] {
            let round = Round::new(height);
            assert_eq!([round.at(0.0), round.at(1.0), round.at(2.0)], [1.0, 0.0, 0.0]);
            let falls = |step: i32| {
                round.at(f64::from(step) / 100.0) > round.at(f64::from(step + 1) / 100.0)
            };
            assert!((0..100).all(falls), "{height}");
        }
    }

    /// The radius of the disk being 1, the tip of a hill of any height is no more curved than a ball of radius 0.6.
    #[test]
    fn the_higher_a_hill_the_steeper_its_wall_and_its_tip_stays_round() {
        let mut steepest = 0.0;
        for height in [0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
            let round = Round::new(height);
            let z = |r: f64| height * round.at(r);
            let curvature = |r: f64| {
                let (first, second) = (
                    (z(r + 0.01) - z(r - 0.01)) / 0.02,
                    (z(r + 0.01) - 2.0 * z(r) + z(r - 0.01)) / 1e-4,
                );
                -second / ((1.0 + first * first) * (1.0 + first * first).sqrt())
            };
            let most = (2..70).map(|step| curvature(f64::from(step) / 100.0)).fold(0.0, f64::max);
            assert!(most < 1.0 / 0.6, "{height}: {most}");
            let wall = z(0.83) - z(0.84);
            assert!(wall > steepest);
            steepest = wall;
        }
    }
}
