//! Finds the exemplar (a patch of the input surface) that is most similar to a patch of the fill.
//!
//! The candidates for a patch are the exemplars with the most similar descriptors, those next to the matches of adjacent patches, the
//! previous match, and random exemplars near the best one. The random search is that of Barnes, Shechtman, Finkelstein and Goldman,
//! "PatchMatch" (2009), here for all patches at once. In full searches, the patches with the worst matches are compared with all exemplars.

use std::ops::Range;

use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, widest};
use nalgebra::{Point3, Vector3};

use super::best_match::Match;
use super::compare::PatchSamples;
use super::exemplars::Exemplars;
use super::frame::Frame;
use super::heights::{LANES, NODES, Sample, View, sample};
use super::orientations::Orientations;
use super::patches::Patches;
use super::surface::{NONE, Surface};
use super::tints::{Color, PART, Tint};

/// A position near which to try exemplars: an input vertex near it, the position itself, and an orientation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hint {
    pub(super) from: u32,
    pub(super) to: Point3<f64>,
    pub(super) orientation: u8,
}

/// The positions, normals and frames of all patches in one iteration.
pub(super) struct Scene<'a> {
    pub(super) points: &'a [Point3<f64>],
    /// The normals of all samples.
    pub(super) normals: &'a [Vector3<f64>],
    /// The frames of the patches.
    pub(super) frames: &'a [Frame],
}

/// The inputs of a search that are the same in all iterations of a level.
pub(super) struct Search<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) data: &'a [Point3<f64>],
    /// The colors of all vertices; empty if colors are not compared.
    pub(super) colors: &'a [Color],
    pub(super) patches: &'a Patches,
    pub(super) exemplars: &'a Exemplars,
    pub(super) orientations: &'a Orientations,
    pub(super) radius: f64,
    /// Seed of the random positions, different on each level.
    pub(super) seed: u64,
}

/// The number of candidates from the k-d tree of descriptors, over all orientations.
const FROM_TREE: usize = 16;

/// The number of random candidates. Each candidate is half as far from the best match as the previous one.
const RANDOM: u64 = 4;

/// Buffers for the search of one patch, reused for other patches.
pub(super) struct Scratch {
    patch: PatchSamples,
    /// The samples of the patch, prepared for each orientation; empty until first used.
    views: Vec<Vec<View<LANES>>>,
    tint: Tint,
    seen: Vec<(u32, u8)>,
    heights: Vec<f32>,
    nearest: Vec<(f32, u32)>,
}

impl Scratch {
    pub(super) fn new() -> Self {
        Self {
            patch: PatchSamples::default(),
            views: vec![],
            tint: Tint::default(),
            seen: vec![],
            heights: vec![0.0; NODES],
            nearest: vec![],
        }
    }
}

impl Search<'_> {
    /// Returns the best exemplar for a patch among the candidates. `before` contains the previous matches of all patches, or is empty.
    /// `hint` is a position to try. `far` adds candidates from all exemplars; otherwise only those near known matches are candidates.
    pub(super) fn best(
        &self,
        scene: &Scene<'_>,
        center: usize,
        before: &[Match],
        hint: Option<Hint>,
        far: Option<u64>,
        scratch: &mut Scratch,
    ) -> Match {
        self.begin(scene, center, scratch);
        let mut best = Match::NOTHING;
        if let Some(own) = before.get(center) {
            self.try_one(own.exemplar, own.orientation, &mut best, scratch);
        }
        if let Some(hint) = hint {
            self.try_near(hint, &mut best, scratch);
        }
        if !before.is_empty() {
            for &other in self.patches.near.list(center) {
                let other = other as usize;
                let found = &before[other];
                if found.exemplar != NONE {
                    let (frame, at) = (&scene.frames[other], scene.frames[center].origin);
                    let to = self.exemplars.map_point(found, self.orientations, frame, at);
                    let from = self.exemplars.vertices[found.exemplar as usize];
                    self.try_near(
                        Hint { from, to, orientation: found.orientation },
                        &mut best,
                        scratch,
                    );
                }
            }
        }
        if let Some(iteration) = far {
            self.try_tree(scene, center, &mut best, scratch);
            self.try_random(center, iteration, &mut best, scratch);
        }
        best
    }

    /// Prepares the comparisons of the patch `center` with exemplars.
    fn begin(&self, scene: &Scene<'_>, center: usize, scratch: &mut Scratch) {
        scratch.seen.clear();
        self.load_patch(scene, center, &mut scratch.patch);
        scratch.views.resize(self.orientations.all.len(), Vec::new());
        scratch.views.iter_mut().for_each(Vec::clear);
        scratch.tint = self.tint(center, &scratch.patch);
    }

    /// Prepares the samples of the patch for comparisons with exemplars in the given orientation.
    fn prepare_view(&self, orientation: u8, scratch: &mut Scratch) {
        let view = &mut scratch.views[usize::from(orientation)];
        if view.is_empty() {
            scratch.patch.view(
                self.exemplars.lattice.step,
                self.orientations.get(orientation),
                view,
            );
        }
    }

    /// Loads the samples of a patch in the coordinates of its frame.
    pub(super) fn load_patch(&self, scene: &Scene<'_>, center: usize, patch: &mut PatchSamples) {
        let frame = &scene.frames[center];
        patch.samples.clear();
        patch.samples.extend(self.patches.members.list(center).iter().map(|&site| {
            let vertex = self.patches.sites[site as usize];
            sample(frame, &scene.points[vertex as usize], &scene.normals[site as usize])
        }));
        patch.prepare(self.radius, true);
        patch.shifts = self.exemplars.are_shifted;
    }

    /// Returns the mean color of a patch and the color's slopes in the patch's frame; all zeros if colors are not compared.
    fn tint(&self, center: usize, patch: &PatchSamples) -> Tint {
        if self.colors.is_empty() {
            return Tint::default();
        }
        let reach = PART * self.radius;
        let members = patch.samples.iter().zip(self.patches.members.list(center));
        let near = members.filter(|(Sample { at: [x, y], .. }, _)| x * x + y * y <= reach * reach);
        Tint::new(near.map(|(sample, &site)| {
            let vertex = self.patches.sites[site as usize];
            (sample.at.map(|x| x / reach), self.colors[vertex as usize])
        }))
    }

    fn try_near(&self, hint: Hint, best: &mut Match, scratch: &mut Scratch) {
        let vertex =
            self.surface.walk_to_nearest(self.data, hint.from, &hint.to, self.data.len() as u32);
        self.try_one(self.exemplars.owners[vertex as usize], hint.orientation, best, scratch);
    }

    fn try_one(&self, exemplar: u32, orientation: u8, best: &mut Match, scratch: &mut Scratch) {
        if exemplar == NONE || scratch.seen.contains(&(exemplar, orientation)) {
            return;
        }
        scratch.seen.push((exemplar, orientation));
        self.prepare_view(orientation, scratch);
        let exemplars = exemplar..exemplar + 1;
        widest(Comparisons { search: self, scratch, exemplars, orientation, best });
    }

    /// Compares the patches with the worst matches with all exemplars, as many patches as the allowed number of comparisons permits.
    pub(super) fn improve_worst_matches(
        &self,
        scene: &Scene<'_>,
        matches: &mut [Match],
        comparisons: usize,
    ) {
        let mut worst: Vec<u32> = (0..matches.len() as u32).collect();
        worst.sort_by(|&a, &b| {
            let [of_a, of_b] = [a, b].map(|center| matches[center as usize].difference());
            of_b.total_cmp(&of_a).then(a.cmp(&b))
        });
        worst.truncate(comparisons / (self.exemplars.len() * self.orientations.usual).max(1));
        let found = worst.par_iter().with_min_len(4).map_init(
            Scratch::new,
            |scratch: &mut Scratch, &center| {
                let center = center as usize;
                self.best_of_all(scene, center, matches[center], scratch)
            },
        );
        let found: Vec<Match> = found.collect();
        worst.iter().zip(found).for_each(|(&center, found)| matches[center as usize] = found);
    }

    /// Returns the best of all exemplars for a patch; `found` if no exemplar is better.
    fn best_of_all(
        &self,
        scene: &Scene<'_>,
        center: usize,
        found: Match,
        scratch: &mut Scratch,
    ) -> Match {
        self.begin(scene, center, scratch);
        let (mut best, all) = (found, self.exemplars.len() as u32);
        for orientation in self.orientations.range_for(&scene.frames[center]) {
            let orientation = orientation as u8;
            self.prepare_view(orientation, scratch);
            widest(Comparisons {
                search: self,
                scratch,
                exemplars: 0..all,
                orientation,
                best: &mut best,
            });
        }
        best
    }

    /// Replaces `best` by an exemplar if the exemplar is more similar to the patch.
    #[inline(always)]
    fn compare(&self, exemplar: u32, orientation: u8, best: &mut Match, scratch: &Scratch) {
        let tints = self.exemplars.tints.get(exemplar as usize);
        let tint =
            tints.map_or(0.0, |own| scratch.tint.compare(own, self.orientations.get(orientation)));
        let max_difference = best.difference() - tint;
        let ssd = if max_difference >= 0.0 {
            let view = &scratch.views[usize::from(orientation)];
            scratch.patch.compare(view, self.exemplars.heights(exemplar), max_difference)
        } else {
            f64::INFINITY
        };
        let other = Match { exemplar, orientation, ssd, tint };
        let is_better = (other.difference(), exemplar, orientation)
            < (best.difference(), best.exemplar, best.orientation);
        if is_better && ssd < f64::INFINITY {
            *best = other;
        }
    }

    fn try_tree(&self, scene: &Scene<'_>, center: usize, best: &mut Match, scratch: &mut Scratch) {
        let frame = &scene.frames[center];
        let (lattice, polar) = (&self.exemplars.lattice, &self.exemplars.polar);
        let vertex = self.patches.sites[center];
        let mut heights = std::mem::take(&mut scratch.heights);
        lattice.measure(self.surface, scene.points, NONE, vertex, frame, &mut heights);
        let tried = self.orientations.range_for(frame);
        let each = FROM_TREE.div_ceil(tried.len()).max(4);
        for orientation in tried {
            let rings = polar.rings(&heights, &self.orientations.all[orientation].inverse());
            let mut descriptor = self.exemplars.basis.project(&rings);
            if !self.colors.is_empty() {
                scratch.tint.put(&mut descriptor);
            }
            let mut nearest = std::mem::take(&mut scratch.nearest);
            self.exemplars.tree.nearest(&descriptor, each, &mut nearest);
            for &(_, exemplar) in &nearest {
                self.try_one(exemplar, orientation as u8, best, scratch);
            }
            scratch.nearest = nearest;
        }
        scratch.heights = heights;
    }

    fn try_random(&self, center: usize, iteration: u64, best: &mut Match, scratch: &mut Scratch) {
        let mut window = 4.0 * self.radius;
        for k in 0..RANDOM {
            if best.exemplar == NONE {
                return;
            }
            let own = &self.exemplars.frames[best.exemplar as usize];
            let [x, y] = random([self.seed, iteration, center as u64, k]).map(|x| x * window);
            let to = own.origin + own.global([x, y, 0.0]);
            let from = self.exemplars.vertices[best.exemplar as usize];
            self.try_near(Hint { from, to, orientation: best.orientation }, best, scratch);
            window /= 2.0;
        }
    }
}

/// A kernel that finds the best of a range of exemplars in one orientation.
struct Comparisons<'a> {
    search: &'a Search<'a>,
    scratch: &'a Scratch,
    exemplars: Range<u32>,
    orientation: u8,
    best: &'a mut Match,
}

impl Kernel for Comparisons<'_> {
    #[inline(always)]
    fn run(self) {
        for exemplar in self.exemplars {
            self.search.compare(exemplar, self.orientation, self.best, self.scratch);
        }
    }
}

/// Returns two pseudorandom numbers from -1 to 1 that depend only on `key`.
fn random(key: [u64; 4]) -> [f64; 2] {
    // The mixing function of Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014).
    fn mix(mut x: u64) -> u64 {
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }
    let word = key
        .into_iter()
        .fold(0, |word: u64, part| mix(word.wrapping_add(0x9e37_79b9_7f4a_7c15) ^ mix(part)));
    [word >> 32, word & 0xffff_ffff].map(|half| half as f64 / f64::from(1_u32 << 31) - 1.0)
}
