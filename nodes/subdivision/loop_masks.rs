//! The masks of Loop's scheme on triangles.
//!
//! Loop, "Smooth subdivision surfaces based on triangles" (1987), with his own weights beta; boundaries and creases as in
//! Hoppe et al., "Piecewise smooth surface reconstruction" (1994), but with the crease rule of the cubic B-spline everywhere;
//! limit points and tangents by the eigenvectors of these masks.
//!
//! New vertices: the old ones in their order, then the midpoints of the edges in the order of
//! [`maquette::value::Mesh::edges`]. New faces: four for each old one in their order, those at its corners 0, 1, 2 first,
//! each beginning with its corner, then the one in the middle.
//!
//! Notation: `v` the vertex, `e_j` its `n` neighbors counter-clockwise, `a`, `b` the ends of an edge.

use std::f64::consts::PI;

use maquette::value::Faces;
use rayon::prelude::*;

use super::SubdivideError;
use super::carry::Mix;
use super::connectivity::{Connectivity, Ring};
use super::plan::{Limit, Rows, Stencils, Step, Topology};
use super::sharpness::{Class, Sharpness};

/// Up to this valence the weights come from a table.
const TABLE: usize = 32;

/// One step.
///
/// # Errors
/// If a face is no triangle or the mesh is not manifold.
pub(super) fn refine(topology: &Topology) -> Result<Step, SubdivideError> {
    let triangles = triangles(&topology.faces)?;
    let mesh = Connectivity::new(&topology.faces, topology.vertices)?;
    let sharpness = Sharpness::new(topology, &mesh);
    let masks = Masks::new(&mesh, &sharpness);
    let (kept, edges) = (topology.vertices, mesh.edges().vertices.len());
    let (positions, _) = Stencils::build(kept + edges, |scratch, row, rows| {
        if row < kept {
            masks.vertex(scratch, row, rows);
        } else {
            masks.edge((row - kept) as u32, rows);
        }
        rows.end();
    });
    let (between, _) = Stencils::build(edges, |_: &mut (), edge, rows| {
        mesh.edges().vertices[edge].iter().for_each(|&end| rows.push(end, 0.5));
        rows.end();
    });
    let faces = split(triangles, &mesh.edges().of_corner, kept as u32);
    let creases = sharpness.refined(kept as u32);
    Ok(Step { topology: topology.clone(), positions, kept, between, faces, creases })
}

/// The limit points and tangents.
///
/// # Errors
/// If a face is no triangle or the mesh is not manifold.
pub(super) fn limit(topology: &Topology) -> Result<Limit, SubdivideError> {
    triangles(&topology.faces)?;
    let mesh = Connectivity::new(&topology.faces, topology.vertices)?;
    let sharpness = Sharpness::new(topology, &mesh);
    let masks = Masks::new(&mesh, &sharpness);
    let (positions, _) = Stencils::build(topology.vertices, |scratch, vertex, rows| {
        masks.limit(scratch, vertex, rows);
        rows.end();
    });
    let (tangents, sides) = Stencils::build(topology.vertices, |scratch, vertex, rows| {
        masks.tangents(scratch, vertex, rows);
    });
    Ok(Limit { topology: topology.clone(), positions, tangents, sides })
}

fn triangles(faces: &Faces) -> Result<&[[u32; 3]], SubdivideError> {
    faces.as_triangles().or(faces.is_empty().then_some(&[][..])).ok_or_else(|| {
        let is_other = |face: &usize| faces.face(*face).len() != 3;
        let face = (0..faces.len()).find(is_other).unwrap_or_default();
        SubdivideError::NotTriangles { face, corners: faces.face(face).len() }
    })
}

/// Four triangles for each; the midpoint of edge `e` is the vertex `kept + e`.
fn split(triangles: &[[u32; 3]], edge_of_corner: &[u32], kept: u32) -> Faces {
    let mut split = vec![[0; 3]; 4 * triangles.len()];
    split
        .par_chunks_exact_mut(4)
        .with_min_len(4096)
        .zip(triangles.par_iter().zip(edge_of_corner.par_chunks_exact(3)))
        .for_each(|(split, (&[a, b, c], edges))| {
            let [ab, bc, ca] = [0, 1, 2].map(|k| kept + edges[k]);
            split.copy_from_slice(&[[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        });
    Faces::triangles(split)
}

/// The two old corners whose mean each new corner is, for the four triangles of one.
const CORNERS: [[usize; 2]; 12] = [
    [0, 0],
    [0, 1],
    [2, 0],
    [1, 1],
    [1, 2],
    [0, 1],
    [2, 2],
    [2, 0],
    [1, 2],
    [0, 1],
    [1, 2],
    [2, 0],
];

/// What is at the corners of the new triangles, straight within each old one.
pub(super) fn carry_corners<T: Mix>(old: &[T]) -> Vec<T> {
    old.chunks_exact(3)
        .flat_map(|old| {
            CORNERS.map(|[i, j]| {
                if i == j { old[i] } else { T::mix([(0.5, old[i]), (0.5, old[j])].into_iter()) }
            })
        })
        .collect()
}

/// Loop's weight of each neighbor of a vertex with `n` neighbors.
fn beta(n: usize) -> f64 {
    let center = 0.375 + libm::cos(2.0 * PI / n as f64) / 4.0;
    (0.625 - center * center) / n as f64
}

/// The masks of one mesh.
struct Masks<'a> {
    mesh: &'a Connectivity<'a>,
    sharpness: &'a Sharpness<'a>,
    /// Of valence 0 (unused) to [`TABLE`].
    betas: Vec<f64>,
    /// The cosine and sine of each part of a full turn, by the number of parts.
    turns: Vec<Vec<[f64; 2]>>,
}

/// Space for one vertex.
#[derive(Default)]
struct Scratch {
    ring: Ring,
    /// Of the vertex, then of its neighbors.
    weights: Vec<f64>,
    sharp: Vec<usize>,
}

impl<'a> Masks<'a> {
    fn new(mesh: &'a Connectivity<'a>, sharpness: &'a Sharpness<'a>) -> Self {
        let turns = (0..=TABLE).map(|n| (0..n).map(|j| turn(j, n)).collect()).collect();
        Self { mesh, sharpness, betas: (0..=TABLE).map(beta).collect(), turns }
    }

    fn beta(&self, n: usize) -> f64 {
        self.betas.get(n).copied().unwrap_or_else(|| beta(n))
    }

    fn turn(&self, j: usize, n: usize) -> [f64; 2] {
        self.turns.get(n).map_or_else(|| turn(j, n), |turns| turns[j])
    }

    /// Interior `3/8 (a + b) + 1/8 (c + d)`, sharp `1/2 (a + b)`; between them for a sharpness below 1.
    fn edge(&self, edge: u32, rows: &mut Rows) {
        let sharp = self.sharpness.of(edge).clamp(0.0, 1.0);
        let end = 0.375 + 0.125 * sharp;
        self.mesh.edges().vertices[edge as usize].iter().for_each(|&vertex| rows.push(vertex, end));
        if sharp < 1.0 {
            let opposite = 0.125 * (1.0 - sharp);
            self.mesh.opposite(edge).for_each(|vertex| rows.push(vertex, opposite));
        }
    }

    /// Interior `(1 - n beta) v + beta sum e_j`, crease `3/4 v + 1/8 (e_l + e_r)`, corner `v`; a vertex whose class changes
    /// in this step is between both.
    fn vertex(&self, scratch: &mut Scratch, vertex: usize, rows: &mut Rows) {
        let Scratch { ring, weights, .. } = scratch;
        self.mesh.ring(vertex, ring);
        let (old, new) = (self.sharpness.class(ring, false), self.sharpness.class(ring, true));
        weights.clear();
        weights.resize(ring.neighbors.len() + 1, 0.0);
        let mut add = |class: Class, share: f64| {
            let n = ring.neighbors.len();
            let beta = self.beta(n.max(1));
            add_mask(weights, class, share, [1.0 - n as f64 * beta, beta], [0.75, 0.125]);
        };
        if old == new {
            add(old, 1.0);
        } else {
            let share = self.sharpness.share(ring);
            add(old, share);
            add(new, 1.0 - share);
        }
        push(rows, vertex, ring, weights);
    }

    /// Interior `(w v + sum e_j) / (w + n)` with `w = 3 / (8 beta)`, crease `2/3 v + 1/6 (e_l + e_r)`, corner `v`.
    fn limit(&self, scratch: &mut Scratch, vertex: usize, rows: &mut Rows) {
        let Scratch { ring, weights, .. } = scratch;
        self.mesh.ring(vertex, ring);
        let n = ring.neighbors.len().max(1);
        let w = 0.375 / self.beta(n);
        let neighbor = 1.0 / (w + n as f64);
        weights.clear();
        weights.resize(ring.neighbors.len() + 1, 0.0);
        let class = self.sharpness.class(ring, false);
        add_mask(weights, class, 1.0, [w * neighbor, neighbor], [2.0 / 3.0, 1.0 / 6.0]);
        push(rows, vertex, ring, weights);
    }

    /// Pairs of tangents: one for a smooth vertex, one for each side of sharp edges.
    fn tangents(&self, scratch: &mut Scratch, vertex: usize, rows: &mut Rows) {
        let Scratch { ring, sharp, .. } = scratch;
        self.mesh.ring(vertex, ring);
        let n = ring.neighbors.len();
        sharp.clear();
        sharp.extend(self.sharpness.sharp(ring, false));
        if sharp.len() < 2 {
            for part in 0..if n == 0 { 0 } else { 2 } {
                (0..n).for_each(|j| rows.push(ring.neighbors[j], self.turn(j, n)[part]));
                rows.end();
            }
            return;
        }
        let is_corner = self.sharpness.class(ring, false) == Class::Corner;
        let around = ring.closed.then_some(sharp[0] + n);
        let ends = sharp[1..].iter().copied().chain(around);
        for (&first, last) in sharp.iter().zip(ends) {
            let side: Vec<u32> = (first..=last).map(|j| ring.neighbors[j % n]).collect();
            if is_corner {
                push_corner(rows, vertex as u32, &side);
            } else {
                push_crease(rows, vertex as u32, &side);
            }
        }
    }
}

fn turn(j: usize, n: usize) -> [f64; 2] {
    let angle = 2.0 * PI * j as f64 / n as f64;
    [libm::cos(angle), libm::sin(angle)]
}

/// Adds `share` times a mask to the weights of a vertex (the first) and its ring; `smooth` and `crease` give the weight of the
/// vertex and of one neighbor.
fn add_mask(weights: &mut [f64], class: Class, share: f64, smooth: [f64; 2], crease: [f64; 2]) {
    match class {
        Class::Smooth => {
            weights[0] += share * smooth[0];
            weights[1..].iter_mut().for_each(|weight| *weight += share * smooth[1]);
        }
        Class::Crease(left, right) => {
            weights[0] += share * crease[0];
            weights[left + 1] += share * crease[1];
            weights[right + 1] += share * crease[1];
        }
        Class::Corner => weights[0] += share,
    }
}

fn push(rows: &mut Rows, vertex: usize, ring: &Ring, weights: &[f64]) {
    rows.push(vertex as u32, weights[0]);
    for (&neighbor, &weight) in ring.neighbors.iter().zip(&weights[1..]) {
        if weight != 0.0 {
            rows.push(neighbor, weight);
        }
    }
}

/// The tangents of a corner's side: along both its sharp edges.
fn push_corner(rows: &mut Rows, vertex: u32, side: &[u32]) {
    for end in [side[0], side[side.len() - 1]] {
        rows.push(end, 1.0);
        rows.push(vertex, -1.0);
        rows.end();
    }
}

/// The tangents of a crease's side `c_0..=c_q`: along the crease, and across it into the surface.
///
/// Hoppe et al. (1994), table 2; the sign of the row for four and more faces is turned so that all point inward.
fn push_crease(rows: &mut Rows, vertex: u32, side: &[u32]) {
    let q = side.len() - 1;
    rows.push(side[0], 1.0);
    rows.push(side[q], -1.0);
    rows.end();
    let angle = PI / q as f64;
    let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
    for (j, &neighbor) in side.iter().enumerate() {
        let is_end = j == 0 || j == q;
        let weight = match q {
            1 => 1.0,
            2 => f64::from(u8::from(!is_end)),
            3 if is_end => -1.0,
            3 => 2.0,
            _ if is_end => -sine,
            _ => (2.0 - 2.0 * cosine) * libm::sin(j as f64 * angle),
        };
        rows.push(neighbor, weight);
    }
    let own = match q {
        1 | 3 => -2.0,
        2 => -1.0,
        _ => 0.0,
    };
    rows.push(vertex, own);
    rows.end();
}
