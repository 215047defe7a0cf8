//! One level: matches are looked for, the missing part moves to where they say, and so on.

use maquette::{Cancelled, Progress};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::compare::Patch;
use super::exemplars::{Exemplars, REACH};
use super::found_match::Match;
use super::frame::Frame;
use super::hole::Hole;
use super::patches::{Patches, Scale};
use super::search::{Hint, Scene, Scratch, Search};
use super::smoothness::HOLE;
use super::spread::Spread;
use super::surface::{NONE, Surface};
use super::tints::Color;
use super::turns::Turns;
use super::{ExemplarOptions, Update};

/// What all levels share.
pub(super) struct Whole<'a> {
    pub(super) surface: &'a Surface<'a>,
    /// Of all vertices; none if they do not count.
    pub(super) colors: &'a [Color],
    /// How many vertices are data.
    pub(super) data: usize,
    pub(super) options: &'a ExemplarOptions,
    pub(super) turns: &'a Turns,
    pub(super) hole: &'a Hole,
    /// Marks the missing vertices whose start is sharp; none, if empty.
    pub(super) sharp: &'a [bool],
    /// How far each data vertex is from the nearest missing one.
    pub(super) distances: &'a [f64],
}

/// One energy of a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Energy {
    /// The weighted mean of the squared distances: equation 1.
    pub(super) mean: f64,
    /// The largest mean of one patch.
    pub(super) most: f64,
}

impl Energy {
    /// Whether it is rounding alone.
    fn is_nothing(&self, radius: f64) -> bool {
        let nothing = NOTHING * radius;
        self.mean <= nothing * nothing
    }
}

/// How the best iterate of a level came about, and what it is made of.
pub(super) struct Outcome {
    /// The iterations that were better than all before them, and their energies.
    pub(super) kept: Vec<(u64, Energy)>,
    /// How many iterations were done.
    pub(super) iterations: u64,
    pub(super) guides: Vec<Guide>,
    pub(super) patches: Patches,
    pub(super) matches: Vec<Match>,
    pub(super) frames: Vec<Frame>,
    /// Of all samples.
    pub(super) normals: Vec<Vector3<f64>>,
    /// How much each patch says.
    pub(super) shares: Vec<f64>,
}

impl Outcome {
    /// Whether the exemplars fit exactly, so that nothing is left to be done.
    pub(super) fn is_exact(&self, radius: f64) -> bool {
        self.kept.last().is_some_and(|(_, energy)| energy.is_nothing(radius))
    }
}

/// A patch and its match, for the patches of the next level.
#[derive(Clone, Copy)]
pub(super) struct Guide {
    pub(super) vertex: u32,
    frame: Frame,
    own: Frame,
    from: u32,
    turn: u8,
}

impl Guide {
    /// The data vertex that it copies.
    pub(super) fn from(&self) -> u32 {
        self.from
    }

    /// Where its exemplar has a point.
    fn hint(&self, turns: &Turns, point: Point3<f64>) -> Hint {
        let [u, v, w] = self.frame.local(point - self.frame.at);
        let [x, y] = turns.of(self.turn).apply([u, v]);
        Hint { from: self.from, to: self.own.at + self.own.global([x, y, w]), turn: self.turn }
    }
}

/// Iterations after which all exemplars are looked at again.
const FAR: u64 = 4;

/// A look at all exemplars, not only those near known matches.
#[derive(Clone, Copy)]
struct Far {
    iteration: u64,
    /// Comparisons for the worst matches.
    more: usize,
}

/// Comparisons for the patches whose matches are worst with all exemplars, whenever all are looked at. They have most of the energy, and
/// few candidates are like them: without, on sharp and rugged data matches are a fifth worse than the best.
const MORE: usize = 80_000;

/// The same at the end of a level, at least and at most; between these, for one of so many patches.
const MORE_AT_THE_END: [usize; 2] = [250_000, 1_200_000];
const WORST: usize = 12;

/// Below this share of a patch's radius distances are rounding.
const NOTHING: f64 = 1e-10;

/// How far a start over which creases go on may well be off, in edges: as far as the data may be from the surfaces that meet in them.
/// Exemplars that lie against it by more would round the creases.
const SHARP: f64 = 0.1;

/// A level: what is compared with what, and how far apart.
pub(super) struct Level<'a> {
    pub(super) whole: &'a Whole<'a>,
    pub(super) scale: Scale,
    pub(super) number: u64,
    /// The wanted distance between samples.
    pub(super) edge: f64,
    /// How far a thin plate over so wide a hole as a patch shows may well be off; infinite if nothing speaks for the shape at the
    /// beginning.
    pub(super) doubt: f64,
    pub(super) exemplars: &'a Exemplars,
}

impl Level<'_> {
    /// Runs the level. `points` and `areas` are left at the best iterate.
    pub(super) fn run(
        &self,
        points: &mut [Point3<f64>],
        areas: &mut [Vector3<f64>],
        guides: &[Guide],
        progress: &Progress<'_>,
    ) -> Result<Outcome, Cancelled> {
        let whole = self.whole;
        let original = points[..whole.data].to_vec();
        let patches = Patches::new(whole.surface, points, whole.data, whole.distances, &self.scale);
        let movable = &patches.sites[..patches.movable];
        let spread = (patches.movable < points.len() - whole.data)
            .then(|| Spread::new(whole.surface, points.len(), whole.data, movable))
            .flatten();
        let begin = points.to_vec();
        let active = self.active();
        let search = Search {
            surface: whole.surface,
            data: &original,
            colors: whole.colors,
            patches: &patches,
            exemplars: self.exemplars,
            turns: whole.turns,
            radius: self.scale.radius,
            seed: self.number,
        };
        let hints = self.hints(&patches, points, guides);
        let mut now =
            self.look(&search, points, areas, &[], &hints, Some(Far { iteration: 0, more: MORE }));
        let mut best = (points[whole.data..].to_vec(), now.clone());
        let mut kept = vec![(0, now.energy)];
        let (mut since, mut iterations) = (0, 0);
        let patience = whole.options.longest_wait();
        while iterations < u64::from(whole.options.most_iterations()) {
            // Nobody knows how many iterations there will be; some eight are the rule.
            progress.tick(iterations as f64 / (iterations as f64 + 8.0))?;
            if best.1.energy.is_nothing(self.scale.radius) || since >= patience {
                break;
            }
            iterations += 1;
            self.update(&search, &now, points, &begin, spread.as_ref());
            self.measure(&active, points, areas);
            let far = Far { iteration: iterations, more: MORE };
            let far = iterations.is_multiple_of(FAR).then_some(far);
            now = self.look(&search, points, areas, &now.matches, &[], far);
            let better = now.energy.mean < best.1.energy.mean * (1.0 - self.least_gain());
            since = if better { 0 } else { since + 1 };
            if now.energy.mean < best.1.energy.mean {
                best = (points[whole.data..].to_vec(), now.clone());
                kept.push((iterations, now.energy));
            }
        }
        points[whole.data..].copy_from_slice(&best.0);
        self.measure(&active, points, areas);
        if !best.1.energy.is_nothing(self.scale.radius) {
            // What is copied is looked for among all once more.
            let [least, most] = MORE_AT_THE_END;
            let more = (patches.len() * self.exemplars.len() / WORST).clamp(least, most);
            let far = Far { iteration: iterations + 1, more };
            best.1 = self.look(&search, points, areas, &best.1.matches, &[], Some(far));
        }
        let shares =
            (0..patches.len()).map(|center| self.share(&patches, &best.1, center)).collect();
        let View { matches, frames, normals, .. } = best.1;
        let guides = self.guides(&patches, &matches, &frames);
        Ok(Outcome { kept, iterations, guides, patches, matches, frames, normals, shares })
    }

    /// The least share by which the energy of an iteration must be smaller to count as progress. With less than 3 %, late iterations
    /// fit the noise of the exemplars: on most surfaces the distance to the truth grows while the energy falls.
    fn least_gain(&self) -> f64 {
        match self.whole.options.update {
            Update::Exact => 0.03,
            Update::Published => 1e-3,
        }
    }

    /// How far a missing vertex may well be off at the beginning.
    fn doubt(&self, vertex: usize) -> f64 {
        if self.whole.sharp.get(vertex - self.whole.data) == Some(&true) {
            return SHARP * self.whole.hole.edge;
        }
        let seen = HOLE * REACH * self.scale.radius;
        let times = (self.whole.hole.widths[vertex - self.whole.data] / seen).max(1.0);
        self.doubt * times * times
    }

    fn is_published(&self) -> bool {
        self.whole.options.update == Update::Published
    }

    /// The vertices whose normals move: at the rim those of the data stay, if the publication is followed.
    fn active(&self) -> Vec<u32> {
        let Whole { surface, data, .. } = *self.whole;
        let mut active: Vec<u32> = (data as u32..self.whole.hole.rim.len() as u32)
            .flat_map(|vertex| surface.ring(vertex).iter().copied().chain([vertex]))
            .filter(|&vertex| data <= vertex as usize || !self.is_published())
            .collect();
        active.sort_unstable();
        active.dedup();
        active
    }

    /// Measures the areas of these vertices anew.
    fn measure(&self, active: &[u32], points: &[Point3<f64>], areas: &mut [Vector3<f64>]) {
        for &vertex in active {
            areas[vertex as usize] = self.whole.surface.area(points, vertex);
        }
    }

    /// Places where the exemplars of the level before have the patches of this one.
    fn hints(&self, patches: &Patches, points: &[Point3<f64>], guides: &[Guide]) -> Vec<Hint> {
        if guides.is_empty() {
            return Vec::new();
        }
        let mut place = vec![NONE; points.len()];
        (0..).zip(guides).for_each(|(k, guide)| place[guide.vertex as usize] = k);
        let sources = guides.iter().map(|guide| guide.vertex);
        let nearest = self.whole.surface.nearest(points, sources, f64::INFINITY);
        let hint = |&vertex: &u32| {
            let guide = match nearest[vertex as usize] {
                NONE => guides[0],
                source => guides[place[source as usize] as usize],
            };
            guide.hint(self.whole.turns, points[vertex as usize])
        };
        patches.sites[..patches.len()].iter().map(hint).collect()
    }

    fn guides(&self, patches: &Patches, matches: &[Match], frames: &[Frame]) -> Vec<Guide> {
        let each = matches.iter().zip(frames).zip(&patches.sites);
        let found = each.filter(|((found, _), _)| found.exemplar != NONE);
        let guide = |((found, &frame), &vertex): ((&Match, &Frame), &u32)| {
            let own = self.exemplars.frames[found.exemplar as usize];
            let from = self.exemplars.vertices[found.exemplar as usize];
            Guide { vertex, frame, own, from, turn: found.turn }
        };
        found.map(guide).collect()
    }

    /// Looks for the matches of all patches as they are now.
    fn look(
        &self,
        search: &Search<'_>,
        points: &[Point3<f64>],
        areas: &[Vector3<f64>],
        before: &[Match],
        hints: &[Hint],
        far: Option<Far>,
    ) -> View {
        let patches = search.patches;
        let normals = patches.normals(areas);
        let frame = |center: usize| {
            let at = points[patches.sites[center] as usize];
            Frame::new(at, normals[center], self.whole.options.up.into())
        };
        let frames: Vec<Frame> = (0..patches.len()).map(frame).collect();
        let scene = Scene { points, normals: &normals, frames: &frames };
        let best = |scratch: &mut Scratch, center: usize| {
            let hint = hints.get(center).copied();
            search.best(&scene, center, before, hint, far.map(|far| far.iteration), scratch)
        };
        let centers = (0..patches.len()).into_par_iter().with_min_len(16);
        let mut matches: Vec<Match> = centers.map_init(Scratch::new, best).collect();
        if before.is_empty() {
            // Once more, for what neighbors found.
            let best = |scratch: &mut Scratch, center: usize| {
                search.best(&scene, center, &matches, None, None, scratch)
            };
            let centers = (0..patches.len()).into_par_iter().with_min_len(16);
            matches = centers.map_init(Scratch::new, best).collect();
        }
        if let Some(far) = far {
            search.better_the_worst(&scene, &mut matches, far.more);
        }
        let weights = self.weights(patches, points);
        let energy = energy(&matches, &weights);
        View { normals, frames, matches, weights, energy }
    }

    /// The weights of all patches: 1 around data, less the farther a patch is inside.
    fn weights(&self, patches: &Patches, points: &[Point3<f64>]) -> Vec<f64> {
        let falloff = self.whole.options.fall();
        let rate = if falloff.rate == 0.0 { 1.0 / self.edge } else { falloff.rate };
        let fall = libm::log(falloff.base) * rate;
        let weight = |center: usize| {
            let vertex = patches.sites[center] as usize;
            match self.whole.hole.rim[vertex] {
                NONE => 1.0,
                _ if vertex < self.whole.data => 1.0,
                rim => libm::exp(-fall * (points[vertex] - points[rim as usize]).norm()),
            }
        };
        (0..patches.len()).map(weight).collect()
    }

    /// How much a patch has to say.
    fn share(&self, patches: &Patches, now: &View, center: usize) -> f64 {
        match (now.matches[center].exemplar, self.whole.options.update) {
            (NONE, _) => 0.0,
            (_, Update::Exact) => now.weights[center] / patches.members.of(center).len() as f64,
            (_, Update::Published) => now.weights[center],
        }
    }

    /// Moves the missing part to the weighted means of what the exemplars say: equations 9 to 13, with all vertices at once.
    fn update(
        &self,
        search: &Search<'_>,
        now: &View,
        points: &mut [Point3<f64>],
        begin: &[Point3<f64>],
        spread: Option<&Spread<'_>>,
    ) {
        let patches = search.patches;
        let distances = distances(search, now, points);
        let motion = |site: usize| {
            let (mut sum, mut weight, mut miss) = (0.0, 0.0, 0.0);
            for &entry in patches.entries.of(site) {
                let distance = distances[entry as usize];
                if !distance.is_nan() {
                    let center = patches.centers[entry as usize] as usize;
                    let share = self.share(patches, now, center);
                    sum += share * distance;
                    weight += share;
                    miss += share * now.matches[center].ssd;
                }
            }
            if weight == 0.0 {
                return Vector3::zeros();
            }
            // Two estimates of one place, each weighed by its certainty.
            let vertex = patches.sites[site] as usize;
            let back = (begin[vertex] - points[vertex]).dot(&now.normals[site]);
            let doubt = self.doubt(vertex);
            let (miss, doubt) = (miss / weight, doubt * doubt);
            let trust =
                if doubt.is_finite() { doubt / (doubt + miss).max(f64::MIN_POSITIVE) } else { 1.0 };
            now.normals[site] * (trust * sum / weight + (1.0 - trust) * back)
        };
        let motions: Vec<Vector3<f64>> =
            (0..patches.movable).into_par_iter().with_min_len(64).map(motion).collect();
        match spread {
            Some(spread) => spread.apply(&motions, points),
            None => {
                let moved = patches.sites[..patches.movable].iter().zip(motions);
                moved.for_each(|(&vertex, motion)| points[vertex as usize] += motion);
            }
        }
    }
}

/// The patches as they are, and their matches.
#[derive(Clone)]
pub(super) struct View {
    normals: Vec<Vector3<f64>>,
    frames: Vec<Frame>,
    matches: Vec<Match>,
    weights: Vec<f64>,
    energy: Energy,
}

/// Equation 1, in the order of the patches.
fn energy(matches: &[Match], weights: &[f64]) -> Energy {
    let (mut sum, mut weight, mut most) = (0.0, 0.0, 0.0_f64);
    for (found, &own) in matches.iter().zip(weights) {
        if found.exemplar != NONE {
            sum += own * found.ssd;
            weight += own;
            most = most.max(found.ssd);
        }
    }
    let mean = if weight > 0.0 { sum / weight } else { f64::INFINITY };
    Energy { mean, most: if weight > 0.0 { most } else { f64::INFINITY } }
}

/// The distance of each member of each patch to its exemplar, along the member's normal.
fn distances(search: &Search<'_>, now: &View, points: &[Point3<f64>]) -> Vec<f64> {
    let scene = Scene { points, normals: &now.normals, frames: &now.frames };
    let of_patch = |patch: &mut Patch, center: usize| {
        let Match { exemplar, turn, .. } = now.matches[center];
        search.take(&scene, center, patch);
        if exemplar == NONE {
            return vec![f64::NAN; patch.samples.len()];
        }
        let heights = search.exemplars.heights(exemplar);
        let step = search.exemplars.lattice.step;
        let mut lie = patch.lay(heights, step, search.turns.of(turn));
        for (sample, distance) in lie.distances.iter_mut().enumerate() {
            *distance -= patch.at(&lie.plane, sample);
        }
        lie.distances
    };
    let centers = (0..search.patches.len()).into_par_iter().with_min_len(16);
    let all: Vec<Vec<f64>> = centers.map_init(Patch::default, of_patch).collect();
    all.concat()
}
