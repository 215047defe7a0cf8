//! Profiles of an offset: the fraction of the offset by which each point of a net moves, from the center of the free points to the fixed
//! points.

use maquette_base::linear::laplace;
use maquette_node::{Error, Progress, bail};
use maquette_value as value;
use maquette_value::Field;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::round::Round;

/// The profile of an offset. `d` is 0 at fixed points and 1 at the innermost point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Profile {
    /// A dome if the offset is small, a finger if it is large: the roundness of its tip and the steepness of its wall follow from the
    /// offset's distance and the width of the free part, and it is tangent to the border.
    #[default]
    Round,
    /// A smooth hill: `(1 - cos(pi d)) / 2`. A higher one is more pointed.
    Cosine,
    /// All free points move by the whole offset, which makes a cliff at the border. Points within a cell of it move by a fraction, so that
    /// the cliff follows the outline and not the cells.
    Plateau,
    /// `d` to the power of this number: 1 is about a cone, below 1 blunt, above 1 pointed.
    Power(#[schemars(range(min = 0.0, max = 100.0))] f64),
    /// A bell of this width: `exp(-(1 - d)^2 / (2 width^2))`.
    Gaussian(#[schemars(range(min = 0.001, max = 100.0))] f64),
    /// The gray levels of the port `picture`, stretched over the net; the minimum is 0 and the maximum 1.
    Picture,
}

/// The error message if the profile needs a picture and none is linked.
pub(crate) const NO_PICTURE: &str = "the profile `Picture` needs a field at the port `picture`";

impl Profile {
    /// Returns true if the profile rises from the border to the innermost point.
    pub(crate) fn is_hill(self) -> bool {
        !matches!(self, Self::Plateau | Self::Picture)
    }

    /// Returns the factor of the offset, whose length is `distance`, for each point of a net, row by row. `free` is 1 for each point that
    /// moves, 0 for a fixed point. `depths` is the distance of each point from the line at which the factor is 0, in points of the net; if
    /// it is unknown, the line passes through the fixed points.
    pub(crate) fn factors(
        self,
        net: &value::ControlNet,
        free: &[u8],
        depths: Option<&[f64]>,
        distance: f64,
        picture: Option<&Field>,
        progress: &Progress<'_>,
    ) -> Result<Vec<f64>, Error> {
        let falloff: Box<dyn Fn(f64) -> f64> = match self {
            Self::Plateau => {
                return Ok(match depths {
                    Some(depths) => depths.iter().map(|depth| depth.clamp(0.0, 1.0)).collect(),
                    None => vec![1.0; free.len()],
                });
            }
            Self::Picture => {
                let picture = picture.ok_or_else(|| Error::new(NO_PICTURE))?;
                return gray(picture, net.rows(), net.columns()).ok_or_else(|| {
                    Error::new("the field at the port `picture` has no finite number")
                });
            }
            Self::Round => {
                let round = Round::new(distance / radius(net, free));
                Box::new(move |d| round.height(1.0 - d))
            }
            Self::Cosine => Box::new(|d| (1.0 - libm::cos(std::f64::consts::PI * d)) / 2.0),
            Self::Power(power) if power >= 0.0 => Box::new(move |d| libm::pow(d, power)),
            Self::Gaussian(width) if width > 0.0 => {
                Box::new(move |d| libm::exp(-(1.0 - d) * (1.0 - d) / (2.0 * width * width)))
            }
            Self::Power(number) => {
                bail!("the profile's number is {number}; it must be 0 or more")
            }
            Self::Gaussian(number) => {
                bail!("the profile's number is {number}; it must be more than 0")
            }
        };
        let inwardness = inwardness(net.rows(), net.columns(), free, depths, progress)?;
        let mut factors: Vec<f64> = inwardness.into_iter().map(falloff).collect();
        if matches!(self, Self::Round | Self::Cosine | Self::Gaussian(_)) {
            blunt(net, free, &mut factors);
        }
        Ok(factors)
    }
}

/// If the net has a pole, gives the ring around it the factor of the pole; otherwise a smooth hill would have a sharp tip at the pole. A
/// net has a pole if the points of its first row coincide before any offset.
fn blunt(net: &value::ControlNet, free: &[u8], factors: &mut [f64]) {
    let columns = net.columns();
    let pole = &net.base()[..columns];
    let lies_in_one_place = columns > 1 && pole.iter().all(|point| *point == pole[0]);
    let moves = net.rows() > 2 && free[..2 * columns].iter().all(|&free| free == 1);
    if lies_in_one_place && moves && free.contains(&0) {
        factors.copy_within(..columns, columns);
    }
}

/// Returns the radius of the disk that has the area of the net's free part before any offset. A quad with only some free points counts by
/// their fraction.
fn radius(net: &value::ControlNet, free: &[u8]) -> f64 {
    let (columns, base) = (net.columns(), net.base());
    let quads = (0..net.rows().saturating_sub(1) * columns).filter(|at| at % columns + 1 < columns);
    (quads
        .map(|at: usize| {
            let corners = [at, at + 1, at + columns + 1, at + columns];
            let [a, b, c, d] = corners.map(|corner| base[corner]);
            let share = corners.iter().map(|&corner| f64::from(free[corner])).sum::<f64>() / 4.0;
            share * (c - a).cross(&(d - b)).norm() / 2.0
        })
        .sum::<f64>()
        / std::f64::consts::PI)
        .sqrt()
}

/// Returns the `d` of `Profile` for each point: 0 at fixed points, 1 at the innermost free point. If no point is fixed, the net's border
/// counts as fixed.
///
/// `d = 1 - sqrt(1 - h / max h)`, where `h` solves `Laplace h = -1` at the free points of the index grid and is 0 at the others, or where
/// `depths` is 0. On a disk, `d` is exactly the distance from the border; on other shapes it lacks the ridges of that distance.
fn inwardness(
    rows: usize,
    columns: usize,
    free: &[u8],
    depths: Option<&[f64]>,
    progress: &Progress<'_>,
) -> Result<Vec<f64>, Error> {
    fn border(at: usize, columns: usize, rows: usize) -> bool {
        let (row, column) = (at / columns, at % columns);
        row == 0 || row + 1 == rows || column == 0 || column + 1 == columns
    }
    let mut free = free.to_vec();
    if !free.contains(&0) {
        (0..free.len()).filter(|&at| border(at, columns, rows)).for_each(|at| free[at] = 0);
    }
    let mut heights = vec![0.0; free.len()];
    laplace::solve_to_border(
        columns,
        rows,
        &free,
        1.0,
        |cell, fixed| depths.map_or(1.0, |depths| border_distance(depths[cell], depths[fixed])),
        &mut heights,
        progress,
    )?;
    let highest = heights.iter().copied().fold(0.0, f64::max);
    if highest == 0.0 {
        return Ok(heights);
    }
    // Rounding may leave a height slightly below 0 or above the maximum.
    Ok(heights
        .into_iter()
        .map(|height: f64| 1.0 - (1.0 - (height / highest).clamp(0.0, 1.0)).sqrt())
        .collect())
}

/// The limits of the distance of a free point from the border, towards a fixed point, in points of the net.
const BORDER_DISTANCES: [f64; 2] = [0.1, 2.0];

/// Returns the distance from a free point of depth `free` to the place of depth 0, in the direction of the next point, which is fixed and
/// has the depth `fixed`.
fn border_distance(free: f64, fixed: f64) -> f64 {
    let [min, max] = BORDER_DISTANCES;
    if free > fixed { (free / (free - fixed)).clamp(min, max) } else { 1.0 }
}

/// Stretches a field over a net: its corners are at the net's corners, and values between its pixels are interpolated bilinearly. The
/// values are scaled to a minimum of 0 and a maximum of 1. Values that are not finite count as the minimum; a constant field is 1. Returns
/// `None` if no value is finite.
fn gray(field: &Field, rows: usize, columns: usize) -> Option<Vec<f64>> {
    let (least, greatest) = field.range()?;
    let (least, span) = (f64::from(least), f64::from(greatest) - f64::from(least));
    fn level(row: usize, column: usize, least: f64, span: f64, field: &Field) -> f64 {
        let number = f64::from(field.pixels()[row * field.width() + column]);
        match (number.is_finite(), span > 0.0) {
            (false, _) => 0.0,
            (true, false) => 1.0,
            (true, true) => (number - least) / span,
        }
    }
    // Returns the indices of the two pixels between which line `k` of the net is, and the interpolation weight of the second pixel.
    fn place(k: usize, count: usize, size: usize) -> (usize, usize, f64) {
        let at = (size - 1) as f64 * (k as f64 / (count - 1).max(1) as f64);
        let before = (at as usize).min(size - 1);
        (before, (before + 1).min(size - 1), at - before as f64)
    }
    let mut levels = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        let (top, bottom, t) = place(row, rows, field.height());
        for column in 0..columns {
            let (left, right, s) = place(column, columns, field.width());
            let [above, below] = [top, bottom].map(|y| {
                level(y, left, least, span, field) * (1.0 - s)
                    + level(y, right, least, span, field) * s
            });
            levels.push(above * (1.0 - t) + below * t);
        }
    }
    Some(levels)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    fn net(rows: usize, columns: usize) -> value::ControlNet {
        value::ControlNet::new(rows, columns, vec![Point3::origin(); rows * columns]).unwrap()
    }

    #[test]
    fn on_a_disk_the_profile_is_the_distance_from_the_rim() {
        let radius = 20.0;
        fn from_center(at: usize) -> f64 {
            let (x, y) = ((at % 43) as f64 - 21.0, (at / 43) as f64 - 21.0);
            (x * x + y * y).sqrt()
        }
        let free: Vec<u8> = (0..43 * 43).map(|at| u8::from(from_center(at) < radius)).collect();
        let cone = Profile::Power(1.0)
            .factors(&net(43, 43), &free, None, 1.0, None, &Progress::silent())
            .unwrap();
        for (at, d) in cone.iter().enumerate() {
            let exact = (1.0 - from_center(at) / radius).max(0.0);
            assert!((d - exact).abs() <= 0.03, "{at}: {d} {exact}");
        }
    }

    #[test]
    fn a_border_between_points_gives_a_profile_without_steps() {
        let radius = 9.3;
        fn from_center(at: usize) -> f64 {
            let (x, y) = ((at % 25) as f64 - 12.2, (at / 25) as f64 - 11.9);
            (x * x + y * y).sqrt()
        }
        let depths: Vec<f64> = (0..25 * 25).map(|at| radius - from_center(at)).collect();
        let free: Vec<u8> = depths.iter().map(|&depth| u8::from(depth > 0.0)).collect();
        let largest_error = |depths: Option<&[f64]>| {
            let cone = Profile::Power(1.0)
                .factors(&net(25, 25), &free, depths, 1.0, None, &Progress::silent())
                .unwrap();
            let exact = (0..625).map(|at| (1.0 - from_center(at) / radius).max(0.0));
            cone.iter().zip(exact).map(|(d, exact)| (d - exact).abs()).fold(0.0, f64::max)
        };
        let (fine, coarse) = (largest_error(Some(&depths)), largest_error(None));
        assert!(fine <= 0.03 && coarse >= 0.05, "{fine} {coarse}");
    }

    #[test]
    fn profiles_rise_from_the_border_to_one() {
        let mut free = vec![0; 25];
        [6, 7, 8, 11, 12, 13, 16, 17, 18].into_iter().for_each(|at| free[at] = 1);
        fn factors(profile: Profile, free: &[u8]) -> Vec<f64> {
            profile.factors(&net(5, 5), free, None, 1.0, None, &Progress::silent()).unwrap()
        }
        for profile in [Profile::Cosine, Profile::Power(2.0)] {
            let factors = factors(profile, &free);
            assert_eq!(factors[0], 0.0);
            assert!((factors[12] - 1.0).abs() <= 1e-6);
            assert!(0.0 < factors[6] && factors[6] < factors[7] && factors[7] < factors[12]);
        }
        assert!((factors(Profile::Gaussian(0.5), &free)[0] - libm::exp(-2.0)).abs() <= 1e-15);
        assert_eq!(factors(Profile::Plateau, &free), [1.0; 25]);
        // Without a fixed point, the border of the net is the border of the profile.
        assert_eq!(
            Profile::Cosine
                .factors(&net(5, 5), &[1; 25], None, 1.0, None, &Progress::silent())
                .unwrap(),
            factors(Profile::Cosine, &free)
        );
        assert_eq!(
            Profile::Cosine
                .factors(&net(2, 2), &[1; 4], None, 1.0, None, &Progress::silent())
                .unwrap(),
            [0.0; 4]
        );
    }

    #[test]
    fn a_smooth_hill_has_no_tip_at_a_pole() {
        let net = value::ControlNet::new(
            5,
            6,
            (0..30)
                .map(|at: usize| Point3::new((at / 6) as f64, ((at / 6) * (at % 6)) as f64, 0.0))
                .collect::<Vec<_>>(),
        )
        .unwrap();
        let free: Vec<u8> = (0..30).map(|at| u8::from(at < 24)).collect();
        let factors = |profile: Profile| {
            profile.factors(&net, &free, None, 1.0, None, &Progress::silent()).unwrap()
        };
        for profile in [Profile::Cosine, Profile::Gaussian(0.5)] {
            let factors = factors(profile);
            assert_eq!(factors[..6], factors[6..12]);
            assert!(factors[12] < factors[6] && factors[24] < factors[18]);
        }
        assert!(factors(Profile::Power(1.0))[6] < 0.8);
    }

    #[test]
    fn a_picture_is_laid_over_the_net() {
        fn stretch_over(
            pixels: Vec<f32>,
            width: usize,
            rows: usize,
            columns: usize,
        ) -> Result<Vec<f64>, Error> {
            let picture = Field::new(width, pixels.len() / width, pixels).unwrap();
            Profile::Picture.factors(
                &net(rows, columns),
                &vec![1; rows * columns],
                None,
                1.0,
                Some(&picture),
                &Progress::silent(),
            )
        }
        let levels = stretch_over(vec![10.0, 30.0, 10.0, 50.0], 2, 3, 3).unwrap();
        assert_eq!(levels, [0.0, 0.25, 0.5, 0.0, 0.375, 0.75, 0.0, 0.5, 1.0]);
        assert_eq!(stretch_over(vec![7.0; 4], 2, 1, 2).unwrap(), [1.0, 1.0]);
        assert_eq!(stretch_over(vec![f32::NAN, 1.0, 2.0], 3, 1, 3).unwrap(), [0.0, 0.0, 1.0]);
        let error = stretch_over(vec![f32::NAN], 1, 1, 1).unwrap_err();
        let empty_picture = "the field at the port `picture` has no finite number";
        assert_eq!(error.to_string(), empty_picture);
        let error =
            Profile::Picture.factors(&net(1, 1), &[1], None, 1.0, None, &Progress::silent());
        assert_eq!(error.unwrap_err().to_string(), NO_PICTURE);
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        for profile in [Profile::Power(-1.0), Profile::Power(f64::NAN), Profile::Gaussian(0.0)] {
            let refused =
                profile.factors(&net(3, 3), &[1; 9], None, 1.0, None, &Progress::silent());
            let refused = refused.unwrap_err().to_string();
            assert!(refused.starts_with("the profile's number is"), "{profile:?}: {refused}");
        }
    }
}
