//! The limit of a mesh refined by a primal scheme: matrix rows for its few odd (irregular or sharp) vertices, fixed masks for the others.

use std::ops::Range;

use maquette_base::linear::stencils::Stencils;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::limit_rows::{complete_normals, side_normals, vertex_normal};
use crate::masks::catmull_clark::CatmullClarkMasks;
use crate::masks::loop_masks::LoopMasks;
use crate::masks::regular_rules::{QuadMesh, TriangleMesh, Walk};
use crate::masks::sharpness::Sharpness;
use crate::masks::vertex_rings::{Masks, RingMasks, Scratch};
use crate::refine::final_mesh::FinalMesh;
use crate::refine::half_edges::HalfEdges;
use crate::refine::level::{BLOCK, VertexInput};
use crate::refine::split::{Corners, Split, Triangles};
use crate::scheme::PrimalScheme;

/// The limit positions and normals of the final mesh.
#[derive(Debug)]
pub(crate) struct FinerLimit {
    last: FinalMesh,
    /// The matrix rows for the limit positions of the odd vertices.
    positions: Stencils,
    /// The tangents of the odd vertices, a pair for each side of a crease. `sides` has the index of each vertex's first row in `tangents`.
    tangents: Stencils,
    sides: Column<u32>,
}

/// The limit position of a regular vertex and its unit normal, which is zero if the tangents do not span a plane.
type RegularLimit = (Point3<f64>, Vector3<f64>);

impl FinerLimit {
    pub(crate) fn new(last: FinalMesh) -> Self {
        match last.coarser.rules.scheme {
            PrimalScheme::Loop => Self::with_masks(last, LoopMasks),
            PrimalScheme::CatmullClark => Self::with_masks(last, CatmullClarkMasks),
        }
    }

    fn with_masks(last: FinalMesh, masks: impl Masks) -> Self {
        let (rules, odd, creases) = (last.coarser.rules, &last.odd, last.creases());
        let sharpness = &Sharpness::new(&last, rules, &creases);
        let ring_masks = RingMasks { mesh: &last, sharpness, rules: rules.of_edges(), masks };
        let (positions, _) = Stencils::build(odd.len(), |scratch: &mut Scratch, item, rows| {
            ring_masks.limit(scratch, odd[item][0], odd[item][1], rows);
            rows.end();
        });
        let (tangents, sides) = Stencils::build(odd.len(), |scratch: &mut Scratch, item, rows| {
            ring_masks.tangents(scratch, odd[item][0], odd[item][1], rows);
        });
        Self { last, positions, tangents, sides }
    }

    /// Moves the vertices of `mesh` to the limit surface, and adds the attribute `normal`.
    ///
    /// # Errors
    /// If a position becomes infinite.
    pub(crate) fn apply(&self, mesh: &Mesh) -> Result<Mesh, MeshError> {
        let control = &mesh.positions()[..];
        let mut positions: Vec<Point3<f64>> = huge_vec(control.len());
        let mut normals: Vec<[f64; 3]> = huge_vec(control.len());
        let to = (&mut positions[..], &mut normals[..]);
        match self.scheme() {
            PrimalScheme::Loop => self.at_regular(control, to, Triangles, box_spline),
            PrimalScheme::CatmullClark => self.at_regular(control, to, Corners, b_spline),
        }
        let odd = self.positions.apply(control);
        for (&[vertex, _], point) in self.last.odd.iter().zip(odd) {
            positions[vertex as usize] = point;
        }
        let limit = mesh.with_positions(positions)?;
        let (last, tangents) = (&self.last, (&self.tangents, &self.sides[..]));
        complete_normals(&mut normals, &limit, control, last, &last.odd, tangents);
        limit.without_attribute("normal").with_vertex("normal", Attribute::Vector(normals.into()))
    }

    /// Updates `limit`, an earlier result of [`apply`](Self::apply), if only the limits of the vertices in `rows` have changed. `control`
    /// has the vertex positions before they are moved to the limit surface; only those in `rows` and their neighbors need to be valid.
    /// Returns `None` if a position is not finite.
    pub(crate) fn follow(
        &self,
        rows: &[Range<u32>],
        control: &[Point3<f64>],
        limit: &Mesh,
    ) -> Option<Mesh> {
        let (last, odd) = (&self.last, &self.last.odd);
        fn item(vertex: u32, odd: &[[u32; 2]]) -> Option<usize> {
            odd.binary_search_by_key(&vertex, |odd| odd[0]).ok()
        }
        let vertices: Vec<_> = rows.iter().cloned().flatten().collect();
        let each = vertices.par_iter().with_min_len(BLOCK);
        let made = each.clone().map(|&vertex| match item(vertex, odd) {
            Some(item) => (self.positions.apply_row(item, control), Vector3::zeros()),
            None => self.regular(control, vertex as usize),
        });
        let (positions, normals): (Vec<Point3<f64>>, Vec<Vector3<f64>>) = made.unzip();
        let moved = limit.with_moved(rows, &positions).ok()?;
        let completed = each.zip(&normals).map_init(Vec::new, |faces, (&vertex, &normal)| {
            let normal = match item(vertex, odd) {
                Some(item) => {
                    let rows = self.sides[item] as usize..self.sides[item + 1] as usize;
                    let fallback = vertex_normal(&moved, last, odd[item][1], faces);
                    side_normals(&self.tangents, rows, control, fallback)
                }
                None if normal == Vector3::zeros() => {
                    vertex_normal(&moved, last, self.start(vertex as usize), faces)
                }
                None => normal,
            };
            normal.into()
        });
        let normals: Vec<[f64; 3]> = completed.collect();
        let normals = limit.vertex().vectors("normal")?.with_rows(rows, &normals);
        moved.with_vertex("normal", Attribute::Vector(normals)).ok()
    }

    /// Computes the limit position and normal of a regular vertex.
    fn regular(&self, control: &[Point3<f64>], vertex: usize) -> RegularLimit {
        let (last, corners) = (&self.last, self.last.corners());
        match self.scheme() {
            PrimalScheme::Loop => {
                box_spline(corners, control, vertex, &last.ring_of(vertex, Triangles))
            }
            PrimalScheme::CatmullClark => {
                b_spline(corners, control, vertex, &last.ring_of(vertex, Corners))
            }
        }
    }

    /// Returns a half-edge that starts at a regular vertex.
    fn start(&self, vertex: usize) -> u32 {
        match self.scheme() {
            PrimalScheme::Loop => self.last.ring_of(vertex, Triangles)[0],
            PrimalScheme::CatmullClark => self.last.ring_of(vertex, Corners)[0],
        }
    }

    fn scheme(&self) -> PrimalScheme {
        self.last.coarser.rules.scheme
    }

    /// Returns the memory that this value uses, in bytes.
    pub(crate) fn size(&self) -> usize {
        self.last.size() + self.positions.size() + self.tangents.size() + self.sides.size()
    }

    /// Writes the limit positions and unit normals of the regular vertices. A normal is zero if the tangents do not span a plane.
    fn at_regular<K: Split>(
        &self,
        control: &[Point3<f64>],
        to: (&mut [Point3<f64>], &mut [[f64; 3]]),
        split: K,
        masks: impl Fn(&[u32], &[Point3<f64>], usize, &[u32]) -> RegularLimit + Sync,
    ) {
        let corners = self.last.corners();
        let around = VertexInput { corners, positions: control, in_faces: &[] };
        self.last.at_regular(around, to, split, |vertex, halves| {
            let (position, normal) = masks(corners, control, vertex, halves);
            (position, normal.into())
        });
    }
}

/// Returns the unit normal of the plane of two tangents; zero if they do not span a plane.
#[inline]
fn normal(first: Vector3<f64>, second: Vector3<f64>) -> Vector3<f64> {
    first.cross(&second).try_normalize(0.0).unwrap_or_default()
}

/// Evaluates the bicubic B-spline at a regular vertex: its position `(16 v + 4 sum e_j + sum d_j) / 36`, and its derivatives.
#[inline]
fn b_spline(
    corners: &[u32],
    control: &[Point3<f64>],
    vertex: usize,
    halves: &[u32],
) -> RegularLimit {
    fn tip_coordinates(half: u32, control: &[Point3<f64>], corners: &[u32]) -> Vector3<f64> {
        control[corners[half as usize] as usize].coords
    }
    let around: [[Vector3<f64>; 2]; 4] = std::array::from_fn(|j| {
        let next = QuadMesh.next(halves[j]);
        [
            tip_coordinates(next, control, corners),
            tip_coordinates(QuadMesh.next(next), control, corners),
        ]
    });
    let [[e0, d0], [e1, d1], [e2, d2], [e3, d3]] = around;
    let (edges, corners) = ((e0 + e1) + (e2 + e3), (d0 + d1) + (d2 + d3));
    let position = (control[vertex].coords * 16.0 + edges * 4.0 + corners) / 36.0;
    let first = (e0 - e2) * 4.0 + ((d0 - d1) + (d3 - d2));
    let second = (e1 - e3) * 4.0 + ((d0 - d3) + (d1 - d2));
    (position.into(), normal(first, second))
}

/// Evaluates the quartic box spline at a regular vertex: its position `(6 v + sum e_j) / 12`, and its derivatives.
#[inline]
fn box_spline(
    corners: &[u32],
    control: &[Point3<f64>],
    vertex: usize,
    halves: &[u32],
) -> RegularLimit {
    let around: [Vector3<f64>; 6] = std::array::from_fn(|j| {
        control[corners[TriangleMesh.next(halves[j]) as usize] as usize].coords
    });
    let [e0, e1, e2, e3, e4, e5] = around;
    let sum = ((e0 + e1) + (e2 + e3)) + (e4 + e5);
    let position = (control[vertex].coords * 6.0 + sum) / 12.0;
    let first = (e0 - e3) + ((e1 - e4) + (e5 - e2)) * 0.5;
    let second = ((e1 - e4) + (e2 - e5)) * SQRT_3_HALF;
    (position.into(), normal(first, second))
}

/// The sine of 60 degrees.
const SQRT_3_HALF: f64 = 0.866_025_403_784_438_6;
