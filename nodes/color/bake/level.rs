//! Equalizes captures, and extrapolates colors to texels that no capture shows.

use std::collections::BTreeMap;
use std::ops::Range;

use maquette_base::light::channel;
use maquette_base::linear::membrane::Membrane;
use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Progress};
use maquette_value::KeyChunks;
use maquette_value::parallel::*;
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
    /// The texels at the vertices.
    pub(super) chunks: &'a KeyChunks,
}

/// Sums over the texels around a vertex, each texel weighted by the vertex's share in it.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// The sum of the values times their weights.
    values: [f64; 3],
    weight: f64,
    /// The number of texels, whether or not they have a value.
    texels: f64,
}

impl Sums {
    fn add(&mut self, share: f64, value: Option<(f64, [f64; 3])>) {
        self.texels += share;
        if let Some((weight, value)) = value {
            self.weight += share * weight;
            (0..3).for_each(|k| self.values[k] += share * weight * value[k]);
        }
    }
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
        let gains: Vec<[f32; 3]> = self
            .gains(samples, captures)
            .into_iter()
            .map(|gain| gain.map(|log| libm::exp(log) as f32))
            .collect();
        samples.par_iter_mut().with_min_len(4096).for_each(|sample| {
            let gain = gains[sample.capture as usize];
            (0..3).for_each(|k| sample.light[k] *= gain[k]);
        });
        if level == Level::Exposure {
            return Ok(());
        }
        let mut fields = Vec::with_capacity(captures);
        for capture in 0..captures {
            progress.tick(capture as f64 / captures as f64)?;
            fields.push(self.field(samples, capture as u32, progress)?);
        }
        samples.par_iter_mut().with_min_len(1024).for_each(|sample| {
            let Some(field) = &fields[sample.capture as usize] else { return };
            let log = self.interpolate(sample.texel as usize, field);
            (0..3).for_each(|k| sample.light[k] *= libm::exp(log[k]) as f32);
        });
        Ok(())
    }

    /// Returns `f` of each pair of samples at each of some texels, in order.
    fn map_pairs<T: Send>(
        &self,
        texels: Range<usize>,
        samples: &[Sample],
        f: fn(&Sample, &Sample) -> T,
    ) -> Vec<T> {
        let texels = texels.into_par_iter().with_min_len(1024);
        texels
            .flat_map_iter(|texel| {
                let own = self.of_texels.list(texel);
                (1..).zip(own).flat_map(move |(next, &a)| {
                    let others = own[next..].iter();
                    others.map(move |&b| f(&samples[a as usize], &samples[b as usize]))
                })
            })
            .collect()
    }

    /// Returns the root mean square difference, over channels, between captures where they overlap, in levels of 0 to 255. Each pair of
    /// samples at a texel has the weight of the less certain sample.
    pub(super) fn difference(&self, samples: &[Sample]) -> f64 {
        fn steps(a: &Sample, b: &Sample) -> (f64, [f64; 3]) {
            let steps =
                [0, 1, 2].map(|k| channel(f64::from(a.light[k])) - channel(f64::from(b.light[k])));
            (f64::from(a.sure.min(b.sure)), steps)
        }
        let (mut sum, mut weight) = (0.0, 0.0);
        let count = self.of_texels.len();
        for first in (0..count).step_by(BLOCK) {
            let block = first..count.min(first + BLOCK);
            for (sure, steps) in self.map_pairs(block, samples, steps) {
                for step in steps {
                    sum += sure * step * step;
                    weight += sure;
                }
            }
        }
        if weight > 0.0 { (sum / weight).sqrt() } else { 0.0 }
    }

    /// Returns, for each channel of each capture, the logarithm of the factor that equalizes it. For each channel, the sum of the
    /// logarithms over all captures is 0.
    fn gains(&self, samples: &[Sample], captures: usize) -> Vec<[f64; 3]> {
        let mut ratios: BTreeMap<[u32; 2], Vec<(f64, [f64; 3])>> = BTreeMap::new();
        fn ratio(a: &Sample, b: &Sample) -> ([u32; 2], (f64, [f64; 3])) {
            let ratio = [0, 1, 2].map(|k| log(f64::from(b.light[k])) - log(f64::from(a.light[k])));
            ([a.capture, b.capture], (f64::from(a.sure.min(b.sure)), ratio))
        }
        for (pair, ratio) in self.map_pairs(0..self.of_texels.len(), samples, ratio) {
            ratios.entry(pair).or_default().push(ratio);
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
        let sums = self.sums_of_vertices(progress, |texel| {
            let all = self.of_texels.list(texel);
            let own = all.iter().map(|&it| &samples[it as usize]).find(|it| it.capture == capture);
            let own = own.filter(|_| 1 < all.len())?;
            let others =
                all.iter().map(|&it| &samples[it as usize]).filter(|it| it.capture != capture);
            let sure =
                f64::from(own.sure) * others.map(|it| f64::from(it.sure)).fold(0.0, f64::max);
            let mixed = weighted_mean(all.iter().map(|&it| &samples[it as usize]));
            let apart = [0, 1, 2].map(|k| log(mixed.light[k]) - log(f64::from(own.light[k])));
            Some((sure, apart))
        })?;
        let [change, reach] = [CHANGE, REACH].map(|it| it * self.membrane.extent);
        let (mut springs, mut values) = (vec![0.0; count], vec![[0.0; 3]; count]);
        for vertex in 0..count {
            let area = self.membrane.areas[vertex];
            let Sums { values: sums, weight, texels } = sums[vertex];
            let known = if texels > 0.0 { weight / texels } else { 0.0 };
            let [strong, weak] = [area * known / (change * change), area / (reach * reach)];
            springs[vertex] = strong + weak;
            if weight > 0.0 && springs[vertex] > 0.0 {
                values[vertex] = sums.map(|sum| sum / weight * strong / springs[vertex]);
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
        let (mut mean, mut all) = ([0.0; 3], 0.0);
        for seen in mixed {
            all += seen.sure;
            (0..3).for_each(|k| mean[k] += seen.sure * seen.light[k]);
        }
        let sums =
            self.sums_of_vertices(progress, |texel| Some((mixed[texel].sure, mixed[texel].light)))?;
        let mean = mean.map(|sum| sum / all);
        // A connected part without any sample gets the mean color of all samples.
        let (mut springs, mut values) = (vec![1e-9; count], vec![mean; count]);
        for vertex in 0..count {
            let Sums { values: sums, weight, texels } = sums[vertex];
            if weight > 0.0 {
                springs[vertex] += HOLD * weight / texels;
                values[vertex] = sums.map(|sum| sum / weight);
            }
        }
        let values = self.membrane.solve(&springs, &values, progress)?.unwrap_or(values);
        let texels = (0..mixed.len()).into_par_iter().with_min_len(4096);
        Ok(texels.map(|texel| self.interpolate(texel, &values)).collect())
    }

    /// Sums weights and values of texels at the vertices of their triangles. `value` returns the weight and the value of a texel; `None`
    /// if it has none. The sums of a vertex have the order of the texels.
    fn sums_of_vertices(
        &self,
        progress: &Progress<'_>,
        value: impl Fn(usize) -> Option<(f64, [f64; 3])> + Sync,
    ) -> Result<Vec<Sums>, CancelledError> {
        let mut sums = vec![Sums::default(); self.membrane.areas.len()];
        let value = &value;
        let parts = sums.par_chunks_mut(self.chunks.chunk_len()).enumerate();
        let summed = parts.map(|(chunk, sums): (usize, &mut [Sums])| {
            progress.check()?;
            let first = self.chunks.keys(chunk).start;
            self.chunks.for_each_source(chunk, |texel| {
                let value = value(texel);
                for (vertex, share) in self.shares(texel) {
                    if let Some(sums) = sums.get_mut(vertex.wrapping_sub(first)) {
                        sums.add(share, value);
                    }
                }
            });
            Ok(())
        });
        let _: Vec<()> = summed.collect::<Result<_, CancelledError>>()?;
        Ok(sums)
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
    let values = Vec::from_iter(values);
    // Equal values keep their order.
    let mut order: Vec<(i64, u32)> =
        values.iter().zip(0..).map(|(it, index)| (order_bits(it.0), index)).collect();
    order.par_sort_unstable();
    let sorted: Vec<_> = order.par_iter().map(|&(_, index)| values[index as usize]).collect();
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

/// Returns an integer that has the order of `f64::total_cmp`.
fn order_bits(x: f64) -> i64 {
    let bits = x.to_bits().cast_signed();
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}
