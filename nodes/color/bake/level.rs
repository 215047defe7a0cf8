//! Captures that are made equal, and colors for what none of them shows.

use std::collections::BTreeMap;

use maquette_base::topology::lists::Lists;
use maquette_node::{Cancelled, Progress};
use nalgebra::{DMatrix, DVector};

use super::super::atlas::Texels;
use super::super::light::channel;
use super::baking::Level;
use super::membrane::Membrane;
use super::sample::{Mixed, Sample, mix};

/// What the colors of texels are leveled with.
pub(super) struct Leveled<'a> {
    pub(super) texels: &'a Texels,
    /// The vertices at all corners.
    pub(super) corners: &'a [u32],
    pub(super) membrane: &'a Membrane,
    /// The samples of each texel.
    pub(super) of_texels: &'a Lists,
}

/// Light that is added before logarithms are taken, so that noise in the dark counts little.
const DARK: f64 = 0.01;

/// Texels that are looked at before the evaluation may stop.
const BLOCK: usize = 1 << 16;

/// Lengths, as shares of the mesh's diagonal: how fast a correction may change where captures overlap, and how far it reaches beyond.
const CHANGE: f64 = 0.04;
const REACH: f64 = 0.5;

impl Leveled<'_> {
    /// Multiplies the light of all samples so that captures agree: first by a factor for each channel of each capture, as Agarwala et al.
    /// and others do for panoramas (Brown and Lowe, "Automatic panoramic image stitching using invariant features", 2007, equation 29),
    /// here by medians of ratios; then by one that changes slowly over the surface, as Lempitsky and Ivanov, "Seamless mosaicing of
    /// image-based texture maps" (2007), section 4, but of factors, and towards the mean of all that overlap.
    pub(super) fn level(
        &self,
        samples: &mut [Sample],
        captures: usize,
        level: Level,
        progress: &Progress<'_>,
    ) -> Result<(), Cancelled> {
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
            let log = self.at(sample.texel as usize, field);
            (0..3).for_each(|k| sample.light[k] *= libm::exp(log[k]) as f32);
        }
        Ok(())
    }

    /// The pairs of samples at each texel.
    fn pairs<'a>(&'a self, samples: &'a [Sample]) -> impl Iterator<Item = [&'a Sample; 2]> {
        (0..self.of_texels.len()).flat_map(move |texel| {
            let own = self.of_texels.of(texel);
            let pairs = own
                .iter()
                .enumerate()
                .flat_map(|(k, &a)| own[k + 1..].iter().map(move |&b| [a, b]));
            pairs.map(|pair| pair.map(|it| &samples[it as usize]))
        })
    }

    /// How much captures differ where they overlap, as root mean square over channels, in levels; each texel counts as the less sure one
    /// is.
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

    /// The logarithm of the factor of each channel of each capture; their sum is 0.
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
            // Held a little to 1, so that captures which overlap with none stay.
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

    /// The logarithm of a capture's factor at each vertex.
    fn field(
        &self,
        samples: &[Sample],
        capture: u32,
        progress: &Progress<'_>,
    ) -> Result<Option<Vec<[f64; 3]>>, Cancelled> {
        let count = self.membrane.areas.len();
        let (mut sums, mut weights, mut texels) =
            (vec![[0.0; 3]; count], vec![0.0; count], vec![0.0; count]);
        for texel in 0..self.of_texels.len() {
            if texel.is_multiple_of(BLOCK) {
                progress.check()?;
            }
            let shares = self.shares(texel);
            shares.iter().for_each(|(vertex, share)| texels[*vertex] += share);
            let all = self.of_texels.of(texel);
            let own = all.iter().map(|&it| &samples[it as usize]).find(|it| it.capture == capture);
            let Some(own) = own.filter(|_| 1 < all.len()) else { continue };
            let others =
                all.iter().map(|&it| &samples[it as usize]).filter(|it| it.capture != capture);
            let sure =
                f64::from(own.sure) * others.map(|it| f64::from(it.sure)).fold(0.0, f64::max);
            let mixed = mix(all.iter().map(|&it| &samples[it as usize]));
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

    /// A color for each texel, from those that are seen, over the surface: a membrane that is held where something is seen.
    pub(super) fn fill(
        &self,
        mixed: &[Mixed],
        progress: &Progress<'_>,
    ) -> Result<Vec<[f64; 3]>, Cancelled> {
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
        // A part of which nothing is seen gets the mean of all.
        let (mut springs, mut values) = (vec![1e-9; count], vec![mean; count]);
        for vertex in 0..count {
            if weights[vertex] > 0.0 {
                springs[vertex] += HOLD * weights[vertex] / texels[vertex];
                values[vertex] = sums[vertex].map(|sum| sum / weights[vertex]);
            }
        }
        let values = self.membrane.solve(&springs, &values, progress)?.unwrap_or(values);
        Ok((0..mixed.len()).map(|texel| self.at(texel, &values)).collect())
    }

    /// The vertices of a texel's triangle, and how far each weighs.
    fn shares(&self, texel: usize) -> [(usize, f64); 3] {
        let texel = &self.texels.texels[texel];
        let triangle = self.texels.triangles[texel.triangle as usize];
        let shares = texel.shares();
        [0, 1, 2].map(|k| (self.corners[triangle[k] as usize] as usize, shares[k]))
    }

    fn at(&self, texel: usize, values: &[[f64; 3]]) -> [f64; 3] {
        let shares = self.shares(texel);
        [0, 1, 2].map(|k| shares.iter().map(|(vertex, share)| values[*vertex][k] * share).sum())
    }
}

/// How strongly a membrane is held where all is seen; its edges pull with about 1.
const HOLD: f64 = 10.0;

fn log(light: f64) -> f64 {
    libm::log(light.max(0.0) + DARK)
}

/// The value with half of the weight below it, and the weight of all.
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
