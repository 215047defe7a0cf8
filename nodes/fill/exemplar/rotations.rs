//! Decides whether exemplars (patches of the input surface) are rotated if the user does not say so.

use super::descriptor::{ANGLES, Rings};
use super::exemplars::Exemplars;
use super::frame::Orientation;

/// Number of rotations in which exemplars are tried if rotation helps.
pub(super) const ROTATIONS: u32 = 12;

/// Maximum numbers of patches that are compared, and of exemplars with which each is compared.
const PROBES: usize = 64;
const CANDIDATES: usize = 1024;

/// Maximum error of the best rotated exemplar, as a multiple of that of the best upright one.
const MAX_RATIO: f64 = 0.9;

/// Maximum error of the best of a sixteenth of the exemplars in 16 rotations, as a multiple of that of the best of all upright exemplars.
/// If the surface has an upward direction, few rotated exemplars are similar to a patch, and the error is larger.
const MAX_EQUAL_RATIO: f64 = 1.1;

/// Returns the number of rotations in which exemplars should be tried. Patches of the data are compared with exemplars that do not overlap
/// them. Rotation is used if it makes the best exemplars better, and if the surface has no upward direction, so that rotated exemplars are
/// as good as upright ones.
pub(super) fn suitable_rotations(exemplars: &Exemplars, radius: f64) -> u32 {
    let straight = Orientation::list(1, false)[0];
    let step = exemplars.len().div_ceil(CANDIDATES).max(1);
    let candidates: Vec<usize> = (0..exemplars.len()).step_by(step).collect();
    let rings: Vec<Rings> = candidates
        .iter()
        .map(|&k| exemplars.polar.rings(exemplars.heights(k as u32), &straight))
        .collect();
    let every = candidates.len().div_ceil(PROBES).max(1);
    let (mut ratios, mut equal_ratios) = (Vec::new(), Vec::new());
    for probe in (0..candidates.len()).step_by(every) {
        let origin = exemplars.frames[candidates[probe]].origin;
        let [mut upright, mut rotated, mut equal] = [f32::INFINITY; 3];
        for (k, other) in rings.iter().enumerate() {
            if (exemplars.frames[candidates[k]].origin - origin).norm() < 2.0 * radius {
                continue;
            }
            upright = upright.min(difference(&rings[probe], other, 0));
            for shift in 0..ANGLES {
                let off = difference(&rings[probe], other, shift);
                rotated = rotated.min(off);
                if k % ANGLES == 0 {
                    equal = equal.min(off);
                }
            }
        }
        if upright.is_finite() && equal.is_finite() && upright > 0.0 {
            ratios.push((rotated / upright).sqrt());
            equal_ratios.push((equal / upright).sqrt());
        }
    }
    let helps = median(ratios).is_some_and(|ratio| f64::from(ratio) <= MAX_RATIO)
        && median(equal_ratios).is_some_and(|ratio| f64::from(ratio) <= MAX_EQUAL_RATIO);
    if helps { ROTATIONS } else { 1 }
}

/// Returns the sum of squared differences of the heights on rings, one of them rotated by `shift` samples.
fn difference(a: &Rings, b: &Rings, shift: usize) -> f32 {
    let rings = a.as_chunks::<ANGLES>().0.iter().zip(b.as_chunks::<ANGLES>().0);
    let squares = rings.map(|(a, b)| {
        let off = (0..ANGLES).map(|k| a[k] - b[(k + shift) % ANGLES]);
        off.map(|off| off * off).sum::<f32>()
    });
    squares.sum()
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}
