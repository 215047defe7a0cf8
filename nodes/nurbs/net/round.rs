//! A hill with a round tip.

/// The profile of a hill over a disk, from its tip to its border: a height `f(r)` with `f(0) = 1` and `f(1) = 0`.
///
/// The profile is defined by `g(r) = sin t`, where t is the angle of the slope and the height is measured in multiples of the disk's
/// radius. `g` rises from the tip, is largest on the wall (the steepest part), and falls to 0 at the border. The principal curvatures of
/// such a hill are `g'` along the profile and `g / r` around it. They are continuous where `g'` is, and the curvature of the tip is at most
/// the initial slope of `g`. The profile is the integral of `tan t`. A low hill is a dome; a high one has a nearly vertical wall.
pub(crate) struct Round {
    /// The heights of the profile at equal steps of r.
    heights: Vec<f64>,
}

/// The radii between which the hill is steepest (the wall), as fractions of the disk's radius.
const WALL: [f64; 2] = [0.75, 0.92];

/// Number of steps of r.
const STEPS: usize = 1000;

/// Maximum height of a hill, relative to its radius, for which a profile is computed. All higher hills use the profile of this height.
const STEEPEST: f64 = 1000.0;

/// Number of bisection steps that find the steepest slope; more would not change a 64-bit number.
const HALVINGS: usize = 60;

impl Round {
    /// Creates the profile of a hill of the given height, in radii.
    pub(crate) fn new(height: f64) -> Self {
        let height = height.abs().min(STEEPEST);
        // The bisection finds `1 - g^2` on the wall, because near 1 the sine `g` itself has too few digits.
        let (mut low, mut high): (f64, f64) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(low, high);
            let tallest = outline(middle)[0];
            if tallest < height { high = middle } else { low = middle }
        }
        // A flat hill (height 0) uses the profile of a very low hill.
        let mut heights = outline(high.min(1.0 - 1e-6));
        let tip = heights[0];
        heights.iter_mut().for_each(|height| *height /= tip);
        Self { heights }
    }

    /// Returns the height `f(r)` of the profile for r from 0 (the tip, height 1) to 1 (the border, height 0).
    pub(crate) fn height(&self, r: f64) -> f64 {
        let place = r.clamp(0.0, 1.0) * STEPS as f64;
        let before = (place as usize).min(STEPS - 1);
        let share = place - before as f64;
        self.heights[before] * (1.0 - share) + self.heights[before + 1] * share
    }
}

/// Returns the heights of a hill before they are scaled to 1 at the tip. `rest` is the squared cosine of the slope on the wall.
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

/// Returns the sine of the slope at `r` as a fraction of the sine on the wall. Its derivative is continuous; at the tip it is 7 / 6 divided
/// by the radius where the wall begins.
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
            assert_eq!([round.height(0.0), round.height(1.0), round.height(2.0)], [1.0, 0.0, 0.0]);
            let heights: Vec<f64> =
                (0..=100).map(|step: i32| round.height(f64::from(step) / 100.0)).collect();
            assert!(heights.is_sorted_by(|a, b| a > b), "{height}");
        }
    }

    /// On a disk of radius 1, the tip of a hill of any height is at most as curved as a sphere of radius 0.6.
    #[test]
    fn the_higher_a_hill_the_steeper_its_wall_and_its_tip_stays_round() {
        let mut steepest = 0.0;
        for height in [0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
            let round = Round::new(height);
            fn z(r: f64, height: f64, round: &Round) -> f64 {
                height * round.height(r)
            }
            let curvature = |r: f64| {
                let (first, second) = (
                    (z(r + 0.01, height, &round) - z(r - 0.01, height, &round)) / 0.02,
                    (z(r + 0.01, height, &round) - 2.0 * z(r, height, &round)
                        + z(r - 0.01, height, &round))
                        / 1e-4,
                );
                -second / ((1.0 + first * first) * (1.0 + first * first).sqrt())
            };
            let most = (2..70).map(|step| curvature(f64::from(step) / 100.0)).fold(0.0, f64::max);
            assert!(most < 1.0 / 0.6, "{height}: {most}");
            let wall = z(0.83, height, &round) - z(0.84, height, &round);
            assert!(wall > steepest);
            steepest = wall;
        }
    }
}
