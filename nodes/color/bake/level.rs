//! Equalizes captures, and extrapolates colors to texels that no capture shows.

use std::collections::BTreeMap;

use maquette_base::light::channel;
use maquette_base::linear::membrane::Membrane;
use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Progress};
use nalgebra::{DMatrix, DVector};

use super::super::atlas::Texels;
use super::baking::Level;
use super::sample::{MeanColor, Sample, weighted_mean};

/// The data that is used to equalize the colors of texels.
pub(super) struct Leveling<'a> {
    pub(super) texels: &'a Texels,
    /// The vertex at each corner of the mesh's faces.
    pub(super) corners: &'a [u32],
    pub(super) membrane: &'a Membrane,
    /// For each texel, the indices of its samples.
    pub(super) of_texels: &'a Lists,
}

/// Offset added to intensities before their logarithms are taken, so that noise in dark regions has a low weight.
const DARK_OFFSET: f64 = 0.01;

/// Number of texels that are processed between two checks for cancellation.
const BLOCK: usize = 1 << 16;

/// Lengths, as fractions of the diagonal of the mesh's bounding box. `CHANGE` is the distance over which a capture's correction may change
/// where captures overlap; `REACH` is the distance to which the correction extends beyond the overlap.
const CHANGE: f64 = 0.04;
const REACH: f64 = 0.5;

impl Leveling<'_> {
    /// Multiplies the light of all samples by factors that make the captures agree. The first factor is one for each channel of each
    /// capture, as for panoramas (Brown and Lowe, "Automatic panoramic image stitching using invariant features", 2007, equation 29), but
    /// computed from medians of ratios. The second factor changes slowly over the surface, as in Lempitsky and Ivanov, "Seamless mosaicing
    /// of image-based texture maps" (2007), section 4, who add offsets. Here, the second factor draws each capture towards the mean of all
    /// overlapping captures.
    pub(super) fn level(
        &self,
        samples: &mut [Sample],
        captures: usize,
        level: Level,
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        if level == Level::None || captures < 2 {
            return Ok(());
        }
        let gains = self.gains(samples, captures);
        for sample in samples.iter_mut() {
            let gain = gains[sample.capture as usize];
            (0..3).for_each(|k| sample.light[k] *= libm::exp(gain[k]) as f32);
        }
        if level == Level::Exposure {
            return Ok(());
        }
        let mut fields = Vec::with_capacity(captures);
        for capture in 0..captures {
            progress.tick(capture as f64 / captures as f64)?;
            fields.push(self.field(samples, capture as u32, progress)?);
        }
        for sample in samples.iter_mut() {
            let Some(field) = &fields[sample.capture as usize] else { continue };
            let log = self.interpolate(sample.texel as usize, field);
            (0..3).for_each(|k| sample.light[k] *= libm::exp(log[k]) as f32);
        }
        Ok(())
    }

    /// Returns the pairs of samples at each texel.
    fn pairs<'a>(&'a self, samples: &'a [Sample]) -> impl Iterator<Item = [&'a Sample; 2]> {
        (0..self.of_texels.len()).flat_map(move |texel| {
            let own = self.of_texels.list(texel);
            let pairs = own
                .iter()
                .enumerate()
                .flat_map(|(k, &a)| own[k + 1..].iter().map(move |&b| [a, b]));
            pairs.map(|pair| pair.map(|it| &samples[it as usize]))
        })
    }

    /// Returns the root mean square difference, over channels, between captures where they overlap, in levels of 0 to 255. Each pair of
    /// samples at a texel has the weight of the less certain sample.
    pub(super) fn difference(&self, samples: &[Sample]) -> f64 {
        let (mut sum, mut weight) = (0.0, 0.0);
        for [a, b] in self.pairs(samples) {
            let sure = f64::from(a.sure.min(b.sure));
            for k in 0..3 {
                let step = channel(f64::from(a.light[k])) - channel(f64::from(b.light[k]));
                sum += sure * step * step;
                weight += sure;
            }
        }
        if weight > 0.0 { (sum / weight).sqrt() } else { 0.0 }
    }

    /// Returns, for each channel of each capture, the logarithm of the factor that equalizes it. For each channel, the sum of the
    /// logarithms over all captures is 0.
    fn gains(&self, samples: &[Sample], captures: usize) -> Vec<[f64; 3]> {
        let mut ratios: BTreeMap<[u32; 2], Vec<(f64, [f64; 3])>> = BTreeMap::new();
        for [a, b] in self.pairs(samples) {
            let ratio = [0, 1, 2].map(|k| log(f64::from(b.light[k])) - log(f64::from(a.light[k])));
            ratios
                .entry([a.capture, b.capture])
                .or_default()
                .push((f64::from(a.sure.min(b.sure)), ratio));
        }
        let mut gains = vec![[0.0; 3]; captures];
        for k in 0..3 {
            // A weak spring pulls the factors to 1; captures without overlap therefore do not change.
            let mut matrix = DMatrix::identity(captures, captures) * 1e-6;
            let mut right = DVector::zeros(captures);
            for (pair, all) in &ratios {
                let (median, weight) = weighted_median(all.iter().map(|it| (it.1[k], it.0)));
                let [a, b] = pair.map(|it| it as usize);
                matrix[(a, a)] += weight;
                matrix[(b, b)] += weight;
                matrix[(a, b)] -= weight;
                matrix[(b, a)] -= weight;
                right[a] += weight * median;
                right[b] -= weight * median;
            }
            if let Some(found) = matrix.cholesky().map(|it| it.solve(&right)) {
                gains.iter_mut().zip(found.iter()).for_each(|(gain, &found)| gain[k] = found);
            }
        }
        gains
    }

    /// Returns the logarithm of a capture's slowly changing factor at each vertex, for each channel.
    fn field(
        &self,
        samples: &[Sample],
        capture: u32,
        progress: &Progress<'_>,
    ) -> Result<Option<Vec<[f64; 3]>>, CancelledError> {
        let count = self.membrane.areas.len();
        let (mut sums, mut weights, mut texels) =
            (vec![[0.0; 3]; count], vec![0.0; count], vec![0.0; count]);
        for texel in 0..self.of_texels.len() {
            if texel.is_multiple_of(BLOCK) {
                progress.check()?;
            }
            let shares = self.shares(texel);
            shares.iter().for_each(|(vertex, share)| texels[*vertex] += share);
            let all = self.of_texels.list(texel);
            let own = all.iter().map(|&it| &samples[it as usize]).find(|it| it.capture == capture);
            let Some(own) = own.filter(|_| 1 < all.len()) else { continue };
            let others =
                all.iter().map(|&it| &samples[it as usize]).filter(|it| it.capture != capture);
            let sure =
                f64::from(own.sure) * others.map(|it| f64::from(it.sure)).fold(0.0, f64::max);
            let mixed = weighted_mean(all.iter().map(|&it| &samples[it as usize]));
            let apart = [0, 1, 2].map(|k| log(mixed.light[k]) - log(f64::from(own.light[k])));
            for (vertex, share) in shares {
                let weight = share * sure;
                weights[vertex] += weight;
                (0..3).for_each(|k| sums[vertex][k] += weight * apart[k]);
            }
        }
        let [change, reach] = [CHANGE, REACH].map(|it| it * self.membrane.extent);
        let (mut springs, mut values) = (vec![0.0; count], vec![[0.0; 3]; count]);
        for vertex in 0..count {
            let area = self.membrane.areas[vertex];
            let known = if texels[vertex] > 0.0 { weights[vertex] / texels[vertex] } else { 0.0 };
            let [strong, weak] = [area * known / (change * change), area / (reach * reach)];
            springs[vertex] = strong + weak;
            if weights[vertex] > 0.0 && springs[vertex] > 0.0 {
                values[vertex] =
                    sums[vertex].map(|sum| sum / weights[vertex] * strong / springs[vertex]);
            }
        }
        self.membrane.solve(&springs, &values, progress)
    }

    /// Returns a color for each texel. Unseen texels get the values of a membrane over the surface that is fixed at the seen texels.
    pub(super) fn fill(
        &self,
        mixed: &[MeanColor],
        progress: &Progress<'_>,
    ) -> Result<Vec<[f64; 3]>, CancelledError> {
        let count = self.membrane.areas.len();
        let (mut sums, mut weights, mut texels) =
            (vec![[0.0; 3]; count], vec![0.0; count], vec![0.0; count]);
        let (mut mean, mut all) = ([0.0; 3], 0.0);
        for (texel, seen) in mixed.iter().enumerate() {
            if texel.is_multiple_of(BLOCK) {
                progress.check()?;
            }
            all += seen.sure;
            (0..3).for_each(|k| mean[k] += seen.sure * seen.light[k]);
            for (vertex, share) in self.shares(texel) {
                texels[vertex] += share;
                weights[vertex] += share * seen.sure;
                (0..3).for_each(|k| sums[vertex][k] += share * seen.sure * seen.light[k]);
            }
        }
        let mean = mean.map(|sum| sum / all);
        // A connected part without any sample gets the mean color of all samples.
        let (mut springs, mut values) = (vec![1e-9; count], vec![mean; count]);
        for vertex in 0..count {
            if weights[vertex] > 0.0 {
                springs[vertex] += HOLD * weights[vertex] / texels[vertex];
                values[vertex] = sums[vertex].map(|sum| sum / weights[vertex]);
            }
        }
        let values = self.membrane.solve(&springs, &values, progress)?.unwrap_or(values);
        Ok((0..mixed.len()).map(|texel| self.interpolate(texel, &values)).collect())
    }

    /// Returns the vertices of a texel's triangle, and their weights.
    fn shares(&self, texel: usize) -> [(usize, f64); 3] {
        let texel = &self.texels.texels[texel];
        let triangle = self.texels.triangles[texel.triangle as usize];
        let shares = texel.shares();
        [0, 1, 2].map(|k| (self.corners[triangle[k] as usize] as usize, shares[k]))
    }

    fn interpolate(&self, texel: usize, values: &[[f64; 3]]) -> [f64; 3] {
        let shares = self.shares(texel);
        [0, 1, 2].map(|k| shares.iter().map(|(vertex, share)| values[*vertex][k] * share).sum())
    }
}

/// Stiffness of the springs that pull a vertex to the captured color if all texels around the vertex are seen. For comparison, the edges of
/// the membrane have a stiffness of about 1.
const HOLD: f64 = 10.0;

fn log(light: f64) -> f64 {
    libm::log(light.max(0.0) + DARK_OFFSET)
}

/// Returns the weighted median of pairs of weight and value, and the sum of the weights.
fn weighted_median(values: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    let mut sorted = Vec::from_iter(values);
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = sorted.iter().map(|it| it.1).sum();
    let mut below = 0.0;
    for (value, weight) in &sorted {
        below += weight;
        if all <= 2.0 * below {
            return (*value, all);
        }
    }
    (0.0, 0.0)
}
