//! The curvature of a subdivision surface at the limits of its control points.
//!
//! At a regular vertex the surface is a uniform B-spline or box spline. The neighboring control points are its control points, and its
//! second derivatives are differences of them. At all other vertices the curvature of the limit does not exist, vanishes, or is unbounded.
//! There the curvature is taken from the surface nearby: a quadratic surface is fitted to the limit points of the mesh refined three times.

use maquette_node::{Error, Progress, bail};
use maquette_value::parallel::*;
use maquette_value::{Mesh, NearestPoint, TriangleTree};
use nalgebra::{Point3, Vector3};

use super::super::{Boundary, Corners, Creases, Plan, Scheme, Subdivision};
use super::bending::Bending;
use super::bent_mesh::BentMesh;
use super::discrete::Neighbors;
use crate::limit::limit_rows::Limit;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, NONE, Ring};
use crate::refine::manifold::manifold;
use crate::refine::topology::Topology;
use crate::refine::without_border::select_faces;

/// The number of refinement steps around an extraordinary (not regular) vertex.
const LEVELS: u32 = 3;

pub(super) fn at_limit(
    mesh: &Mesh,
    scheme: Scheme,
    boundary: Boundary,
    progress: &Progress<'_>,
) -> Result<BentMesh, Error> {
    if boundary == Boundary::None {
        bail!(
            "with `boundary: None` the surface ends before the border, so that vertices there have no curvature"
        );
    }
    let (creases, corners) = (Creases::OpenSubdiv, Corners::Linear);
    let options = Subdivision { scheme, levels: 0, limit: false, boundary, creases, corners };
    let limit = Limit::new(&Topology::from_mesh(mesh, options))?.apply(mesh)?;
    progress.check()?;
    let (connectivity, starts) = Connectivity::new(mesh.faces(), mesh.positions().len())?;
    let mut creased = vec![false; starts.len()];
    let sharp = mesh.creases().filter(|(_, sharpness)| *sharpness > 0.0);
    sharp.flat_map(|(ends, _)| ends).for_each(|end| creased[end as usize] = true);
    let stars =
        RegularNeighborhoods { connectivity: &connectivity, control: mesh.positions(), scheme };
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
    for (&vertex, found) in others.iter().zip(close_by(mesh, &limit, options, &others, progress)?) {
        bending[vertex as usize] = found;
    }
    Ok(BentMesh { mesh: limit, bending, extraordinary })
}

/// The first derivatives with respect to the parameters u and v, and the second derivatives with respect to uu, uv and vv.
type Derivatives = ([Vector3<f64>; 2], [Vector3<f64>; 3]);

/// A control mesh with access to the neighborhoods of its vertices.
struct RegularNeighborhoods<'a> {
    connectivity: &'a Connectivity,
    control: &'a [Point3<f64>],
    scheme: Scheme,
}

impl RegularNeighborhoods<'_> {
    fn control_point(&self, vertex: u32) -> Vector3<f64> {
        self.control[vertex as usize].coords
    }

    /// Returns the derivatives of the surface at a vertex; `None` if the surface is not a regular patch there.
    fn derivatives(&self, vertex: usize, ring: &Ring) -> Option<Derivatives> {
        let own = self.control[vertex].coords;
        // The B-spline weights of the middle point and of both side points at a vertex, for a cubic or a quadratic spline.
        let [middle, side] = match self.scheme {
            Scheme::Loop => {
                let around: [u32; 6] =
                    ring.neighbors[..].try_into().ok().filter(|_| ring.closed)?;
                return Some(box_spline(own, around.map(|vertex| self.control_point(vertex))));
            }
            Scheme::CatmullClark => [4.0 / 6.0, 1.0 / 6.0],
            Scheme::DooSabin => [6.0 / 8.0, 1.0 / 8.0],
            Scheme::Butterfly => return None,
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
        let [beside, across] =
            [beside, across].map(|vertices| vertices.map(|vertex| self.control_point(vertex)));
        Some(tensor(own, beside, across, [middle, side]))
    }
}

/// Computes the derivatives of the quartic box spline on the unit triangular lattice. Neighbor `j` is at the angle `j * 60` degrees.
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

/// Computes the derivatives of a tensor product of uniform B-splines on the unit grid. The neighbors are counter-clockwise, beginning along
/// u; corner `j` is between neighbors `j` and `j + 1`.
fn tensor(
    own: Vector3<f64>,
    [east, north, west, south]: [Vector3<f64>; 4],
    [north_east, north_west, south_west, south_east]: [Vector3<f64>; 4],
    mask: [f64; 2],
) -> Derivatives {
    let columns =
        [[south_west, west, north_west], [south, own, north], [south_east, east, north_east]];
    let rows =
        [[south_west, south, south_east], [west, own, east], [north_west, north, north_east]];
    let [columns, rows] = [columns, rows].map(|lines| lines.map(|line| apply_mask(line, mask)));
    let uv = (north_east - south_east - north_west + south_west) / 4.0;
    (
        [columns, rows].map(first_difference),
        [second_difference(columns), uv, second_difference(rows)],
    )
}

/// Returns the weighted sum of three collinear grid points: the middle one has the weight `middle`, the other two have the weight `side`.
fn apply_mask([before, here, after]: [Vector3<f64>; 3], [middle, side]: [f64; 2]) -> Vector3<f64> {
    here * middle + (before + after) * side
}

fn first_difference([before, _, after]: [Vector3<f64>; 3]) -> Vector3<f64> {
    (after - before) / 2.0
}

fn second_difference([before, here, after]: [Vector3<f64>; 3]) -> Vector3<f64> {
    after - here * 2.0 + before
}

/// Computes the curvature that the limit surface has near the limit points of the given vertices.
fn close_by(
    mesh: &Mesh,
    limit: &Mesh,
    options: Subdivision,
    vertices: &[u32],
    progress: &Progress<'_>,
) -> Result<Vec<Option<Bending>>, Error> {
    if vertices.is_empty() {
        return Ok(Vec::new());
    }
    progress.check()?;
    let (part, own) = extract_neighborhood(mesh, vertices)?;
    let options = Subdivision { levels: LEVELS, limit: true, ..options };
    let plan = Plan::new(&part, options)?;
    progress.check()?;
    let fine = plan.apply(&part)?;
    progress.check()?;
    let neighbors = Neighbors::new(&fine.edges(), fine.positions().len());
    let positions: Vec<_> =
        vertices.iter().map(|&vertex| limit.positions()[vertex as usize]).collect();
    // In primal schemes vertices keep their indices, so no search is needed.
    let own = if options.scheme.is_dual() { nearest_vertices(&fine, &positions) } else { own };
    let normals = fine.vertex_normals();
    Ok(positions
        .par_iter()
        .zip(&own)
        .with_min_len(64)
        .map(|(&position, own): (&Point3<f64>, &Option<u32>)| {
            let own = (*own)?;
            let around = neighbors.neighborhood(own, 6).into_iter().chain([own]);
            let around: Vec<_> = around.map(|other| fine.positions()[other as usize]).collect();
            Bending::of_points(position, normals[own as usize], &around)
        })
        .collect())
}

/// Finds for each position the nearest of the corners of the nearest face; `None` if no nearest face is found.
fn nearest_vertices(mesh: &Mesh, positions: &[Point3<f64>]) -> Vec<Option<u32>> {
    positions
        .iter()
        .zip(TriangleTree::new(mesh).nearest_to_all(positions))
        .map(|(position, hit): (&Point3<f64>, Option<NearestPoint>)| {
            let face = mesh.faces().face(hit?.face as usize);
            fn distance_from_vertex(vertex: u32, position: &Point3<f64>, mesh: &Mesh) -> f64 {
                (mesh.positions()[vertex as usize] - position).norm_squared()
            }
            face.iter().copied().min_by(|&a, &b| {
                distance_from_vertex(a, position, mesh)
                    .total_cmp(&distance_from_vertex(b, position, mesh))
            })
        })
        .collect()
}

/// Extracts the faces within two edges of some vertices. The surface between each of the vertices and its neighbors depends on these faces.
/// Also returns the index that each of the given vertices has in the extracted mesh; `None` for a vertex without faces.
fn extract_neighborhood(mesh: &Mesh, vertices: &[u32]) -> Result<(Mesh, Vec<Option<u32>>), Error> {
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
    // Extracted faces may form two parts that touch at a vertex. This vertex is then split into copies, the first of which keeps its index.
    // The curvature at such a vertex is not used.
    let part = manifold(&select_faces(&bare.with_creases(mesh.creases())?, &faces)?)?;
    Ok((part, own))
}
