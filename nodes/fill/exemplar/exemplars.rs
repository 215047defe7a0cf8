//! The exemplars from which a fill is built: height fields of the input surface around some of its vertices.

use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::best_match::Match;
use super::descriptor::{Basis, Descriptor, Polar, Rings};
use super::frame::{Frame, Orientation};
use super::heights::{Lattice, NODES, round_out};
use super::kd_tree::KdTree;
use super::orientations::Orientations;
use super::surface::{Marks, NONE, Surface};
use super::tints::{Color, PART, Tint};

/// Maximum number of exemplars (patches of the input surface) on a level: about 60 MB of heights. With more exemplars, neighboring
/// exemplars of a dense scan would hardly differ.
const MAX_EXEMPLARS: usize = 50_000;

/// The surface from which the exemplars of a level are taken, and the lengths used on that level.
pub(super) struct Source<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) points: &'a [Point3<f64>],
    /// Twice the sum of the area vectors of the faces around each vertex.
    pub(super) areas: &'a [Vector3<f64>],
    /// The colors of all vertices; empty if colors are not compared.
    pub(super) colors: &'a [Color],
    /// The number of vertices and of faces of the input mesh.
    pub(super) n_data_vertices: usize,
    pub(super) n_data_faces: usize,
    pub(super) up: Vector3<f64>,
    /// The radius of a patch, and the radius within which normals are averaged for its frame.
    pub(super) radius: f64,
    pub(super) normal_radius: f64,
    /// The distance between the centers of exemplars; if 0, all input vertices are centers.
    pub(super) spacing: f64,
    /// True for `Update::Published`: exemplars may be cut off by borders of the input mesh, and an exemplar stays at the position given by
    /// its frame.
    pub(super) is_published: bool,
}

/// Minimum fraction of an exemplar's disk that must be covered by the surface.
const MIN_COVER: f64 = 0.9;

/// Radius of the disk over which the heights of an exemplar are measured, in patch radii.
pub(super) const REACH: f64 = 1.2;

/// The exemplars of a level: height fields around vertices of the input mesh.
pub(super) struct Exemplars {
    /// The center vertex of each exemplar.
    pub(super) vertices: Vec<u32>,
    pub(super) frames: Vec<Frame>,
    heights: Vec<f32>,
    /// The colors of each exemplar; empty if colors are not compared.
    pub(super) tints: Vec<Tint>,
    /// For each input vertex, the exemplar that represents it; [`NONE`] if no exemplar is near.
    pub(super) owners: Vec<u32>,
    pub(super) lattice: Lattice,
    pub(super) polar: Polar,
    /// True if exemplars are shifted sideways to fit a patch. With `Update::Published` they are not: from a cone, the iteration would
    /// drift.
    pub(super) are_shifted: bool,
    pub(super) basis: Basis,
    pub(super) tree: KdTree,
}

impl Exemplars {
    /// Measures the surface around the vertices for which `is_allowed` is true, and keeps the exemplars that cover enough of their disk.
    pub(super) fn new(
        source: &Source<'_>,
        is_allowed: impl Fn(u32) -> bool + Sync,
        progress: &Progress<'_>,
    ) -> Result<Self, CancelledError> {
        let (chosen, owners) = source.choose(is_allowed);
        let lattice = Lattice::new(REACH * source.radius);
        let polar = Polar::new(source.radius, lattice.step, !source.is_published);
        let measured = source.measure(&chosen, &lattice, &polar, progress);
        progress.check()?;
        let good: Vec<u32> = (0..chosen.len() as u32)
            .filter(|&k| source.is_published || MIN_COVER <= measured.vertices[k as usize].cover)
            .collect();
        let mut index_of = vec![NONE; chosen.len()];
        (0..).zip(&good).for_each(|(new, &old)| index_of[old as usize] = new);
        let mut heights = measured.heights;
        // Move the heights of kept exemplars to the front, in place.
        for (new, &old) in good.iter().enumerate() {
            let old = old as usize;
            heights.copy_within(old * NODES..(old + 1) * NODES, new * NODES);
        }
        heights.truncate(good.len() * NODES);
        let kept: Vec<&Measurement> =
            good.iter().map(|&k| &measured.vertices[k as usize]).collect();
        let rings: Vec<Rings> = kept.iter().map(|vertex| vertex.rings).collect();
        let basis = Basis::new(&rings);
        let mut descriptors: Vec<Descriptor> =
            rings.par_iter().with_min_len(64).map(|rings| basis.project(rings)).collect();
        let tints: Vec<Tint> = match source.colors {
            [] => Vec::new(),
            _ => kept.iter().map(|vertex| vertex.tint).collect(),
        };
        descriptors.iter_mut().zip(&tints).for_each(|(own, tint)| tint.put(own));
        progress.check()?;
        Ok(Self {
            vertices: good.iter().map(|&k| chosen[k as usize]).collect(),
            frames: kept.iter().map(|vertex| vertex.frame).collect(),
            heights,
            tints,
            owners: owners
                .iter()
                .map(|&k| if k == NONE { NONE } else { index_of[k as usize] })
                .collect(),
            lattice,
            polar,
            are_shifted: !source.is_published,
            basis,
            tree: KdTree::new(&descriptors),
        })
    }

    /// The number of exemplars.
    pub(super) fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Maps a point of a patch to the corresponding point on the exemplar `found`.
    pub(super) fn map_point(
        &self,
        found: &Match,
        orientations: &Orientations,
        frame: &Frame,
        point: Point3<f64>,
    ) -> Point3<f64> {
        let own = &self.frames[found.exemplar as usize];
        let [u, v, w] = frame.local(point - frame.origin);
        let [x, y] = orientations.get(found.orientation).apply([u, v]);
        own.origin + own.global([x, y, w])
    }

    /// Returns the heights of an exemplar.
    #[inline(always)]
    pub(super) fn heights(&self, exemplar: u32) -> &[f32] {
        &self.heights[exemplar as usize * NODES..(exemplar as usize + 1) * NODES]
    }
}

/// The height fields, frames and colors around the chosen vertices.
struct Measurements {
    /// The heights at all vertices, [`NODES`] per vertex.
    heights: Vec<f32>,
    vertices: Vec<Measurement>,
}

/// The measurements around one vertex, except its heights.
struct Measurement {
    frame: Frame,
    rings: Rings,
    tint: Tint,
    /// The fraction of the disk around the vertex that is covered by the surface.
    cover: f64,
}

/// The number of vertices that one task measures with the same `Marks`.
const BLOCK_SIZE: usize = 64;

impl Source<'_> {
    /// Chooses vertices at least `spacing` apart. Also returns, for each input vertex, the index of the chosen vertex that represents it.
    fn choose(&self, is_allowed: impl Fn(u32) -> bool + Sync) -> (Vec<u32>, Vec<u32>) {
        let all: Vec<u32> =
            (0..self.n_data_vertices as u32).filter(|&vertex| is_allowed(vertex)).collect();
        let mut owners = vec![NONE; self.n_data_vertices];
        let mut spacing = self.spacing;
        if all.len() > MAX_EXEMPLARS {
            // Choose the spacing such that about `MAX_EXEMPLARS` disks cover the area.
            let area: f64 = all.iter().map(|&vertex| self.areas[vertex as usize].norm()).sum();
            spacing = spacing.max((area / 6.0 / (0.5 * MAX_EXEMPLARS as f64)).sqrt());
        }
        if spacing == 0.0 {
            (0..).zip(&all).for_each(|(k, &vertex)| owners[vertex as usize] = k);
            return (all, owners);
        }
        let mut chosen = Vec::new();
        let mut marks = Marks::new(self.points.len());
        for vertex in all {
            if owners[vertex as usize] != NONE {
                continue;
            }
            for other in self.surface.ball(
                self.points,
                vertex,
                spacing,
                |other: u32| (other as usize) < self.n_data_vertices,
                &mut marks,
            ) {
                let own = &mut owners[other as usize];
                if *own == NONE {
                    *own = chosen.len() as u32;
                }
            }
            chosen.push(vertex);
        }
        (chosen, owners)
    }

    /// Measures the surface around the chosen vertices. The result is incomplete if the evaluation is cancelled meanwhile.
    fn measure(
        &self,
        chosen: &[u32],
        lattice: &Lattice,
        polar: &Polar,
        progress: &Progress<'_>,
    ) -> Measurements {
        let mut heights = maquette_value::memory::huge_vec(chosen.len() * NODES);
        let straight = Orientation::list(1, false)[0];
        let blocks: Vec<Vec<Measurement>> = chosen
            .par_chunks(BLOCK_SIZE)
            .zip(heights.par_chunks_mut(BLOCK_SIZE * NODES))
            .map_init(
                || Marks::new(self.points.len()),
                |marks, (chosen, heights)| {
                    if progress.check().is_err() {
                        return Vec::new();
                    }
                    let vertices = chosen.iter().zip(heights.chunks_exact_mut(NODES));
                    vertices
                        .map(|(&vertex, heights)| {
                            let frame = self.frame(vertex, marks);
                            let cover = lattice.measure(
                                self.surface,
                                self.points,
                                self.n_data_faces as u32,
                                vertex,
                                &frame,
                                heights,
                            );
                            if self.is_published {
                                round_out(heights);
                            }
                            let rings = polar.rings(heights, &straight);
                            let tint = self.tint(vertex, &frame, marks);
                            Measurement { frame, rings, tint, cover }
                        })
                        .collect()
                },
            )
            .collect();
        Measurements { heights, vertices: blocks.into_iter().flatten().collect() }
    }

    /// Returns the frame at a vertex; its normal is the mean of the normals around the vertex.
    fn frame(&self, vertex: u32, marks: &mut Marks) -> Frame {
        let ball = self.surface.ball(
            self.points,
            vertex,
            self.normal_radius,
            |other: u32| (other as usize) < self.n_data_vertices,
            marks,
        );
        let normal: Vector3<f64> = ball.iter().map(|&other| self.areas[other as usize]).sum();
        Frame::new(self.points[vertex as usize], normal, self.up)
    }

    /// Returns the colors around a vertex; all zeros if colors are not compared.
    fn tint(&self, vertex: u32, frame: &Frame, marks: &mut Marks) -> Tint {
        if self.colors.is_empty() {
            return Tint::default();
        }
        let reach = PART * self.radius;
        let ball = self.surface.ball(
            self.points,
            vertex,
            reach,
            |other: u32| (other as usize) < self.n_data_vertices,
            marks,
        );
        Tint::new(ball.iter().map(|&other| {
            let [x, y, _] = frame.local(self.points[other as usize] - frame.origin);
            ([x, y].map(|x| x / reach), self.colors[other as usize])
        }))
    }
}
