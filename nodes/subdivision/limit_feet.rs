//! The feet of given vertices on a subdivision surface.

use maquette::value::{Faces, Mesh, NearestPlace, TriangleTree};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::geometric::{Direction, FootPoint, Perpendicular};
use super::limit::Limit;
use super::{LimitPoint, LimitSurface, Plan, Scheme, SubdivideError, Subdivision};

/// The limit point of each control point, and the normal there if it is needed.
pub(super) fn vertex_feet(
    limit: &Limit,
    control: &[Point3<f64>],
    direction: Direction,
) -> Vec<FootPoint> {
    let points = limit.positions.apply(control);
    let foot = |(vertex, &point): (usize, &Point3<f64>)| {
        let perpendicular = match direction {
            Direction::Residual => Perpendicular::Nowhere,
            Direction::Normal => along(limit.normal(vertex, control, Vector3::zeros())),
        };
        FootPoint { point, perpendicular }
    };
    points.par_iter().enumerate().with_min_len(1024).map(foot).collect()
}

/// The direction of a normal that is none if it is zero.
fn along(normal: Vector3<f64>) -> Perpendicular {
    normal.try_normalize(0.0).map_or(Perpendicular::Nowhere, Perpendicular::Along)
}

/// The nearest points of the surfaces of an iteration: those of the mesh of its limit points after some steps, and from there downhill
/// on the surface itself.
pub(super) struct ClosestFeet<'a> {
    plan: Plan,
    how: Subdivision,
    mesh: &'a Mesh,
    /// The refined faces around each refined vertex.
    around: Vec<Vec<u32>>,
}

impl<'a> ClosestFeet<'a> {
    /// For control points of the connectivity of `mesh`, whose vertices look for their feet.
    ///
    /// # Errors
    /// If the scheme cannot refine the mesh.
    pub(super) fn new(mesh: &'a Mesh, how: Subdivision) -> Result<Self, SubdivideError> {
        // Doo's and Sabin's surface has no parameters to go downhill: there a finer mesh stands for it.
        let levels = if how.scheme == Scheme::DooSabin { 4 } else { 2 };
        let how = Subdivision { levels, limit: true, ..how };
        let plan = Plan::new(mesh, how)?;
        let fine = plan.apply(mesh)?;
        let mut around = vec![Vec::new(); fine.positions().len()];
        for (index, face) in (0..).zip(fine.faces().iter()) {
            face.iter().for_each(|&vertex| around[vertex as usize].push(index));
        }
        Ok(Self { plan, how, mesh, around })
    }

    pub(super) fn of(&self, control: &[Point3<f64>]) -> Vec<FootPoint> {
        let moved = self.mesh.with_positions(control.to_vec()).ok();
        let fine = moved.as_ref().and_then(|mesh| self.plan.apply(mesh).ok());
        // A surface that ran away has no feet; the iteration notes infinite distances and ends.
        let (Some(moved), Some(fine)) = (moved, fine) else {
            return vec![FootPoint::nowhere(); control.len()];
        };
        let surface = LimitSurface::new(&moved, self.how).ok();
        let borders = border_vertices(&fine);
        let hits = TriangleTree::new(&fine).nearest_to_all(self.mesh.positions());
        let foot = |(&to, hit): (&Point3<f64>, Option<NearestPlace>)| {
            let Some(hit) = hit else { return FootPoint::nowhere() };
            let mut foot = on_mesh(&fine, &hit, &borders);
            if let (Some(surface), Perpendicular::Along(_)) = (&surface, foot.perpendicular) {
                let found = self.on_surface(surface, &fine, &hit, to);
                foot.point = found.point;
                let [u, v] = found.first;
                foot.perpendicular = along(u.cross(&v));
            }
            foot
        };
        let points = self.mesh.positions().par_iter().zip(hits);
        points.with_min_len(64).map(foot).collect()
    }

    /// The foot on the surface near a place of the mesh of limit points. If it is at the rim of its face, the faces beside it are
    /// looked at, too.
    fn on_surface(
        &self,
        surface: &LimitSurface,
        fine: &Mesh,
        hit: &NearestPlace,
        to: Point3<f64>,
    ) -> LimitPoint {
        let faces = self.mesh.faces();
        let place =
            Place::new(faces, self.how, fine.faces(), hit.face, hit.corners(fine), hit.shares);
        let mut seen = vec![place.face];
        let (mut best, inside) = downhill(surface, place, to, self.how.scheme);
        if inside {
            return best;
        }
        for corner in hit.corners(fine) {
            let vertex = fine.faces().corners()[corner];
            for &face in &self.around[vertex as usize] {
                let first = fine.faces().first_corner(face as usize);
                let place = fine.faces().face(face as usize).iter().position(|&v| v == vertex);
                let own = first + place.unwrap_or(0);
                let place =
                    Place::new(faces, self.how, fine.faces(), face, [own; 3], [1.0, 0.0, 0.0]);
                if seen.contains(&place.face) {
                    continue;
                }
                seen.push(place.face);
                let (found, _) = downhill(surface, place, to, self.how.scheme);
                if (found.point - to).norm() < (best.point - to).norm() {
                    best = found;
                }
            }
        }
        best
    }
}

/// A place of the mesh of limit points.
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

/// Steps downhill: from a mesh of 16 parts for each face the second one is far below what an iteration changes.
const STEPS: usize = 3;

/// The point of the surface that is reached from a place by steps of Newton within the face, and whether none led out of it.
fn downhill(
    surface: &LimitSurface,
    place: Place,
    to: Point3<f64>,
    scheme: Scheme,
) -> (LimitPoint, bool) {
    let Place { face, mut at } = place;
    let mut here = surface.at(face, at[0], at[1]);
    let mut inside = true;
    for _ in 0..STEPS {
        let spoke = to - here.point;
        let [u, v] = here.first;
        let [uu, uv, vv] = here.second.unwrap_or_default().map(|second| second.dot(&spoke));
        let (a, b, d) = (u.norm_squared() - uu, u.dot(&v) - uv, v.norm_squared() - vv);
        let (x, y) = (u.dot(&spoke), v.dot(&spoke));
        let area = a * d - b * b;
        let goes_up = a > 0.0 && area > 0.0;
        let step = [(x * d - y * b) / area, (y * a - x * b) / area];
        if !goes_up || step.iter().all(|step| step.abs() < 1e-9) {
            break;
        }
        let next = [at[0] + step[0], at[1] + step[1]];
        inside = is_inside(scheme, next);
        let there = surface.at(face, next[0], next[1]);
        let nearer = (there.point - to).norm() < spoke.norm();
        if !nearer {
            break;
        }
        (at, here) = (next, there);
    }
    (here, inside)
}

/// Whether a place is in a face; for quads alone, as other polygons have theirs at each corner.
fn is_inside(scheme: Scheme, [u, v]: [f64; 2]) -> bool {
    match scheme {
        Scheme::Loop => 0.0 <= u && 0.0 <= v && u + v <= 1.0,
        _ => (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v),
    }
}

/// A place on a face of the control mesh, as [`LimitSurface::at`] wants it.
struct Place {
    face: usize,
    at: [f64; 2],
}

impl Place {
    /// The place of the control mesh that refinement takes to the mean with these shares of three corners of a refined face.
    fn new(
        faces: &Faces,
        how: Subdivision,
        fine: &Faces,
        face: u32,
        corners: [usize; 3],
        shares: [f64; 3],
    ) -> Self {
        let mut face = face as usize;
        let first = fine.first_corner(face);
        let mean = |places: &[[f64; 2]]| {
            let terms =
                corners.into_iter().zip(shares).map(|(k, share)| (places[k - first], share));
            terms.fold([0.0, 0.0], |[u, v], (place, share)| {
                [u + place[0] * share, v + place[1] * share]
            })
        };
        if how.scheme == Scheme::Loop {
            let mut at = mean(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
            for _ in 0..how.levels {
                let [s, t] = at.map(|x| x / 2.0);
                at = match face % 4 {
                    0 => [s, t],
                    1 => [1.0 - s - t, s],
                    2 => [t, 1.0 - s - t],
                    _ => [0.5 - t, s + t],
                };
                face /= 4;
            }
            return Self { face, at };
        }
        let mut at = mean(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        for _ in 1..how.levels {
            at = quarter(face % 4, at);
            face /= 4;
        }
        // The first step makes a quad at each corner of each face.
        let corner = face;
        let (mut low, mut high) = (0, faces.len());
        while low + 1 < high {
            let middle = low.midpoint(high);
            *if faces.first_corner(middle) <= corner { &mut low } else { &mut high } = middle;
        }
        let (face, own) = (low, corner - faces.first_corner(low));
        match faces.face(face).len() {
            4 => Self { face, at: quarter(own, at) },
            _ => Self { face, at: [own as f64 + at[0].min(LAST), at[1]] },
        }
    }
}

/// The end of a quad in a polygon; 1 would be the beginning of the next.
const LAST: f64 = 1.0 - 1e-12;

/// A place in the quarter of a quad at one of its corners, as a place of the quad.
fn quarter(corner: usize, at: [f64; 2]) -> [f64; 2] {
    let [s, t] = at.map(|x| x / 2.0);
    match corner {
        0 => [s, t],
        1 => [1.0 - t, s],
        2 => [1.0 - s, 1.0 - t],
        _ => [t, 1.0 - s],
    }
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
    fn a_place_of_the_refined_mesh_is_found_on_the_control_mesh() {
        for (mesh, scheme) in [
            (bumpy(&sphere(1)), Scheme::Loop),
            (cube(), Scheme::CatmullClark),
            (prism(5), Scheme::CatmullClark),
        ] {
            let (boundary, creases, corners) = Default::default();
            let how = Subdivision { scheme, levels: 2, limit: true, boundary, creases, corners };
            let fine = Plan::new(&mesh, how).unwrap().apply(&mesh).unwrap();
            let surface = LimitSurface::new(&mesh, how).unwrap();
            // A vertex of the refined mesh is a point of the surface.
            for (vertex, hit) in
                TriangleTree::new(&fine).nearest_to_all(fine.positions()).iter().enumerate()
            {
                let hit = hit.as_ref().unwrap();
                let corners = hit.corners(&fine);
                let place =
                    Place::new(mesh.faces(), how, fine.faces(), hit.face, corners, hit.shares);
                let point = surface.at(place.face, place.at[0], place.at[1]).point;
                assert!((point - fine.positions()[vertex]).norm() < 1e-9, "{scheme:?} {vertex}");
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
        let feet = ClosestFeet::new(&mesh, how).unwrap().of(mesh.positions());
        let fine = Plan::new(&mesh, how).unwrap().apply(&mesh).unwrap();
        let hits = TriangleTree::new(&fine).nearest_to_all(mesh.positions());
        for ((foot, to), hit) in feet.iter().zip(mesh.positions().iter()).zip(hits) {
            let spoke = to - foot.point;
            // The chords of the fine mesh may be nearer than the surface where it is hollow.
            assert!(spoke.norm() <= hit.unwrap().distance_sq.sqrt() + 1e-4);
            let Perpendicular::Along(normal) = foot.perpendicular else {
                panic!("a closed surface")
            };
            assert!(spoke.cross(&normal).norm() <= 1e-3 * spoke.norm(), "{foot:?}");
        }
    }
}
