//! The fine detail of exemplars, which the mean of many of them has lost.

use nalgebra::{Point3, Vector3};

use super::compare::{PatchSamples, Plane};
use super::exemplars::Exemplars;
use super::heights::{View, sample};
use super::level::Outcome;
use super::roughness::Roughness;
use super::spread::Plate;
use super::surface::{NONE, Surface};
use super::turns::Turns;

/// How strongly the shape holds against the detail. With a twentieth of it, detail bends the shared: on eight holes each of five surfaces,
/// fills were up to a quarter farther from the truth.
const HOLD: f64 = 2.0;

/// The most by which detail is amplified.
const MOST: f64 = 3.0;

/// Halvings in which the amplification is found.
const HALVINGS: usize = 8;

/// What detail is made of.
pub(super) struct Detail<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) exemplars: &'a Exemplars,
    pub(super) outcome: &'a Outcome,
    pub(super) turns: &'a Turns,
    /// The patch that each missing vertex copies.
    pub(super) cells: &'a [u32],
    /// Marks the missing vertices of holes across which creases are extended, which stay where they are; none, if empty.
    pub(super) sharp: &'a [bool],
    /// The radius of a patch.
    pub(super) radius: f64,
}

impl Detail<'_> {
    /// Moves the missing vertices, all of which are sites, along their normals until each has about the height over its neighbors that it
    /// has on its exemplar. Detail is amplified until the surface is as rough as the data's vertices `around` the hole: matches are chosen
    /// by a surface that is too smooth, and so tend to be too smooth themselves.
    ///
    /// This is the equation of a thin plate whose rest shape is not flat: Botsch and Sorkine, "On linear variational surface deformation
    /// methods" (2008), section 4.
    pub(super) fn add(&self, points: &mut [Point3<f64>], around: Vec<u32>) {
        let count = points.len();
        let data = count - self.cells.len();
        let (mut change, mut wanted) = (vec![0.0; count], vec![0.0; count]);
        let mut normals = vec![Vector3::zeros(); count];
        let mut alignments = Alignments::new(self, points);
        for (site, &cell) in self.cells.iter().enumerate() {
            let (vertex, normal) = (data + site, self.outcome.normals[site]);
            normals[vertex] = normal;
            if cell != NONE && self.sharp.get(site) != Some(&true) {
                let copied = alignments.over(vertex as u32, cell as usize);
                if copied.is_finite() {
                    wanted[vertex] = copied;
                    change[vertex] = copied
                        - over(self.surface, vertex as u32, &normal, |vertex: u32| {
                            points[vertex as usize]
                        });
                }
            }
        }
        let Some(plate) = Plate::new(self.surface, count, data, |_| HOLD) else { return };
        let [once, more] = [change, wanted].map(|wanted| plate.solve(plate.load(&wanted)));
        let goal = Roughness::new(self.surface, around).of(points);
        let filled = Roughness::new(self.surface, (data as u32..count as u32).collect());
        let start = points[data..].to_vec();
        let mut try_times = |times: f64| {
            for (k, start) in start.iter().enumerate() {
                let far = once[k][0] + (times - 1.0) * more[k][0];
                points[data + k] = start + normals[data + k] * far;
            }
            filled.of(points)
        };
        if try_times(1.0) < goal {
            let (mut low, mut high) = (1.0, MOST);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                *if try_times(middle) < goal { &mut low } else { &mut high } = middle;
            }
            try_times(low);
        }
    }
}

/// The alignments of exemplars with their patches.
struct Alignments<'a> {
    detail: &'a Detail<'a>,
    points: &'a [Point3<f64>],
    /// The sample at each vertex.
    place: Vec<u32>,
    /// The plane between each patch and its exemplar, once it is asked for.
    planes: Vec<Option<Plane>>,
}

impl<'a> Alignments<'a> {
    fn new(detail: &'a Detail<'a>, points: &'a [Point3<f64>]) -> Self {
        let patches = &detail.outcome.patches;
        let mut place = vec![NONE; points.len()];
        (0..).zip(&patches.sites).for_each(|(site, &vertex)| place[vertex as usize] = site);
        Self { detail, points, place, planes: vec![None; patches.len()] }
    }

    /// How far a missing vertex would be over all its neighbors together, along its normal, as on the exemplar of a patch: the mean of
    /// what the exemplar has at the places of the vertices, and of what its vertex nearest to this one has. The former blurs what is rough
    /// from vertex to vertex, the latter takes triangles that lie otherwise for roughness. NaN where there is no exemplar.
    fn over(&mut self, vertex: u32, center: usize) -> f64 {
        let Detail { surface, exemplars, outcome, turns, cells, .. } = *self.detail;
        let plane =
            *self.planes[center].get_or_insert_with(|| plane(self.detail, self.points, center));
        let found = &outcome.matches[center];
        let (frame, own) = (&outcome.frames[center], &exemplars.frames[found.exemplar as usize]);
        let normal = outcome.normals[self.place[vertex as usize] as usize];
        let there =
            over(surface, vertex, &normal, |vertex: u32| self.copied(vertex, center, &plane));
        let from = exemplars.vertices[found.exemplar as usize];
        let to = exemplars.place(found, turns, frame, self.points[vertex as usize]);
        let data = self.points.len() - cells.len();
        let source = surface.descend(self.points, from, &to, data as u32);
        let nearest = over(surface, source, &own.z, |vertex| self.points[vertex as usize]);
        let degrees = [vertex, source].map(|vertex| surface.ring(vertex).len().max(1) as f64);
        0.5 * (there + nearest * degrees[0] / degrees[1])
    }

    /// Where the exemplar of a patch has a vertex, as it lies against the patch.
    fn copied(&self, vertex: u32, center: usize, plane: &Plane) -> Point3<f64> {
        let Detail { exemplars, outcome, turns, radius, .. } = *self.detail;
        let point = self.points[vertex as usize];
        let normal = outcome.normals[self.place[vertex as usize] as usize];
        let found = &outcome.matches[center];
        let sample = sample(&outcome.frames[center], &point, &normal);
        let view = View::<1>::new(&[sample], exemplars.lattice.step, turns.of(found.turn));
        let [distance] = view.distances(exemplars.heights(found.exemplar));
        let [u, v] = sample.at.map(|x| x / radius);
        point + normal * (distance - plane[0] - plane[1] * u - plane[2] * v)
    }
}

/// The plane between a patch and its exemplar.
fn plane(detail: &Detail<'_>, points: &[Point3<f64>], center: usize) -> Plane {
    let Detail { exemplars, outcome, turns, radius, .. } = *detail;
    let (patches, found) = (&outcome.patches, &outcome.matches[center]);
    let mut patch = PatchSamples::default();
    patch.samples.extend(patches.members.of(center).iter().map(|&site| {
        let point = &points[patches.sites[site as usize] as usize];
        sample(&outcome.frames[center], point, &outcome.normals[site as usize])
    }));
    patch.prepare(radius, true);
    let heights = exemplars.heights(found.exemplar);
    patch.align(heights, exemplars.lattice.step, turns.of(found.turn)).plane
}

/// How far a vertex is over all its neighbors together, along a normal.
fn over(
    surface: &Surface<'_>,
    vertex: u32,
    normal: &Vector3<f64>,
    place: impl Fn(u32) -> Point3<f64>,
) -> f64 {
    let at = place(vertex);
    let spokes = surface.ring(vertex).iter().map(|&other| at - place(other));
    spokes.sum::<Vector3<f64>>().dot(normal)
}
