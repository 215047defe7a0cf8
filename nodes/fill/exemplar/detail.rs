//! Restores fine detail of the copied surface, which is lost when many copies are averaged.

use nalgebra::{Point3, Vector3};

use super::compare::{PatchSamples, Plane};
use super::exemplars::Exemplars;
use super::heights::{View, sample};
use super::hole::Hole;
use super::level::Outcome;
use super::orientations::Orientations;
use super::roughness::Roughness;
use super::spread::Plate;
use super::surface::{NONE, Surface};
use super::surroundings::Surroundings;

/// Stiffness with which vertices are held at their positions while detail is added. With a twentieth of this stiffness, the added detail
/// bends the whole surface: on eight holes in each of five surfaces, fills were up to 25 % farther from the true surface.
const STIFFNESS: f64 = 2.0;

/// Maximum factor by which copied detail is amplified.
const MAX_AMPLIFICATION: f64 = 1.5;

/// Number of bisection steps to find the factor by which detail is amplified.
const HALVINGS: usize = 8;

/// The inputs for adding the detail of exemplars (patches of the input surface) to a fill.
pub(super) struct Detail<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) exemplars: &'a Exemplars,
    pub(super) outcome: &'a Outcome,
    pub(super) orientations: &'a Orientations,
    /// For each vertex of the fill, the index of the patch whose exemplar it copies.
    pub(super) cells: &'a [u32],
    /// For each vertex of the fill, whether it must not move because creases are extended across its hole; empty if all may move.
    pub(super) sharp: &'a [bool],
    /// The radius of a patch in mm.
    pub(super) radius: f64,
    pub(super) hole: &'a Hole,
    pub(super) around: &'a Surroundings,
    /// For each hole, true if it gets no detail.
    pub(super) smooth_holes: &'a [bool],
}

impl Detail<'_> {
    /// Moves the vertices of the fill, all of which must be samples, along their normals until each has about the same height over its
    /// neighbors as on its exemplar. In each hole, detail is amplified or weakened until the fill is as rough as the surface around the
    /// hole. Amplification is needed because exemplars are chosen by comparison with a surface that is too smooth, so they tend to be too
    /// smooth as well.
    ///
    /// Solves the equation of a thin plate whose rest shape is not flat: Botsch and Sorkine, "On linear variational surface
    /// deformation methods" (2008), section 4.
    pub(super) fn add(&self, points: &mut [Point3<f64>]) {
        let count = points.len();
        let data = count - self.cells.len();
        let (mut change, mut wanted) = (vec![0.0; count], vec![0.0; count]);
        let mut normals = vec![Vector3::zeros(); count];
        let mut alignments = Alignments::new(self, points);
        for (site, &cell) in self.cells.iter().enumerate() {
            let (vertex, normal) = (data + site, self.outcome.normals[site]);
            normals[vertex] = normal;
            if cell != NONE && self.sharp.get(site) != Some(&true) {
                let copied = alignments.exemplar_height(vertex as u32, cell as usize);
                if copied.is_finite() {
                    wanted[vertex] = copied;
                    change[vertex] = copied
                        - height_over_neighbors(
                            self.surface,
                            vertex as u32,
                            &normal,
                            |vertex: u32| points[vertex as usize],
                        );
                }
            }
        }
        let Some(plate) = Plate::new(self.surface, count, data, |_| STIFFNESS) else { return };
        let [once, more] = [change, wanted].map(|wanted| plate.solve(plate.load(&wanted)));
        for (number, fill) in self.hole.fills(data).iter().enumerate() {
            if self.smooth_holes[number] {
                continue;
            }
            let around = self.around.weighted(number).map(|near| (near.vertex, near.weight));
            let goal = Roughness::new(self.surface, around.collect()).measure(points);
            let filled = fill.iter().map(|&vertex| (vertex, 1.0));
            let filled = Roughness::new(self.surface, filled.collect());
            let start: Vec<Point3<f64>> = fill.iter().map(|&v| points[v as usize]).collect();
            let mut roughness_of = |times: f64| {
                for (&vertex, start) in fill.iter().zip(&start) {
                    let vertex = vertex as usize;
                    let (once, more) = (once[vertex - data][0], more[vertex - data][0]);
                    let far = times.min(1.0) * once + (times - 1.0).max(0.0) * more;
                    points[vertex] = start + normals[vertex] * far;
                }
                filled.measure(points)
            };
            let (mut low, mut high) = (0.0, MAX_AMPLIFICATION);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                *if roughness_of(middle) < goal { &mut low } else { &mut high } = middle;
            }
            roughness_of(low);
        }
    }
}

/// The alignments of exemplars (patches of the input surface) with the patches that they match.
struct Alignments<'a> {
    detail: &'a Detail<'a>,
    points: &'a [Point3<f64>],
    /// For each vertex, the index of its sample; [`NONE`] if the vertex is not a sample.
    place: Vec<u32>,
    /// For each patch, the plane of the distances between the patch and its exemplar, and the shift of its samples on the exemplar,
    /// computed on first use.
    planes: Vec<Option<(Plane, [f64; 2])>>,
}

impl<'a> Alignments<'a> {
    fn new(detail: &'a Detail<'a>, points: &'a [Point3<f64>]) -> Self {
        let patches = &detail.outcome.patches;
        let mut place = vec![NONE; points.len()];
        (0..).zip(&patches.sites).for_each(|(site, &vertex)| place[vertex as usize] = site);
        Self { detail, points, place, planes: vec![None; patches.len()] }
    }

    /// Returns the sum of the differences between a vertex of the fill and its neighbors along its normal, as on the exemplar of the patch
    /// `center`. The sum is the mean of two values: one measured on the exemplar at the positions of the vertices, the other at the nearest
    /// vertex of the input mesh. The first value blurs roughness between adjacent vertices; the second one counts a different triangulation
    /// as roughness. The result is NaN if the exemplar has no surface at one of these positions.
    fn exemplar_height(&mut self, vertex: u32, center: usize) -> f64 {
        let Detail { surface, exemplars, outcome, orientations, cells, .. } = *self.detail;
        let plane =
            *self.planes[center].get_or_insert_with(|| fit_plane(self.detail, self.points, center));
        let found = &outcome.matches[center];
        let (frame, own) = (&outcome.frames[center], &exemplars.frames[found.exemplar as usize]);
        let normal = outcome.normals[self.place[vertex as usize] as usize];
        let there = height_over_neighbors(surface, vertex, &normal, |vertex: u32| {
            self.copied_point(vertex, center, &plane)
        });
        let from = exemplars.vertices[found.exemplar as usize];
        let to = exemplars.map_point(found, orientations, frame, self.points[vertex as usize]);
        let data = self.points.len() - cells.len();
        let source = surface.walk_to_nearest(self.points, from, &to, data as u32);
        let nearest =
            height_over_neighbors(surface, source, &own.z, |vertex| self.points[vertex as usize]);
        let degrees = [vertex, source].map(|vertex| surface.ring(vertex).len().max(1) as f64);
        0.5 * (there + nearest * degrees[0] / degrees[1])
    }

    /// Returns the position that a vertex has on the exemplar of the patch `center`, after aligning the exemplar with the patch.
    fn copied_point(
        &self,
        vertex: u32,
        center: usize,
        (plane, shift): &(Plane, [f64; 2]),
    ) -> Point3<f64> {
        let Detail { exemplars, outcome, orientations, radius, .. } = *self.detail;
        let point = self.points[vertex as usize];
        let normal = outcome.normals[self.place[vertex as usize] as usize];
        let found = &outcome.matches[center];
        let sample = sample(&outcome.frames[center], &point, &normal);
        let view = View::<1>::new(
            &[sample],
            exemplars.lattice.step,
            orientations.get(found.orientation),
            *shift,
        );
        let [distance] = view.distances(exemplars.heights(found.exemplar));
        let [u, v] = sample.at.map(|x| x / radius);
        point + normal * (distance - plane[0] - plane[1] * u - plane[2] * v)
    }
}

/// Returns the plane that fits the distances between a patch and its exemplar.
fn fit_plane(detail: &Detail<'_>, points: &[Point3<f64>], center: usize) -> (Plane, [f64; 2]) {
    let Detail { exemplars, outcome, orientations, radius, .. } = *detail;
    let (patches, found) = (&outcome.patches, &outcome.matches[center]);
    let mut patch = PatchSamples::default();
    patch.samples.extend(patches.members.list(center).iter().map(|&site| {
        let point = &points[patches.sites[site as usize] as usize];
        sample(&outcome.frames[center], point, &outcome.normals[site as usize])
    }));
    patch.prepare(radius, true);
    patch.shifts = exemplars.are_shifted;
    let heights = exemplars.heights(found.exemplar);
    let aligned = patch.align(heights, exemplars.lattice.step, orientations.get(found.orientation));
    (aligned.plane, aligned.shift)
}

/// Returns the sum of the differences between a vertex and its neighbors along a normal.
fn height_over_neighbors(
    surface: &Surface<'_>,
    vertex: u32,
    normal: &Vector3<f64>,
    place: impl Fn(u32) -> Point3<f64>,
) -> f64 {
    let at = place(vertex);
    let spokes = surface.ring(vertex).iter().map(|&other| at - place(other));
    spokes.sum::<Vector3<f64>>().dot(normal)
}
