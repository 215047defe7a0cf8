//! Finds the exemplar that is most similar to a patch.
//!
//! Candidates are the nearest by descriptors, those beside the matches of neighbors, the match from before, and random ones near
//! the best: Barnes, Shechtman, Finkelstein and Goldman, "PatchMatch" (2009), here with all patches at once. Those that stay worst are
//! compared with all exemplars.

use std::ops::Range;

use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, widest};
use nalgebra::{Point3, Vector3};

use super::best_match::Match;
use super::compare::PatchSamples;
use super::exemplars::Exemplars;
use super::frame::Frame;
use super::heights::{LANES, NODES, Sample, View, sample};
use super::patches::Patches;
use super::surface::{NONE, Surface};
use super::tints::{Color, PART, Tint};
use super::turns::Turns;

/// A place at which to try exemplars: a data vertex near it, and a turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hint {
    pub(super) from: u32,
    pub(super) to: Point3<f64>,
    pub(super) turn: u8,
}

/// The patches as they are in one iteration.
pub(super) struct Scene<'a> {
    pub(super) points: &'a [Point3<f64>],
    /// Normals of all samples.
    pub(super) normals: &'a [Vector3<f64>],
    /// Frames of the patches.
    pub(super) frames: &'a [Frame],
}

/// What a search needs in all iterations of a level.
pub(super) struct Search<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) data: &'a [Point3<f64>],
    /// Of all vertices; none if they do not count.
    pub(super) colors: &'a [Color],
    pub(super) patches: &'a Patches,
    pub(super) exemplars: &'a Exemplars,
    pub(super) turns: &'a Turns,
    pub(super) radius: f64,
    /// Sets random places of levels apart.
    pub(super) seed: u64,
}

/// Candidates from the tree, over all turns.
const FROM_TREE: usize = 16;

/// Random candidates, each from half as far as the one before.
const RANDOM: u64 = 4;

/// Buffers of a search.
pub(super) struct Scratch {
    patch: PatchSamples,
    /// The views of the patch for each turn; empty until they are asked for.
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
    /// The best exemplar for a patch among the candidates. `before` are the matches of all patches, if there are any; `hint` is a
    /// place to look at; `far` asks for candidates from all exemplars, not only near known matches.
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
            self.try_one(own.exemplar, own.turn, &mut best, scratch);
        }
        if let Some(hint) = hint {
            self.try_near(hint, &mut best, scratch);
        }
        if !before.is_empty() {
            for &other in self.patches.near.of(center) {
                let other = other as usize;
                let found = &before[other];
                if found.exemplar != NONE {
                    let (frame, at) = (&scene.frames[other], scene.frames[center].at);
                    let to = self.exemplars.place(found, self.turns, frame, at);
                    let from = self.exemplars.vertices[found.exemplar as usize];
                    self.try_near(Hint { from, to, turn: found.turn }, &mut best, scratch);
                }
            }
        }
        if let Some(iteration) = far {
            self.try_tree(scene, center, &mut best, scratch);
            self.try_random(center, iteration, &mut best, scratch);
        }
        best
    }

    /// Prepares for comparisons of a patch.
    fn begin(&self, scene: &Scene<'_>, center: usize, scratch: &mut Scratch) {
        scratch.seen.clear();
        self.take(scene, center, &mut scratch.patch);
        scratch.views.resize(self.turns.all.len(), Vec::new());
        scratch.views.iter_mut().for_each(Vec::clear);
        scratch.tint = self.tint(center, &scratch.patch);
    }

    /// Prepares for comparisons with exemplars that are turned like this.
    fn look(&self, turn: u8, scratch: &mut Scratch) {
        let view = &mut scratch.views[usize::from(turn)];
        if view.is_empty() {
            scratch.patch.view(self.exemplars.lattice.step, self.turns.of(turn), view);
        }
    }

    /// Puts a patch in its frame.
    pub(super) fn take(&self, scene: &Scene<'_>, center: usize, patch: &mut PatchSamples) {
        let frame = &scene.frames[center];
        patch.samples.clear();
        patch.samples.extend(self.patches.members.of(center).iter().map(|&site| {
            let vertex = self.patches.sites[site as usize];
            sample(frame, &scene.points[vertex as usize], &scene.normals[site as usize])
        }));
        patch.prepare(self.radius, true);
    }

    /// The colors of a patch in its frame, if they count.
    fn tint(&self, center: usize, patch: &PatchSamples) -> Tint {
        if self.colors.is_empty() {
            return Tint::default();
        }
        let reach = PART * self.radius;
        let members = patch.samples.iter().zip(self.patches.members.of(center));
        let near = members.filter(|(Sample { at: [x, y], .. }, _)| x * x + y * y <= reach * reach);
        Tint::new(near.map(|(sample, &site)| {
            let vertex = self.patches.sites[site as usize];
            (sample.at.map(|x| x / reach), self.colors[vertex as usize])
        }))
    }

    fn try_near(&self, hint: Hint, best: &mut Match, scratch: &mut Scratch) {
        let vertex = self.surface.descend(self.data, hint.from, &hint.to, self.data.len() as u32);
        self.try_one(self.exemplars.owners[vertex as usize], hint.turn, best, scratch);
    }

    fn try_one(&self, exemplar: u32, turn: u8, best: &mut Match, scratch: &mut Scratch) {
        if exemplar == NONE || scratch.seen.contains(&(exemplar, turn)) {
            return;
        }
        scratch.seen.push((exemplar, turn));
        self.look(turn, scratch);
        let exemplars = exemplar..exemplar + 1;
        widest(Comparisons { search: self, scratch, exemplars, turn, best });
    }

    /// Compares as many of the patches with all exemplars as some comparisons allow, those whose matches are worst.
    pub(super) fn better_the_worst(
        &self,
        scene: &Scene<'_>,
        matches: &mut [Match],
        comparisons: usize,
    ) {
        fn off(center: u32, matches: &[Match]) -> f64 {
            matches[center as usize].ssd + matches[center as usize].tint
        }
        let mut worst: Vec<u32> = (0..matches.len() as u32).collect();
        worst.sort_by(|&a, &b| off(b, matches).total_cmp(&off(a, matches)).then(a.cmp(&b)));
        worst.truncate(comparisons / (self.exemplars.len() * self.turns.usual).max(1));
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

    /// The best of all exemplars for a patch; what was `found` if none is better.
    fn best_of_all(
        &self,
        scene: &Scene<'_>,
        center: usize,
        found: Match,
        scratch: &mut Scratch,
    ) -> Match {
        self.begin(scene, center, scratch);
        let (mut best, all) = (found, self.exemplars.len() as u32);
        for turn in self.turns.tried(&scene.frames[center]) {
            let turn = turn as u8;
            self.look(turn, scratch);
            widest(Comparisons { search: self, scratch, exemplars: 0..all, turn, best: &mut best });
        }
        best
    }

    /// Takes an exemplar if it is better than the best.
    #[inline(always)]
    fn compare(&self, exemplar: u32, turn: u8, best: &mut Match, scratch: &Scratch) {
        let way = self.turns.of(turn);
        let tints = self.exemplars.tints.get(exemplar as usize);
        let tint = tints.map_or(0.0, |own| scratch.tint.compare(own, way));
        let most = best.ssd + best.tint - tint;
        let ssd = if most >= 0.0 {
            let view = &scratch.views[usize::from(turn)];
            scratch.patch.compare(view, self.exemplars.heights(exemplar), most)
        } else {
            f64::INFINITY
        };
        let less = (ssd + tint, exemplar, turn) < (best.ssd + best.tint, best.exemplar, best.turn);
        if less && ssd < f64::INFINITY {
            *best = Match { exemplar, turn, ssd, tint };
        }
    }

    fn try_tree(&self, scene: &Scene<'_>, center: usize, best: &mut Match, scratch: &mut Scratch) {
        let frame = &scene.frames[center];
        let (lattice, polar) = (&self.exemplars.lattice, &self.exemplars.polar);
        let vertex = self.patches.sites[center];
        let mut heights = std::mem::take(&mut scratch.heights);
        lattice.measure(self.surface, scene.points, NONE, vertex, frame, &mut heights);
        let tried = self.turns.tried(frame);
        let each = FROM_TREE.div_ceil(tried.len()).max(4);
        for turn in tried {
            let rings = polar.rings(&heights, &self.turns.all[turn].inverse());
            let mut descriptor = self.exemplars.basis.project(&rings);
            if !self.colors.is_empty() {
                scratch.tint.put(&mut descriptor);
            }
            let mut nearest = std::mem::take(&mut scratch.nearest);
            self.exemplars.tree.nearest(&descriptor, each, &mut nearest);
            for &(_, exemplar) in &nearest {
                self.try_one(exemplar, turn as u8, best, scratch);
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
            let to = own.at + own.global([x, y, 0.0]);
            let from = self.exemplars.vertices[best.exemplar as usize];
            self.try_near(Hint { from, to, turn: best.turn }, best, scratch);
            window /= 2.0;
        }
    }
}

/// The best of some exemplars, all turned alike.
struct Comparisons<'a> {
    search: &'a Search<'a>,
    scratch: &'a Scratch,
    exemplars: Range<u32>,
    turn: u8,
    best: &'a mut Match,
}

impl Kernel for Comparisons<'_> {
    #[inline(always)]
    fn run(self) {
        for exemplar in self.exemplars {
            self.search.compare(exemplar, self.turn, self.best, self.scratch);
        }
    }
}

/// Two numbers from -1 to 1 that look random, always the same for the same key.
fn random(key: [u64; 4]) -> [f64; 2] {
    // Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014).
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
