//! The exemplars, of which the missing surface is made: the surroundings of data vertices, as height fields.

use maquette_node::{Cancelled, Progress};
use maquette_value::parallel::*;
use nalgebra::{Point3, Vector3};

use super::best_match::Match;
use super::descriptor::{Basis, Descriptor, Polar, Rings};
use super::frame::{Frame, Turn};
use super::heights::{Lattice, NODES, round_out};
use super::kd_tree::KdTree;
use super::surface::{Marks, NONE, Surface};
use super::tints::{Color, PART, Tint};
use super::turns::Turns;

/// Exemplars of one level at most: some 60 MB of heights. Beyond, those of a denser scan lie nearer to each other than they differ.
const MOST: usize = 50_000;

/// What the exemplars of a level are taken from, and how.
pub(super) struct Source<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) points: &'a [Point3<f64>],
    /// Twice the sum of the area vectors of the faces around each vertex.
    pub(super) areas: &'a [Vector3<f64>],
    /// The colors of all vertices; none if they do not count.
    pub(super) colors: &'a [Color],
    /// How many vertices and faces are data.
    pub(super) data: usize,
    pub(super) kept: usize,
    pub(super) up: Vector3<f64>,
    /// The radius of a patch, and that within which normals are averaged for its frame.
    pub(super) radius: f64,
    pub(super) normal_radius: f64,
    /// How far exemplars are apart; all vertices are, if 0.
    pub(super) apart: f64,
    /// As published: borders of the data may cut off a part of an exemplar, and it stays where its frame puts it.
    pub(super) cut: bool,
}

/// Share of an exemplar's disk that must have heights.
const LEAST_COVER: f64 = 0.9;

/// The disk over which an exemplar is measured, in radii of a patch.
pub(super) const REACH: f64 = 1.2;

/// The exemplars of a level.
pub(super) struct Exemplars {
    /// Their vertices.
    pub(super) vertices: Vec<u32>,
    pub(super) frames: Vec<Frame>,
    heights: Vec<f32>,
    /// Their colors; none if they do not count.
    pub(super) tints: Vec<Tint>,
    /// For each data vertex the exemplar that stands for it.
    pub(super) owners: Vec<u32>,
    pub(super) lattice: Lattice,
    pub(super) polar: Polar,
    pub(super) basis: Basis,
    pub(super) tree: KdTree,
}

impl Exemplars {
    /// Measures the surroundings of the vertices that `may` be exemplars, and takes those that are complete enough.
    pub(super) fn new(
        source: &Source<'_>,
        may: impl Fn(u32) -> bool + Sync,
        progress: &Progress<'_>,
    ) -> Result<Self, Cancelled> {
        let (chosen, stands) = source.choose(may);
        let lattice = Lattice::new(REACH * source.radius);
        let polar = Polar::new(source.radius, lattice.step, !source.cut);
        let measured = source.measure(&chosen, &lattice, &polar, progress);
        progress.check()?;
        let good: Vec<u32> = (0..chosen.len() as u32)
            .filter(|&k| source.cut || LEAST_COVER <= measured.cover[k as usize])
            .collect();
        let mut place = vec![NONE; chosen.len()];
        (0..).zip(&good).for_each(|(new, &old)| place[old as usize] = new);
        fn take(k: &u32) -> usize {
            *k as usize
        }
        let mut heights = measured.heights;
        // The good ones move up, in place.
        for (new, old) in good.iter().map(take).enumerate() {
            heights.copy_within(old * NODES..(old + 1) * NODES, new * NODES);
        }
        heights.truncate(good.len() * NODES);
        let rings: Vec<Rings> = good.iter().map(|k| measured.rings[take(k)]).collect();
        let basis = Basis::new(&rings);
        let mut descriptors: Vec<Descriptor> =
            rings.par_iter().with_min_len(64).map(|rings| basis.project(rings)).collect();
        let tints: Vec<Tint> = match source.colors {
            [] => Vec::new(),
            _ => good.iter().map(|k| measured.tints[take(k)]).collect(),
        };
        descriptors.iter_mut().zip(&tints).for_each(|(own, tint)| tint.put(own));
        progress.check()?;
        Ok(Self {
            vertices: good.iter().map(|k| chosen[take(k)]).collect(),
            frames: good.iter().map(|k| measured.frames[take(k)]).collect(),
            heights,
            tints,
            owners: stands
                .iter()
                .map(|&k| if k == NONE { NONE } else { place[k as usize] })
                .collect(),
            lattice,
            polar,
            basis,
            tree: KdTree::new(&descriptors),
        })
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Where a point of a patch is on the patch's match.
    pub(super) fn place(
        &self,
        found: &Match,
        turns: &Turns,
        frame: &Frame,
        point: Point3<f64>,
    ) -> Point3<f64> {
        let own = &self.frames[found.exemplar as usize];
        let [u, v, w] = frame.local(point - frame.at);
        let [x, y] = turns.of(found.turn).apply([u, v]);
        own.at + own.global([x, y, w])
    }

    /// The heights of an exemplar.
    #[inline(always)]
    pub(super) fn heights(&self, exemplar: u32) -> &[f32] {
        &self.heights[exemplar as usize * NODES..(exemplar as usize + 1) * NODES]
    }
}

/// What was measured of chosen vertices.
struct Measured {
    frames: Vec<Frame>,
    heights: Vec<f32>,
    rings: Vec<Rings>,
    tints: Vec<Tint>,
    cover: Vec<f64>,
}

/// Vertices that one thread measures with the same memory of what it has seen.
const BLOCK: usize = 64;

impl Source<'_> {
    /// Vertices that are far enough apart, and for each data vertex the place of that which stands for it.
    fn choose(&self, may: impl Fn(u32) -> bool + Sync) -> (Vec<u32>, Vec<u32>) {
        let all: Vec<u32> = (0..self.data as u32).filter(|&vertex| may(vertex)).collect();
        let mut stands = vec![NONE; self.data];
        let mut apart = self.apart;
        if all.len() > MOST {
            // As many disks as there may be share the area.
            let area: f64 = all.iter().map(|&vertex| self.areas[vertex as usize].norm()).sum();
            apart = apart.max((area / 6.0 / (0.5 * MOST as f64)).sqrt());
        }
        if apart == 0.0 {
            (0..).zip(&all).for_each(|(k, &vertex)| stands[vertex as usize] = k);
            return (all, stands);
        }
        let mut chosen = Vec::new();
        let mut marks = Marks::new(self.points.len());
        for vertex in all {
            if stands[vertex as usize] != NONE {
                continue;
            }
            for other in self.surface.ball(
                self.points,
                vertex,
                apart,
                |other: u32| (other as usize) < self.data,
                &mut marks,
            ) {
                let own = &mut stands[other as usize];
                if *own == NONE {
                    *own = chosen.len() as u32;
                }
            }
            chosen.push(vertex);
        }
        (chosen, stands)
    }

    /// Measures vertices; only some if the evaluation is told to stop meanwhile.
    fn measure(
        &self,
        chosen: &[u32],
        lattice: &Lattice,
        polar: &Polar,
        progress: &Progress<'_>,
    ) -> Measured {
        let count = chosen.len();
        let mut heights = maquette_value::memory::huge_vec(count * NODES);
        let straight = Turn::all(1, false)[0];
        let blocks = chosen.par_chunks(BLOCK).zip(heights.par_chunks_mut(BLOCK * NODES));
        let measure = |marks: &mut Marks, (chosen, heights): (&[u32], &mut [f32])| {
            if progress.check().is_err() {
                return Vec::new();
            }
            let each = chosen.iter().zip(heights.chunks_exact_mut(NODES));
            each.map(|(&vertex, heights): (&u32, &mut [f32])| {
                let frame = self.frame(vertex, marks);
                let limit = self.kept as u32;
                let cover =
                    lattice.measure(self.surface, self.points, limit, vertex, &frame, heights);
                if self.cut {
                    round_out(heights);
                }
                (frame, cover, polar.rings(heights, &straight), self.tint(vertex, &frame, marks))
            })
            .collect::<Vec<_>>()
        };
        let found: Vec<Vec<_>> =
            blocks.map_init(|| Marks::new(self.points.len()), measure).collect();
        let mut frames = Vec::with_capacity(count);
        let (mut rings, mut cover) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let mut tints = Vec::with_capacity(count);
        for (frame, share, ring, tint) in found.into_iter().flatten() {
            frames.push(frame);
            cover.push(share);
            rings.push(ring);
            tints.push(tint);
        }
        Measured { frames, heights, rings, tints, cover }
    }

    /// The frame at a vertex: its normal is the mean of those around it.
    fn frame(&self, vertex: u32, marks: &mut Marks) -> Frame {
        let ball = self.surface.ball(
            self.points,
            vertex,
            self.normal_radius,
            |other: u32| (other as usize) < self.data,
            marks,
        );
        let normal: Vector3<f64> = ball.iter().map(|&other| self.areas[other as usize]).sum();
        Frame::new(self.points[vertex as usize], normal, self.up)
    }

    /// The colors around a vertex, if they count.
    fn tint(&self, vertex: u32, frame: &Frame, marks: &mut Marks) -> Tint {
        if self.colors.is_empty() {
            return Tint::default();
        }
        let reach = PART * self.radius;
        let ball = self.surface.ball(
            self.points,
            vertex,
            reach,
            |other: u32| (other as usize) < self.data,
            marks,
        );
        Tint::new(ball.iter().map(|&other| {
            let [x, y, _] = frame.local(self.points[other as usize] - frame.at);
            ([x, y].map(|x| x / reach), self.colors[other as usize])
        }))
    }
}
