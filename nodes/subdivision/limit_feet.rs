//! The feet of given vertices on a subdivision surface.

use maquette::value::{Faces, Mesh, NearestPlace, TriangleTree};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::downhill::{Nearest, Spot, downhill};
use super::geometric::{FootPoint, Perpendicular};
use super::limit::Limit;
use super::stencils::Stencils;
use super::{LimitSurface, Plan, Scheme, SubdivideError, Subdivision};

/// The limit point of each control point, and the normal there if it is needed, which `facing` tells.
pub(super) fn vertex_feet(
    positions: &Stencils,
    facing: Option<&Limit>,
    control: &[Point3<f64>],
) -> Vec<FootPoint> {
    let points = positions.apply(control);
    let foot = |(vertex, &point): (usize, &Point3<f64>)| {
        let normal = |limit: &Limit| along(limit.normal(vertex, control, Vector3::zeros()));
        FootPoint { point, perpendicular: facing.map_or(Perpendicular::Nowhere, normal) }
    };
    points.par_iter().enumerate().with_min_len(1024).map(foot).collect()
}

/// The direction of a normal that is none if it is zero.
fn along(normal: Vector3<f64>) -> Perpendicular {
    normal.try_normalize(0.0).map_or(Perpendicular::Nowhere, Perpendicular::Along)
}

/// Steps to the mesh in the place of a surface, from which the walk goes downhill.
const STEPS: u32 = 2;

/// The same for a mesh on which the feet stay.
const DUAL_STEPS: u32 = 4;

/// The nearest points of the surfaces of an iteration: those of a mesh in its place, and from there downhill on the surface itself.
pub(super) struct ClosestFeet<'a> {
    points: &'a [Point3<f64>],
    /// The mesh in the surface's place.
    plan: Plan,
    bare: Mesh,
    /// A surface of the control mesh's connectivity; Doo's and Sabin's has no parameters to go downhill.
    surface: Option<LimitSurface>,
    /// Where the last feet were.
    last: Vec<Option<Spot>>,
}

impl<'a> ClosestFeet<'a> {
    /// For control points of the connectivity of `mesh`, whose vertices look for their feet.
    ///
    /// # Errors
    /// If the scheme cannot refine the mesh.
    pub(super) fn new(mesh: &'a Mesh, how: Subdivision) -> Result<Self, SubdivideError> {
        let dual = how.scheme == Scheme::DooSabin;
        let bare = Mesh::new(mesh.positions().clone(), mesh.faces().clone())?;
        let bare = bare.with_creases(mesh.creases())?;
        let plan = Plan::new(
            &bare,
            Subdivision { levels: if dual { DUAL_STEPS } else { STEPS }, limit: dual, ..how },
        )?;
        let surface = (!dual).then(|| LimitSurface::new(&bare, how)).transpose()?;
        let points = mesh.positions();
        Ok(Self { points, plan, bare, surface, last: vec![None; points.len()] })
    }

    /// The feet on the surface of some control points; `whole` looks for them everywhere.
    pub(super) fn of(&mut self, control: &[Point3<f64>], whole: bool) -> Vec<FootPoint> {
        // A surface that ran away has no feet; the iteration notes infinite distances and ends.
        let Ok(moved) = self.bare.with_positions(control.to_vec()) else {
            return vec![FootPoint::nowhere(); control.len()];
        };
        let Some(surface) = self.surface.as_ref().and_then(|surface| surface.moved(control).ok())
        else {
            return self.on_mesh(&moved);
        };
        if whole {
            let Ok(fine) = self.plan.apply(&moved) else {
                return vec![FootPoint::nowhere(); control.len()];
            };
            let hits = TriangleTree::new(&fine).nearest_to_all(self.points);
            let spot = |hit: NearestPlace| spot(&surface, fine.faces(), &hit, hit.corners(&fine));
            self.last = hits.into_iter().map(|hit| hit.map(spot)).collect();
        }
        let walks = self.points.par_iter().zip(&mut self.last).with_min_len(64);
        let feet = walks.map(|(&to, last)| {
            let Some(start) = *last else { return FootPoint::nowhere() };
            let Nearest { spot, point, held } = downhill(&surface, start, to);
            *last = Some(spot);
            let [u, v] = point.first;
            let perpendicular = if held { Perpendicular::Nowhere } else { along(u.cross(&v)) };
            FootPoint { point: point.point, perpendicular }
        });
        feet.collect()
    }

    /// The feet on the mesh itself.
    fn on_mesh(&self, control: &Mesh) -> Vec<FootPoint> {
        let Ok(fine) = self.plan.apply(control) else {
            return vec![FootPoint::nowhere(); self.points.len()];
        };
        let borders = border_vertices(&fine);
        let hits = TriangleTree::new(&fine).nearest_to_all(self.points);
        let foot = |hit: &Option<NearestPlace>| match hit {
            Some(hit) => on_mesh(&fine, hit, &borders),
            None => FootPoint::nowhere(),
        };
        hits.iter().map(foot).collect()
    }
}

/// A place of a mesh.
fn on_mesh(fine: &Mesh, hit: &NearestPlace, borders: &[bool]) -> FootPoint {
    let ends = hit.corners(fine).map(|corner| fine.faces().corners()[corner] as usize);
    let normals = fine.normals();
    let (mut point, mut normal) = (Vector3::zeros(), Vector3::zeros());
    for (end, share) in ends.into_iter().zip(hit.shares) {
        point += fine.positions()[end].coords * share;
        normal += Vector3::from(normals[end]) * share;
    }
    // At the border a point may have no perpendicular.
    let at_border = (0..3).all(|k| hit.shares[k] == 0.0 || borders[ends[k]]);
    let perpendicular = if at_border { Perpendicular::Nowhere } else { along(normal) };
    FootPoint { point: point.into(), perpendicular }
}

/// The place of the surface's parts where a place of the mesh after two steps comes from; a little more inside, as there may be no
/// derivatives at corners.
fn spot(surface: &LimitSurface, fine: &Faces, hit: &NearestPlace, corners: [usize; 3]) -> Spot {
    const INSIDE: f64 = 1e-3;
    let first = fine.first_corner(hit.face as usize);
    let is_loop = surface.scheme() == Scheme::Loop;
    let (middle, places): (_, &[[f64; 2]]) = match is_loop {
        true => (1.0 / 3.0, &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
        false => (0.5, &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
    };
    let mut at = [middle * INSIDE; 2];
    for (corner, share) in corners.into_iter().zip(hit.shares) {
        (0..2).for_each(|k| at[k] += places[corner - first][k] * share * (1.0 - INSIDE));
    }
    if surface.n_steps() == STEPS as usize {
        return Spot { part: hit.face, at };
    }
    let [s, t] = at.map(|x| x / 2.0);
    let at = match (is_loop, hit.face % 4) {
        (_, 0) => [s, t],
        (true, 1) => [1.0 - s - t, s],
        (true, 2) => [t, 1.0 - s - t],
        (true, _) => [0.5 - t, s + t],
        (_, 1) => [1.0 - t, s],
        (_, 2) => [1.0 - s, 1.0 - t],
        _ => [t, 1.0 - s],
    };
    Spot { part: hit.face / 4, at }
}

fn border_vertices(mesh: &Mesh) -> Vec<bool> {
    let edges = mesh.edges();
    let mut borders = vec![false; mesh.positions().len()];
    let ends = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 1);
    ends.flat_map(|(ends, _)| ends).for_each(|&end| borders[end as usize] = true);
    borders
}

#[cfg(test)]
mod tests {
    use super::super::shapes::{bumpy, cube, prism, sphere};
    use super::*;

    #[test]
    fn a_place_of_the_refined_mesh_is_found_on_the_one_before() {
        for (mesh, scheme) in [
            (bumpy(&sphere(1)), Scheme::Loop),
            (cube(), Scheme::CatmullClark),
            (prism(5), Scheme::CatmullClark),
        ] {
            let (boundary, creases, corners) = Default::default();
            let how = Subdivision { scheme, levels: 2, limit: true, boundary, creases, corners };
            let fine = Plan::new(&mesh, how).unwrap().apply(&mesh).unwrap();
            let surface = LimitSurface::new(&mesh, how).unwrap();
            // The middle of a refined face is near the middle of its corners.
            let faces = fine.faces();
            let longest = |face: &[u32]| {
                let [a, b] = [face[0], face[1]].map(|end| fine.positions()[end as usize]);
                (a - b).norm()
            };
            for (index, face) in faces.iter().enumerate() {
                let shares = [1.0 / 3.0; 3];
                let hit = NearestPlace { distance_sq: 0.0, face: index as u32, fan: 0, shares };
                let corners = hit.corners(&fine);
                let Spot { part, at } = spot(&surface, faces, &hit, corners);
                let ends = corners.map(|corner| fine.positions()[faces.corners()[corner] as usize]);
                let middle = (ends[0].coords + ends[1].coords + ends[2].coords) / 3.0;
                let point = surface.at_part(part, super::super::place::Place::new(at[0], at[1]));
                let off = (point.point.coords - middle).norm();
                assert!(off < 0.3 * longest(face), "{scheme:?} {index} {off}");
            }
        }
    }

    #[test]
    fn feet_are_perpendicular_and_no_farther_than_on_a_fine_mesh() {
        let mesh = bumpy(&sphere(2));
        let (boundary, creases, corners) = Default::default();
        let how = Subdivision {
            scheme: Scheme::Loop,
            levels: 5,
            limit: true,
            boundary,
            creases,
            corners,
        };
        let feet = ClosestFeet::new(&mesh, how).unwrap().of(mesh.positions(), true);
        let fine = Plan::new(&mesh, how).unwrap().apply(&mesh).unwrap();
        let hits = TriangleTree::new(&fine).nearest_to_all(mesh.positions());
        for ((foot, to), hit) in feet.iter().zip(mesh.positions().iter()).zip(hits) {
            let spoke = to - foot.point;
            // The chords of the fine mesh may be nearer than the surface where it is hollow.
            assert!(spoke.norm() <= hit.unwrap().distance_sq.sqrt() + 1e-4);
            let Perpendicular::Along(normal) = foot.perpendicular else {
                panic!("a closed surface")
            };
            assert!(spoke.cross(&normal).norm() <= 1e-5 * spoke.norm(), "{foot:?}");
        }
    }
}
