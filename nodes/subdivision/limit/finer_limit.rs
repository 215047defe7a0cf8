//! The limit of a mesh that a primal scheme has refined: rows for its few odd vertices, fixed masks for the others.

use std::ops::Range;

use maquette_base::linear::stencils::Stencils;
use maquette_value::memory::huge_vec;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Column, Mesh, MeshError};
use nalgebra::{Point3, Vector3};

use super::limit_rows::{complete_normals, side_normals, vertex_normal};
use crate::masks::catmull_clark::CatmullClarkMasks;
use crate::masks::loop_masks::LoopMasks;
use crate::masks::regular_rules::{Quads, ThreeSided, Walk};
use crate::masks::sharpness::Sharpness;
use crate::masks::stars::{Masks, Scratch, Stars};
use crate::refine::half_edges::HalfEdges;
use crate::refine::last::Last;
use crate::refine::level::{Around, BLOCK};
use crate::refine::split::{Corners, Split, Triangles};
use crate::scheme::PrimalScheme;

/// Where the vertices of a last mesh go, and which way the surface faces there.
#[derive(Debug)]
pub(crate) struct FinerLimit {
    last: Last,
    /// The limits of the odd vertices.
    positions: Stencils,
    /// Their tangents in pairs, one for each side of a crease, and the first row of each odd vertex.
    tangents: Stencils,
    sides: Column<u32>,
}

/// A regular vertex on the limit surface: its place and its unit normal, which is zero where the tangents do not span a plane.
type Regular = (Point3<f64>, Vector3<f64>);

impl FinerLimit {
    pub(crate) fn new(last: Last) -> Self {
        match last.coarser.rules.scheme {
            PrimalScheme::Loop => Self::of(last, LoopMasks),
            PrimalScheme::CatmullClark => Self::of(last, CatmullClarkMasks),
        }
    }

    fn of(last: Last, masks: impl Masks) -> Self {
        let (rules, odd, creases) = (last.coarser.rules, &last.odd, last.creases());
        let sharpness = &Sharpness::new(&last, rules, &creases);
        let stars = Stars { mesh: &last, sharpness, rules: rules.of_edges(), masks };
        let (positions, _) = Stencils::build(odd.len(), |scratch: &mut Scratch, item, rows| {
            stars.limit(scratch, odd[item][0], odd[item][1], rows);
            rows.end();
        });
        let (tangents, sides) = Stencils::build(odd.len(), |scratch: &mut Scratch, item, rows| {
            stars.tangents(scratch, odd[item][0], odd[item][1], rows);
        });
        Self { last, positions, tangents, sides }
    }

    /// The same mesh with its vertices on the limit surface, and the attribute `normal`.
    ///
    /// # Errors
    /// If a place becomes infinite.
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
        limit.without("normal").with_vertex("normal", Attribute::Vector(normals.into()))
    }

    /// What [`apply`](Self::apply) makes of a mesh, made of what it made, `limit`, where others than the vertices in these rows have gone to
    /// the same places. Of `control`, the places before, those of the rows and around them must be there. None if a place is not finite.
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
        let each = || vertices.par_iter().with_min_len(BLOCK);
        let made = each().map(|&vertex| match item(vertex, odd) {
            Some(item) => (self.positions.apply_row(item, control), Vector3::zeros()),
            None => self.regular(control, vertex as usize),
        });
        let (places, normals): (Vec<Point3<f64>>, Vec<Vector3<f64>>) = made.unzip();
        let moved = limit.with_moved(rows, &places).ok()?;
        let completed = each().zip(&normals).map_init(Vec::new, |faces, (&vertex, &normal)| {
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

    /// A regular vertex.
    fn regular(&self, control: &[Point3<f64>], vertex: usize) -> Regular {
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

    /// A half-edge from a regular vertex.
    fn start(&self, vertex: usize) -> u32 {
        match self.scheme() {
            PrimalScheme::Loop => self.last.ring_of(vertex, Triangles)[0],
            PrimalScheme::CatmullClark => self.last.ring_of(vertex, Corners)[0],
        }
    }

    fn scheme(&self) -> PrimalScheme {
        self.last.coarser.rules.scheme
    }

    /// How many bytes it holds.
    pub(crate) fn size(&self) -> usize {
        self.last.size() + self.positions.size() + self.tangents.size() + self.sides.size()
    }

    /// Writes the places and unit normals of the regular vertices; the normal is zero where the tangents do not span a plane.
    fn at_regular<K: Split>(
        &self,
        control: &[Point3<f64>],
        to: (&mut [Point3<f64>], &mut [[f64; 3]]),
        split: K,
        masks: impl Fn(&[u32], &[Point3<f64>], usize, &[u32]) -> Regular + Sync,
    ) {
        let corners = self.last.corners();
        let around = Around { corners, places: control, in_faces: &[] };
        self.last.at_regular(around, to, split, |vertex, halves| {
            let (place, normal) = masks(corners, control, vertex, halves);
            (place, normal.into())
        });
    }
}

/// The unit normal of two tangents.
#[inline]
fn normal(first: Vector3<f64>, second: Vector3<f64>) -> Vector3<f64> {
    first.cross(&second).try_normalize(0.0).unwrap_or_default()
}

/// The bicubic B-spline: `(16 v + 4 sum e_j + sum d_j) / 36` and its derivatives.
#[inline]
fn b_spline(corners: &[u32], control: &[Point3<f64>], vertex: usize, halves: &[u32]) -> Regular {
    fn at(half: u32, control: &[Point3<f64>], corners: &[u32]) -> Vector3<f64> {
        control[corners[half as usize] as usize].coords
    }
    let around: [[Vector3<f64>; 2]; 4] = std::array::from_fn(|j| {
        let next = Quads.next(halves[j]);
        [at(next, control, corners), at(Quads.next(next), control, corners)]
    });
    let [[e0, d0], [e1, d1], [e2, d2], [e3, d3]] = around;
    let (edges, corners) = ((e0 + e1) + (e2 + e3), (d0 + d1) + (d2 + d3));
    let place = (control[vertex].coords * 16.0 + edges * 4.0 + corners) / 36.0;
    let first = (e0 - e2) * 4.0 + ((d0 - d1) + (d3 - d2));
    let second = (e1 - e3) * 4.0 + ((d0 - d3) + (d1 - d2));
    (place.into(), normal(first, second))
}

/// The quartic box spline: `(6 v + sum e_j) / 12` and its derivatives.
#[inline]
fn box_spline(corners: &[u32], control: &[Point3<f64>], vertex: usize, halves: &[u32]) -> Regular {
    let around: [Vector3<f64>; 6] = std::array::from_fn(|j| {
        control[corners[ThreeSided.next(halves[j]) as usize] as usize].coords
    });
    let [e0, e1, e2, e3, e4, e5] = around;
    let sum = ((e0 + e1) + (e2 + e3)) + (e4 + e5);
    let place = (control[vertex].coords * 6.0 + sum) / 12.0;
    let first = (e0 - e3) + ((e1 - e4) + (e5 - e2)) * 0.5;
    let second = ((e1 - e4) + (e2 - e5)) * SQRT_3_HALF;
    (place.into(), normal(first, second))
}

/// The sine of 60 degrees.
const SQRT_3_HALF: f64 = 0.866_025_403_784_438_6;
