//! One level of a completion (filling holes by copying): finds a match for each patch, moves the vertices of the fill to the weighted mean
//! of the matches, and repeats both steps.

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::best_match::Match;
use super::compare::PatchSamples;
use super::exemplars::{Exemplars, REACH};
use super::frame::Frame;
use super::hole::Hole;
use super::orientations::Orientations;
use super::patches::{Patches, Scale};
use super::seam::Seam;
use super::search::{Hint, Scene, Scratch, Search};
use super::smoothness::HOLE_RATIO;
use super::spread::Spread;
use super::surface::{NONE, Surface};
use super::tints::Color;
use super::{ExemplarOptions, Update};

/// The inputs and settings shared by all levels of a completion.
pub(super) struct CompletionContext<'a> {
    pub(super) surface: &'a Surface<'a>,
    /// The colors of all vertices; empty if colors are not compared.
    pub(super) colors: &'a [Color],
    /// The number of vertices of the input mesh.
    pub(super) n_data_vertices: usize,
    pub(super) options: &'a ExemplarOptions,
    pub(super) orientations: &'a Orientations,
    pub(super) hole: &'a Hole,
    /// For each vertex of the fill, whether creases are extended across its hole in the initial fill; empty if they are across no hole.
    pub(super) sharp: &'a [bool],
    /// For each input vertex, the distance to the nearest vertex of the fill.
    pub(super) distances: &'a [f64],
}

/// The energy of an iteration, which measures the distances between patches and their matches, in mm^2.
#[derive(Clone, Copy, Debug)]
pub(super) struct Energy {
    /// The weighted mean of the squared distances between patches and matches: equation 1 of Kawai, Sato and Yokoya (2008).
    pub(super) mean: f64,
    /// The largest mean squared distance between a patch and its match.
    pub(super) max: f64,
    /// The bends at the seam, see [`Seam::bends`]; 0 with [`Update::Exact`].
    bends: f64,
}

impl Energy {
    /// Returns the measure by which iterates are compared. The mean alone is lowest where many exemplars agree, which is not the nearest
    /// shape: the fill may leave the surface at an angle all around, as a dimple does.
    pub(super) fn measure(&self) -> f64 {
        self.mean + self.bends
    }

    /// Returns true if the energy is so small that it consists only of rounding errors. `radius` is the radius of a patch.
    fn is_rounding(&self, radius: f64) -> bool {
        let rounding = ROUNDING * radius;
        self.mean <= rounding * rounding
    }
}

/// The best iterate (lowest [measure](Energy::measure)) of a level, and the iterations that led to it.
pub(super) struct Outcome {
    /// The iterations with a lower measure than all earlier ones, and their energies.
    pub(super) improvements: Vec<(u64, Energy)>,
    /// The number of iterations that the level performed.
    pub(super) iterations: u64,
    pub(super) guides: Vec<Guide>,
    pub(super) patches: Patches,
    pub(super) matches: Vec<Match>,
    pub(super) frames: Vec<Frame>,
    /// The normals at all samples.
    pub(super) normals: Vec<Vector3<f64>>,
    /// The weight of each patch in the weighted mean to which its vertices move.
    pub(super) patch_weights: Vec<f64>,
}

impl Outcome {
    /// Returns true if the exemplars fit the patches exactly, so that there is no detail to add.
    pub(super) fn is_exact(&self, radius: f64) -> bool {
        self.improvements.last().is_some_and(|(_, energy)| energy.is_rounding(radius))
    }
}

/// A patch and its match on one level, used as a hint for the patches of the next level.
#[derive(Clone, Copy)]
pub(super) struct Guide {
    pub(super) vertex: u32,
    frame: Frame,
    own: Frame,
    from: u32,
    orientation: u8,
}

impl Guide {
    /// Returns the input vertex that the patch copies.
    pub(super) fn exemplar_vertex(&self) -> u32 {
        self.from
    }

    /// Maps a point of the patch to its exemplar. Returns the position and orientation at which the next level tries exemplars.
    fn hint(&self, orientations: &Orientations, point: Point3<f64>) -> Hint {
        let [u, v, w] = self.frame.local(point - self.frame.origin);
        let [x, y] = orientations.get(self.orientation).apply([u, v]);
        Hint {
            from: self.from,
            to: self.own.origin + self.own.global([x, y, w]),
            orientation: self.orientation,
        }
    }
}

/// Number of iterations between searches of all exemplars. In the other iterations, only exemplars near known matches are compared.
const FULL_SEARCH_INTERVAL: u64 = 4;

/// A search of all exemplars, instead of only those near known matches.
#[derive(Clone, Copy)]
struct FullSearch {
    iteration: u64,
    /// The number of additional comparisons, in which the patches with the worst matches are compared with all exemplars.
    more: usize,
}

/// Number of comparisons with all exemplars in each full search. They are used for the patches with the worst matches, which have most of
/// the energy and few similar candidates. With 0 comparisons, the distances of matches on sharp and rugged surfaces are a fifth larger than
/// those of the best exemplars.
const COMPARISONS: usize = 80_000;

/// The minimum and maximum number of comparisons with all exemplars at the end of a level. Between these limits, one in [`WORST_DIVISOR`]
/// patches is compared with all exemplars.
const FINAL_COMPARISONS: [usize; 2] = [250_000, 1_200_000];
const WORST_DIVISOR: usize = 12;

/// Minimum relative decrease of the measure that counts as progress. Without it, late iterations fit the noise of the exemplars: on most
/// surfaces the distance to the true surface grows while the energy falls.
const MIN_GAIN: f64 = 0.03;

/// Distances between patches and exemplars below this fraction of a patch's radius are rounding errors.
const ROUNDING: f64 = 1e-10;

/// Standard error of an initial fill across which creases are extended, in edge lengths. It is the deviation of the input surface from the
/// planes and paraboloids that meet in the creases. With a larger value, the copied patches would round the creases.
const SHARP_ERROR: f64 = 0.1;

/// A level of a completion: the size and spacing of its patches, and the exemplars to compare with them.
pub(super) struct CompletionLevel<'a> {
    pub(super) shared: &'a CompletionContext<'a>,
    pub(super) scale: Scale,
    pub(super) number: u64,
    /// The target distance between samples.
    pub(super) edge: f64,
    /// The standard error of a thin plate over the largest hole that a patch can span; infinite if the initial fill is not a thin plate and
    /// thus no estimate of the surface.
    pub(super) plate_error: f64,
    pub(super) exemplars: &'a Exemplars,
}

impl CompletionLevel<'_> {
    /// Runs the iterations of the level. Afterwards `points` and `areas` are those of the best iterate.
    pub(super) fn run(
        &self,
        points: &mut [Point3<f64>],
        areas: &mut [Vector3<f64>],
        guides: &[Guide],
        progress: &Progress<'_>,
    ) -> Result<Outcome, CancelledError> {
        let shared = self.shared;
        let original = points[..shared.n_data_vertices].to_vec();
        let patches = Patches::new(
            shared.surface,
            points,
            shared.n_data_vertices,
            shared.distances,
            &self.scale,
        );
        let movable = &patches.sites[..patches.movable];
        let spread = (patches.movable < points.len() - shared.n_data_vertices)
            .then(|| Spread::new(shared.surface, points.len(), shared.n_data_vertices, movable))
            .flatten();
        let begin = points.to_vec();
        let active = self.active();
        let search = Search {
            surface: shared.surface,
            data: &original,
            colors: shared.colors,
            patches: &patches,
            exemplars: self.exemplars,
            orientations: shared.orientations,
            radius: self.scale.radius,
            seed: self.number,
        };
        let hints = self.hints(&patches, points, guides);
        // Only a fill that starts as a cone bends at the seam for long.
        let seam = self
            .is_published()
            .then(|| Seam::new(shared.surface, points, shared.n_data_vertices, shared.hole.edge));
        let mut now = self.find_matches(
            &search,
            points,
            areas,
            &[],
            &hints,
            Some(FullSearch { iteration: 0, more: COMPARISONS }),
        );
        now.energy.bends = seam.as_ref().map_or(0.0, |seam| seam.bends(points));
        let mut best = (points[shared.n_data_vertices..].to_vec(), now.clone());
        let mut kept = vec![(0, now.energy)];
        let (mut since, mut iterations) = (0, 0);
        let max_wait = shared.options.max_wait();
        while iterations < u64::from(shared.options.max_iterations()) {
            // The number of iterations is not known in advance; assume the usual number of about 8.
            progress.tick(iterations as f64 / (iterations as f64 + 8.0))?;
            if best.1.energy.is_rounding(self.scale.radius) || since >= max_wait {
                break;
            }
            iterations += 1;
            self.move_vertices(&search, &now, points, &begin, spread.as_ref());
            self.update_areas(&active, points, areas);
            let far = FullSearch { iteration: iterations, more: COMPARISONS };
            let far = iterations.is_multiple_of(FULL_SEARCH_INTERVAL).then_some(far);
            now = self.find_matches(&search, points, areas, &now.matches, &[], far);
            now.energy.bends = seam.as_ref().map_or(0.0, |seam| seam.bends(points));
            let [measure, lowest] = [&now, &best.1].map(|iterate| iterate.energy.measure());
            since = if measure < lowest * (1.0 - MIN_GAIN) { 0 } else { since + 1 };
            if measure < lowest {
                best = (points[shared.n_data_vertices..].to_vec(), now.clone());
                kept.push((iterations, now.energy));
            }
        }
        points[shared.n_data_vertices..].copy_from_slice(&best.0);
        self.update_areas(&active, points, areas);
        if !best.1.energy.is_rounding(self.scale.radius) {
            // The final matches determine what is copied, so search all exemplars once more.
            let [min, max] = FINAL_COMPARISONS;
            let more = (patches.len() * self.exemplars.len() / WORST_DIVISOR).clamp(min, max);
            let far = FullSearch { iteration: iterations + 1, more };
            best.1 = self.find_matches(&search, points, areas, &best.1.matches, &[], Some(far));
        }
        let shares =
            (0..patches.len()).map(|center| self.patch_weight(&patches, &best.1, center)).collect();
        let Iterate { matches, frames, normals, .. } = best.1;
        let guides = self.guides(&patches, &matches, &frames);
        Ok(Outcome {
            improvements: kept,
            iterations,
            guides,
            patches,
            matches,
            frames,
            normals,
            patch_weights: shares,
        })
    }

    /// Returns the standard error of the position of a fill's vertex at the beginning of the level.
    fn start_error(&self, vertex: usize) -> f64 {
        if self.shared.sharp.get(vertex - self.shared.n_data_vertices) == Some(&true) {
            return SHARP_ERROR * self.shared.hole.edge;
        }
        let seen = HOLE_RATIO * REACH * self.scale.radius;
        let times = (self.shared.hole.widths[vertex - self.shared.n_data_vertices] / seen).max(1.0);
        self.plate_error * times * times
    }

    fn is_published(&self) -> bool {
        self.shared.options.update == Update::Published
    }

    /// Returns the vertices whose normals change during the level. With `Update::Published`, these do not include the rims of holes.
    fn active(&self) -> Vec<u32> {
        let CompletionContext { surface, n_data_vertices: data, .. } = *self.shared;
        let mut active: Vec<u32> = (data as u32..self.shared.hole.rim.len() as u32)
            .flat_map(|vertex| surface.ring(vertex).iter().copied().chain([vertex]))
            .filter(|&vertex| data <= vertex as usize || !self.is_published())
            .collect();
        active.sort_unstable();
        active.dedup();
        active
    }

    /// Recomputes the area vectors of the `active` vertices.
    fn update_areas(&self, active: &[u32], points: &[Point3<f64>], areas: &mut [Vector3<f64>]) {
        for &vertex in active {
            areas[vertex as usize] = self.shared.surface.area(points, vertex);
        }
    }

    /// Returns hints for the patches of this level: for each patch, the position of its center on an exemplar of the previous level.
    fn hints(&self, patches: &Patches, points: &[Point3<f64>], guides: &[Guide]) -> Vec<Hint> {
        if guides.is_empty() {
            return Vec::new();
        }
        let mut index_of = vec![NONE; points.len()];
        (0..).zip(guides).for_each(|(k, guide)| index_of[guide.vertex as usize] = k);
        let sources = guides.iter().map(|guide| guide.vertex);
        let nearest = self.shared.surface.nearest(points, sources, f64::INFINITY);
        patches.sites[..patches.len()]
            .iter()
            .map(|&vertex| {
                let guide = match nearest[vertex as usize] {
                    NONE => guides[0],
                    source => guides[index_of[source as usize] as usize],
                };
                guide.hint(self.shared.orientations, points[vertex as usize])
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
                Guide { vertex, frame, own, from, orientation: found.orientation }
            })
            .collect()
    }

    /// Finds the matches of all patches for the current positions of the vertices.
    fn find_matches(
        &self,
        search: &Search<'_>,
        points: &[Point3<f64>],
        areas: &[Vector3<f64>],
        before: &[Match],
        hints: &[Hint],
        far: Option<FullSearch>,
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
            // The second pass also tries the exemplars next to the matches of adjacent patches, which the first pass found.
            let centers = (0..patches.len()).into_par_iter().with_min_len(16);
            matches = centers
                .map_init(Scratch::new, |scratch: &mut Scratch, center: usize| {
                    search.best(&scene, center, &matches, None, None, scratch)
                })
                .collect();
        }
        if let Some(far) = far {
            search.improve_worst_matches(&scene, &mut matches, far.more);
        }
        let weights = self.weights(patches, points);
        let energy = energy(&matches, &weights);
        Iterate { normals, frames, matches, weights, energy }
    }

    /// Returns the weights of all patches: 1 outside of holes, decreasing inside them with the distance from the rim.
    fn weights(&self, patches: &Patches, points: &[Point3<f64>]) -> Vec<f64> {
        let falloff = self.shared.options.falloff_or_default();
        let rate = if falloff.rate == 0.0 { 1.0 / self.edge } else { falloff.rate };
        let fall = libm::log(falloff.base) * rate;
        (0..patches.len())
            .map(|center: usize| {
                let vertex = patches.sites[center] as usize;
                match self.shared.hole.rim[vertex] {
                    NONE => 1.0,
                    _ if vertex < self.shared.n_data_vertices => 1.0,
                    rim => libm::exp(-fall * (points[vertex] - points[rim as usize]).norm()),
                }
            })
            .collect()
    }

    /// Returns the weight of a patch in the mean to which its vertices move.
    fn patch_weight(&self, patches: &Patches, now: &Iterate, center: usize) -> f64 {
        match (now.matches[center].exemplar, self.shared.options.update) {
            (NONE, _) => 0.0,
            (_, Update::Exact) => now.weights[center] / patches.members.list(center).len() as f64,
            (_, Update::Published) => now.weights[center],
        }
    }

    /// Moves the vertices of the fill to the weighted means of their positions on the exemplars, all vertices at once: equations 9 to 13 of
    /// Kawai, Sato and Yokoya (2008).
    fn move_vertices(
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
            for &entry in patches.entries.list(site) {
                let distance = distances[entry as usize];
                if !distance.is_nan() {
                    let center = patches.centers[entry as usize] as usize;
                    let own_weight = self.patch_weight(patches, now, center);
                    sum += own_weight * distance;
                    weight += own_weight;
                    residual_sq += own_weight * now.matches[center].ssd;
                }
            }
            if weight == 0.0 {
                return Vector3::zeros();
            }
            // The new position is the mean of two estimates, the exemplars' and the initial fill's, weighted by their inverse variances.
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

/// One iterate: the current normals, frames and weights of the patches, and their matches.
#[derive(Clone)]
pub(super) struct Iterate {
    normals: Vec<Vector3<f64>>,
    frames: Vec<Frame>,
    matches: Vec<Match>,
    weights: Vec<f64>,
    energy: Energy,
}

/// Returns the energy of the matches, equation 1 of Kawai, Sato and Yokoya (2008), summed in the order of the patches.
fn energy(matches: &[Match], weights: &[f64]) -> Energy {
    let (mut sum, mut weight, mut max) = (0.0, 0.0, 0.0_f64);
    for (found, &own) in matches.iter().zip(weights) {
        if found.exemplar != NONE {
            sum += own * found.ssd;
            weight += own;
            max = max.max(found.ssd);
        }
    }
    let mean = if weight > 0.0 { sum / weight } else { f64::INFINITY };
    Energy { mean, max: if weight > 0.0 { max } else { f64::INFINITY }, bends: 0.0 }
}

/// Returns, for each patch, the distance of each of its samples to the patch's exemplar, along the sample's normal.
fn distances(search: &Search<'_>, now: &Iterate, points: &[Point3<f64>]) -> Vec<f64> {
    let scene = Scene { points, normals: &now.normals, frames: &now.frames };
    let centers = (0..search.patches.len()).into_par_iter().with_min_len(16);
    let distances: Vec<Vec<f64>> = centers
        .map_init(PatchSamples::default, |patch, center| {
            search.load_patch(&scene, center, patch);
            match_distances(search, &now.matches[center], patch)
        })
        .collect();
    distances.concat()
}

/// Returns the distance of each sample of a patch to the patch's match, along the sample's normal; NaN without a match.
fn match_distances(search: &Search<'_>, found: &Match, patch: &PatchSamples) -> Vec<f64> {
    if found.exemplar == NONE {
        return vec![f64::NAN; patch.samples.len()];
    }
    let heights = search.exemplars.heights(found.exemplar);
    let step = search.exemplars.lattice.step;
    let mut alignment = patch.align(heights, step, search.orientations.get(found.orientation));
    for (sample, distance) in alignment.distances.iter_mut().enumerate() {
        *distance -= patch.plane_height(&alignment.plane, sample);
    }
    alignment.distances
}
