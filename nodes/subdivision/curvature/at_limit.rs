//! The curvature of a subdivision surface at the limits of its control points.
//!
//! At a regular vertex the surface is a uniform B-spline or box spline of the control points around, whose second derivatives are
//! differences of them. Elsewhere the limit has no curvature, or none that means anything: it vanishes or grows without bound. There
//! the surface close by is taken: a quadratic surface through the limit points of the mesh refined three times.

use maquette_node::Progress;
use maquette_value::parallel::*;
use maquette_value::{Mesh, NearestPlace, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::super::{Boundary, Corners, Creases, Plan, Scheme, Subdivision};
use super::bending::Bending;
use super::bent_mesh::BentMesh;
use super::curvature_error::CurvatureError;
use super::discrete::Neighbors;
use crate::limit::limit_rows::Limit;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, NONE, Ring};
use crate::refine::manifold::manifold;
use crate::refine::topology::Topology;
use crate::refine::without_border::select_faces;

/// Steps after which the surface around an extraordinary vertex is looked at.
const LEVELS: u32 = 3;

pub(super) fn at_limit(
    mesh: &Mesh,
    scheme: Scheme,
    boundary: Boundary,
    progress: &Progress<'_>,
) -> Result<BentMesh, CurvatureError> {
    if boundary == Boundary::None {
        return Err(CurvatureError::NoBorder);
    }
    let (creases, corners) = (Creases::OpenSubdiv, Corners::Linear);
    let how = Subdivision { scheme, levels: 0, limit: false, boundary, creases, corners };
    let limit = Limit::new(&Topology::of(mesh, how))?.apply(mesh)?;
    progress.check()?;
    let (connectivity, starts) = Connectivity::new(mesh.faces(), mesh.positions().len())?;
    let mut creased = vec![false; starts.len()];
    let sharp = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0);
    sharp.flat_map(|(ends, _)| ends).for_each(|end| creased[end as usize] = true);
    let stars = Stars { connectivity: &connectivity, control: mesh.positions(), scheme };
    let regular: Vec<Option<Option<Bending>>> = (0..starts.len())
        .into_par_iter()
        .with_min_len(1024)
        .map_init(Ring::default, |ring: &mut Ring, vertex: usize| {
            if starts[vertex] == NONE || creased[vertex] && !scheme.is_dual() {
                return None;
            }
            connectivity.ring(starts[vertex], ring);
            stars.derivatives(vertex, ring).map(|(u, uu)| Bending::of_derivatives(u, uu))
        })
        .collect();
    let extraordinary: Vec<_> = regular.iter().map(Option::is_none).collect();
    let mut bending: Vec<_> = regular.into_iter().map(Option::flatten).collect();
    let others: Vec<_> = (0..starts.len() as u32).filter(|&v| extraordinary[v as usize]).collect();
    for (&vertex, found) in others.iter().zip(close_by(mesh, &limit, how, &others, progress)?) {
        bending[vertex as usize] = found;
    }
    Ok(BentMesh { mesh: limit, bending, extraordinary })
}

/// First derivatives by two parameters, and second ones: by the first, by both, by the second.
type Derivatives = ([Vector3<f64>; 2], [Vector3<f64>; 3]);

/// What lies around the vertices of a control mesh.
struct Stars<'a> {
    connectivity: &'a Connectivity,
    control: &'a [Point3<f64>],
    scheme: Scheme,
}

impl Stars<'_> {
    /// The derivatives of the surface at a vertex; none if it is not regular there.
    fn derivatives(&self, vertex: usize, ring: &Ring) -> Option<Derivatives> {
        let control = |vertex: u32| self.control[vertex as usize].coords;
        let own = self.control[vertex].coords;
        // The mask of the value in the direction that is not derived: cubic or quadratic.
        let [middle, side] = match self.scheme {
            Scheme::Loop => {
                let around: [u32; 6] =
                    ring.neighbors[..].try_into().ok().filter(|_| ring.closed)?;
                return Some(box_spline(own, around.map(control)));
            }
            Scheme::CatmullClark => [4.0 / 6.0, 1.0 / 6.0],
            Scheme::DooSabin => [6.0 / 8.0, 1.0 / 8.0],
        };
        let beside: [u32; 4] = ring.neighbors[..].try_into().ok().filter(|_| ring.closed)?;
        let across: Option<Vec<u32>> = ring
            .halves
            .iter()
            .map(|&half| {
                let is_quad =
                    self.connectivity.faces.face(self.connectivity.face_of(half) as usize).len()
                        == 4;
                let corner = self.connectivity.next(self.connectivity.next(half));
                is_quad.then(|| self.connectivity.corners()[corner as usize])
            })
            .collect();
        let across: [u32; 4] = across?.try_into().ok()?;
        Some(tensor(own, beside.map(control), across.map(control), [middle, side]))
    }
}

/// The quartic box spline on the unit hexagonal lattice, whose neighbor `j` lies at `j` times 60 degrees.
fn box_spline(own: Vector3<f64>, around: [Vector3<f64>; 6]) -> Derivatives {
    let [a, b, c, d, e, f] = around;
    let root = 3f64.sqrt();
    let u = (a - d) + (b - c + f - e) * 0.5;
    let v = (b + c - e - f) * (root / 2.0);
    let second = [a + d, b + e, c + f].map(|pair| pair - own * 2.0);
    let uu = second[0];
    let vv = (second[1] * 2.0 + second[2] * 2.0 - second[0]) / 3.0;
    let uv = (second[1] - second[2]) / root;
    ([u / 3.0, v / 3.0], [uu, uv, vv])
}

/// A tensor product of uniform B-splines on the unit grid: neighbors counter-clockwise from the one along u, and the corners between
/// them and the next.
fn tensor(
    own: Vector3<f64>,
    [east, north, west, south]: [Vector3<f64>; 4],
    [north_east, north_west, south_west, south_east]: [Vector3<f64>; 4],
    [middle, side]: [f64; 2],
) -> Derivatives {
    let smooth = |[before, here, after]: [Vector3<f64>; 3]| here * middle + (before + after) * side;
    let columns =
        [[south_west, west, north_west], [south, own, north], [south_east, east, north_east]];
    let rows =
        [[south_west, south, south_east], [west, own, east], [north_west, north, north_east]];
    let first = |lines: [[Vector3<f64>; 3]; 3]| (smooth(lines[2]) - smooth(lines[0])) / 2.0;
    let second = |lines: [[Vector3<f64>; 3]; 3]| {
        smooth(lines[2]) - smooth(lines[1]) * 2.0 + smooth(lines[0])
    };
    let uv = (north_east - south_east - north_west + south_west) / 4.0;
    ([first(columns), first(rows)], [second(columns), uv, second(rows)])
}

/// The curvature near the limits of some vertices.
fn close_by(
    mesh: &Mesh,
    limit: &Mesh,
    how: Subdivision,
    vertices: &[u32],
    progress: &Progress<'_>,
) -> Result<Vec<Option<Bending>>, CurvatureError> {
    if vertices.is_empty() {
        return Ok(Vec::new());
    }
    progress.check()?;
    let (part, own) = around(mesh, vertices)?;
    let how = Subdivision { levels: LEVELS, limit: true, ..how };
    let plan = Plan::new(&part, how)?;
    progress.check()?;
    let fine = plan.apply(&part)?;
    progress.check()?;
    let neighbors = Neighbors::new(&fine.edges(), fine.positions().len());
    let places: Vec<_> =
        vertices.iter().map(|&vertex| limit.positions()[vertex as usize]).collect();
    // The other schemes keep the numbers of vertices when they refine.
    let own = if how.scheme.is_dual() { nearest_vertices(&fine, &places) } else { own };
    let normals = fine.vertex_normals();
    Ok(places
        .par_iter()
        .zip(&own)
        .with_min_len(64)
        .map(|(&place, own): (&Point3<f64>, &Option<u32>)| {
            let own = (*own)?;
            let around = neighbors.near(own, 6).into_iter().chain([own]);
            let around: Vec<_> = around.map(|other| fine.positions()[other as usize]).collect();
            Bending::of_points(place, normals[own as usize], &around)
        })
        .collect())
}

/// The vertex of a mesh that is nearest to each place, of those of the nearest face.
fn nearest_vertices(mesh: &Mesh, places: &[Point3<f64>]) -> Vec<Option<u32>> {
    places
        .iter()
        .zip(TriangleTree::new(mesh).nearest_to_all(places))
        .map(|(place, hit): (&Point3<f64>, Option<NearestPlace>)| {
            let face = mesh.faces().face(hit?.face as usize);
            fn away(vertex: u32, place: &Point3<f64>, mesh: &Mesh) -> f64 {
                (mesh.positions()[vertex as usize] - place).norm_squared()
            }
            face.iter()
                .copied()
                .min_by(|&a, &b| away(a, place, mesh).total_cmp(&away(b, place, mesh)))
        })
        .collect()
}

/// The faces within two edges of some vertices, on which the surface between them and their neighbors depends, and the numbers
/// that these vertices have there; none for a vertex of no face.
fn around(mesh: &Mesh, vertices: &[u32]) -> Result<(Mesh, Vec<Option<u32>>), CurvatureError> {
    let mut marked = vec![false; mesh.positions().len()];
    vertices.iter().for_each(|&vertex| marked[vertex as usize] = true);
    let mut chosen = vec![false; mesh.faces().len()];
    for _ in 0..2 {
        for (face, chosen) in mesh.faces().iter().zip(&mut chosen) {
            *chosen |= face.iter().any(|&vertex| marked[vertex as usize]);
        }
        for (face, _) in mesh.faces().iter().zip(&chosen).filter(|(_, chosen)| **chosen) {
            face.iter().for_each(|&vertex| marked[vertex as usize] = true);
        }
    }
    let faces: Vec<_> = (0..chosen.len() as u32).filter(|&face| chosen[face as usize]).collect();
    let mut numbers = vec![None; marked.len()];
    let named = faces.iter().flat_map(|&face| mesh.faces().face(face as usize));
    named.for_each(|&vertex| numbers[vertex as usize] = Some(0));
    let kept = numbers.iter_mut().filter(|number| number.is_some());
    (0..).zip(kept).for_each(|(number, kept)| *kept = Some(number));
    let own = vertices.iter().map(|&vertex| numbers[vertex as usize]).collect();
    let bare = Mesh::new(mesh.positions().to_vec(), mesh.faces().clone())?;
    // Parts may touch at a vertex; the first keeps its number, and it is of no use to any.
    let part = manifold(&select_faces(&bare.with_creases(mesh.creases())?, &faces)?)?;
    Ok((part, own))
}
