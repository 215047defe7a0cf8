//! One level: finds a match for each patch, moves the missing vertices to the weighted mean of the matches, and repeats.

use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::best_match::Match;
use super::compare::PatchSamples;
use super::exemplars::{Exemplars, REACH};
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

/// What is the same on all levels.
pub(super) struct Shared<'a> {
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
    /// Whether it is no more than rounding.
    fn is_rounding(&self, radius: f64) -> bool {
        let rounding = ROUNDING * radius;
        self.mean <= rounding * rounding
    }
}

/// The best iterate of a level, and the iterations that led to it.
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
    /// The weight of each patch in the mean that moves its vertices.
    pub(super) shares: Vec<f64>,
}

impl Outcome {
    /// Whether the exemplars fit exactly: then there is no detail to add.
    pub(super) fn is_exact(&self, radius: f64) -> bool {
        self.kept.last().is_some_and(|(_, energy)| energy.is_rounding(radius))
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

/// Iterations after which all exemplars are searched again.
const FAR: u64 = 4;

/// A search of all exemplars, not only those near known matches.
#[derive(Clone, Copy)]
struct Far {
    iteration: u64,
    /// Comparisons for the worst matches.
    more: usize,
}

/// Comparisons for the patches whose matches are worst with all exemplars, whenever all are searched. They have most of the energy, and
/// few candidates are like them: without, on sharp and rugged data matches are a fifth worse than the best.
const MORE: usize = 80_000;

/// The same at the end of a level, at least and at most; between these, for one of so many patches.
const MORE_AT_THE_END: [usize; 2] = [250_000, 1_200_000];
const WORST: usize = 12;

/// Below this share of a patch's radius distances are rounding.
const ROUNDING: f64 = 1e-10;

/// The standard error of a start across which creases are extended, in edges: that of the data about the surfaces that meet in the creases.
/// With more, exemplars would round the creases.
const SHARP: f64 = 0.1;

/// A level: its patches' size and spacing, and the exemplars with which they are compared.
pub(super) struct CompletionLevel<'a> {
    pub(super) shared: &'a Shared<'a>,
    pub(super) scale: Scale,
    pub(super) number: u64,
    /// The wanted distance between samples.
    pub(super) edge: f64,
    /// The standard error of a thin plate over a hole as wide as a patch shows; infinite if the shape at the beginning is no estimate of
    /// the surface.
    pub(super) plate_error: f64,
    pub(super) exemplars: &'a Exemplars,
}

impl CompletionLevel<'_> {
    /// Runs the level. `points` and `areas` are left at the best iterate.
    pub(super) fn run(
        &self,
        points: &mut [Point3<f64>],
        areas: &mut [Vector3<f64>],
        guides: &[Guide],
        progress: &Progress<'_>,
    ) -> Result<Outcome, Cancelled> {
        let shared = self.shared;
        let original = points[..shared.data].to_vec();
        let patches =
            Patches::new(shared.surface, points, shared.data, shared.distances, &self.scale);
        let movable = &patches.sites[..patches.movable];
        let spread = (patches.movable < points.len() - shared.data)
            .then(|| Spread::new(shared.surface, points.len(), shared.data, movable))
            .flatten();
        let begin = points.to_vec();
        let active = self.active();
        let search = Search {
            surface: shared.surface,
            data: &original,
            colors: shared.colors,
            patches: &patches,
            exemplars: self.exemplars,
            turns: shared.turns,
            radius: self.scale.radius,
            seed: self.number,
        };
        let hints = self.hints(&patches, points, guides);
        let mut now = self.find_matches(
            &search,
            points,
            areas,
            &[],
            &hints,
            Some(Far { iteration: 0, more: MORE }),
        );
        let mut best = (points[shared.data..].to_vec(), now.clone());
        let mut kept = vec![(0, now.energy)];
        let (mut since, mut iterations) = (0, 0);
        let patience = shared.options.longest_wait();
        while iterations < u64::from(shared.options.most_iterations()) {
            // The number of iterations is not known before; some eight are usual.
            progress.tick(iterations as f64 / (iterations as f64 + 8.0))?;
            if best.1.energy.is_rounding(self.scale.radius) || since >= patience {
                break;
            }
            iterations += 1;
            self.update(&search, &now, points, &begin, spread.as_ref());
            self.measure(&active, points, areas);
            let far = Far { iteration: iterations, more: MORE };
            let far = iterations.is_multiple_of(FAR).then_some(far);
            now = self.find_matches(&search, points, areas, &now.matches, &[], far);
            let better = now.energy.mean < best.1.energy.mean * (1.0 - self.least_gain());
            since = if better { 0 } else { since + 1 };
            if now.energy.mean < best.1.energy.mean {
                best = (points[shared.data..].to_vec(), now.clone());
                kept.push((iterations, now.energy));
            }
        }
        points[shared.data..].copy_from_slice(&best.0);
        self.measure(&active, points, areas);
        if !best.1.energy.is_rounding(self.scale.radius) {
            // The matches decide what is copied, so they are searched for among all exemplars once more.
            let [least, most] = MORE_AT_THE_END;
            let more = (patches.len() * self.exemplars.len() / WORST).clamp(least, most);
            let far = Far { iteration: iterations + 1, more };
            best.1 = self.find_matches(&search, points, areas, &best.1.matches, &[], Some(far));
        }
        let shares =
            (0..patches.len()).map(|center| self.share(&patches, &best.1, center)).collect();
        let Iterate { matches, frames, normals, .. } = best.1;
        let guides = self.guides(&patches, &matches, &frames);
        Ok(Outcome { kept, iterations, guides, patches, matches, frames, normals, shares })
    }

    /// The least share by which the energy of an iteration must be smaller to count as progress. With less than 3 %, late iterations
    /// fit the noise of the exemplars: on most surfaces the distance to the truth grows while the energy falls.
    fn least_gain(&self) -> f64 {
        match self.shared.options.update {
            Update::Exact => 0.03,
            Update::Published => 1e-3,
        }
    }

    /// The standard error of a missing vertex at the beginning of the level.
    fn start_error(&self, vertex: usize) -> f64 {
        if self.shared.sharp.get(vertex - self.shared.data) == Some(&true) {
            return SHARP * self.shared.hole.edge;
        }
        let seen = HOLE * REACH * self.scale.radius;
        let times = (self.shared.hole.widths[vertex - self.shared.data] / seen).max(1.0);
        self.plate_error * times * times
    }

    fn is_published(&self) -> bool {
        self.shared.options.update == Update::Published
    }

    /// The vertices whose normals move: at the rim those of the data stay, if the publication is followed.
    fn active(&self) -> Vec<u32> {
        let Shared { surface, data, .. } = *self.shared;
        let mut active: Vec<u32> = (data as u32..self.shared.hole.rim.len() as u32)
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
            areas[vertex as usize] = self.shared.surface.area(points, vertex);
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
        let nearest = self.shared.surface.nearest(points, sources, f64::INFINITY);
        patches.sites[..patches.len()]
            .iter()
            .map(|&vertex| {
                let guide = match nearest[vertex as usize] {
                    NONE => guides[0],
                    source => guides[place[source as usize] as usize],
                };
                guide.hint(self.shared.turns, points[vertex as usize])
            })
            .collect()
    }

    fn guides(&self, patches: &Patches, matches: &[Match], frames: &[Frame]) -> Vec<Guide> {
        let each = matches.iter().zip(frames).zip(&patches.sites);
        let found = each.filter(|((found, _), _)| found.exemplar != NONE);
        found
            .map(|((found, &frame), &vertex): ((&Match, &Frame), &u32)| {
                let own = self.exemplars.frames[found.exemplar as usize];
                let from = self.exemplars.vertices[found.exemplar as usize];
                Guide { vertex, frame, own, from, turn: found.turn }
            })
            .collect()
    }

    /// Finds the matches of all patches as they are now.
    fn find_matches(
        &self,
        search: &Search<'_>,
        points: &[Point3<f64>],
        areas: &[Vector3<f64>],
        before: &[Match],
        hints: &[Hint],
        far: Option<Far>,
    ) -> Iterate {
        let patches = search.patches;
        let normals = patches.normals(areas);
        let frames: Vec<Frame> = (0..patches.len())
            .map(|center: usize| {
                let at = points[patches.sites[center] as usize];
                Frame::new(at, normals[center], self.shared.options.up.into())
            })
            .collect();
        let scene = Scene { points, normals: &normals, frames: &frames };
        let centers = (0..patches.len()).into_par_iter().with_min_len(16);
        let mut matches: Vec<Match> = centers
            .map_init(Scratch::new, |scratch: &mut Scratch, center: usize| {
                let hint = hints.get(center).copied();
                search.best(&scene, center, before, hint, far.map(|far| far.iteration), scratch)
            })
            .collect();
        if before.is_empty() {
            // Once more, for what neighbors found.
            let centers = (0..patches.len()).into_par_iter().with_min_len(16);
            matches = centers
                .map_init(Scratch::new, |scratch: &mut Scratch, center: usize| {
                    search.best(&scene, center, &matches, None, None, scratch)
                })
                .collect();
        }
        if let Some(far) = far {
            search.better_the_worst(&scene, &mut matches, far.more);
        }
        let weights = self.weights(patches, points);
        let energy = energy(&matches, &weights);
        Iterate { normals, frames, matches, weights, energy }
    }

    /// The weights of all patches: 1 around data, less the farther a patch is inside.
    fn weights(&self, patches: &Patches, points: &[Point3<f64>]) -> Vec<f64> {
        let falloff = self.shared.options.fall();
        let rate = if falloff.rate == 0.0 { 1.0 / self.edge } else { falloff.rate };
        let fall = libm::log(falloff.base) * rate;
        (0..patches.len())
            .map(|center: usize| {
                let vertex = patches.sites[center] as usize;
                match self.shared.hole.rim[vertex] {
                    NONE => 1.0,
                    _ if vertex < self.shared.data => 1.0,
                    rim => libm::exp(-fall * (points[vertex] - points[rim as usize]).norm()),
                }
            })
            .collect()
    }

    /// The weight of a patch in the mean that moves its vertices.
    fn share(&self, patches: &Patches, now: &Iterate, center: usize) -> f64 {
        match (now.matches[center].exemplar, self.shared.options.update) {
            (NONE, _) => 0.0,
            (_, Update::Exact) => now.weights[center] / patches.members.of(center).len() as f64,
            (_, Update::Published) => now.weights[center],
        }
    }

    /// Moves the missing vertices to the weighted means of their places on the exemplars: equations 9 to 13, with all vertices at once.
    fn update(
        &self,
        search: &Search<'_>,
        now: &Iterate,
        points: &mut [Point3<f64>],
        begin: &[Point3<f64>],
        spread: Option<&Spread<'_>>,
    ) {
        let patches = search.patches;
        let distances = distances(search, now, points);
        let motion = |site: usize| {
            let (mut sum, mut weight, mut residual_sq) = (0.0, 0.0, 0.0);
            for &entry in patches.entries.of(site) {
                let distance = distances[entry as usize];
                if !distance.is_nan() {
                    let center = patches.centers[entry as usize] as usize;
                    let share = self.share(patches, now, center);
                    sum += share * distance;
                    weight += share;
                    residual_sq += share * now.matches[center].ssd;
                }
            }
            if weight == 0.0 {
                return Vector3::zeros();
            }
            // The mean of two estimates of one place, weighed by the inverses of their variances.
            let vertex = patches.sites[site] as usize;
            let back = (begin[vertex] - points[vertex]).dot(&now.normals[site]);
            let start_error = self.start_error(vertex);
            let (residual_sq, start_sq) = (residual_sq / weight, start_error * start_error);
            let trust = if start_sq.is_finite() {
                start_sq / (start_sq + residual_sq).max(f64::MIN_POSITIVE)
            } else {
                1.0
            };
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

/// An iterate: the patches of the present surface, and their matches.
#[derive(Clone)]
pub(super) struct Iterate {
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
fn distances(search: &Search<'_>, now: &Iterate, points: &[Point3<f64>]) -> Vec<f64> {
    let scene = Scene { points, normals: &now.normals, frames: &now.frames };
    let of_patch = |patch: &mut PatchSamples, center: usize| {
        let Match { exemplar, turn, .. } = now.matches[center];
        search.take(&scene, center, patch);
        if exemplar == NONE {
            return vec![f64::NAN; patch.samples.len()];
        }
        let heights = search.exemplars.heights(exemplar);
        let step = search.exemplars.lattice.step;
        let mut alignment = patch.align(heights, step, search.turns.of(turn));
        for (sample, distance) in alignment.distances.iter_mut().enumerate() {
            *distance -= patch.at(&alignment.plane, sample);
        }
        alignment.distances
    };
    let centers = (0..search.patches.len()).into_par_iter().with_min_len(16);
    let all: Vec<Vec<f64>> = centers.map_init(PatchSamples::default, of_patch).collect();
    all.concat()
}
