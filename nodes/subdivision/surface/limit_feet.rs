//! The feet of given vertices on a subdivision surface.
//!
//! All schemes have exact derivatives everywhere, so that no mesh replaces the surface.

use maquette_base::linear::stencils::Stencils;
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh};
use nalgebra::{Point3, Vector3};

use super::downhill::{Nearest, Part, Parts, Spot, downhill};
use super::dual_surface::{self, DualPart};
use super::face_point::FacePoint;
use super::limit_surface::LimitPart;
use crate::limit::limit_rows::Limit;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, Ring};
use crate::refine::level::Level;
use crate::refine::primal::Primal;
use crate::refine::topology::Topology;
use crate::scheme::PrimalScheme;
use crate::solve::geometric::{FootPoint, Perpendicular};
use crate::{LimitPoint, LimitSurface, Scheme, SubdivideError, Subdivision};

/// The limit point of each control point, and the normal there if it is needed, which `facing` tells, and it is not marked as `own`.
pub(crate) fn vertex_feet(
    positions: &Stencils,
    facing: Option<&Limit>,
    control: &[Point3<f64>],
    own: &[bool],
) -> Vec<FootPoint> {
    let points = positions.apply(control);
    points
        .par_iter()
        .enumerate()
        .with_min_len(1024)
        .map(|(vertex, &point)| {
            let facing = facing.filter(|_| !own[vertex]);
            FootPoint {
                point,
                perpendicular: facing.map_or(Perpendicular::Nowhere, |limit| {
                    along(limit.normal(vertex, control, Vector3::zeros()))
                }),
            }
        })
        .collect()
}

/// The direction of a normal that is none if it is zero.
fn along(normal: Vector3<f64>) -> Perpendicular {
    normal.try_normalize(0.0).map_or(Perpendicular::Nowhere, Perpendicular::Along)
}

/// The points of the surfaces of an iteration that are nearest to their vertices, each on the faces at its vertex.
///
/// They are reached downhill from the last ones, at first from the vertices' own limits: elsewhere another sheet may be nearer, to which
/// the control point does not belong.
pub(crate) struct ClosestFeet<'a> {
    points: &'a [Point3<f64>],
    faces: &'a Faces,
    /// The limits of the control points.
    own: &'a Stencils,
    surface: Shape,
    /// Where the last feet were: at first in each face at the vertex. None of a vertex that has its own limit alone.
    last: Vec<Vec<Spot>>,
}

/// Where a walk starts, as there may be no derivatives at the vertex itself.
const INSIDE: f64 = 1e-3;

impl<'a> ClosestFeet<'a> {
    /// For control points of the connectivity of `mesh`, whose vertices look for their feet; `own` are their own limits.
    ///
    /// # Errors
    /// If the scheme cannot refine the mesh.
    pub(crate) fn new(
        mesh: &'a Mesh,
        how: Subdivision,
        own: &'a Stencils,
    ) -> Result<Self, SubdivideError> {
        let (points, faces) = (mesh.positions(), mesh.faces());
        let (halves, starts) = Connectivity::new(faces, points.len())?;
        let surface = match how.scheme {
            Scheme::DooSabin => Shape::dual(mesh, how, &starts)?,
            Scheme::Loop | Scheme::CatmullClark => Shape::Primal(LimitSurface::new(mesh, how)?),
        };
        let mut ring = Ring::default();
        let last = starts
            .iter()
            .map(|&start| {
                halves.ring(start, &mut ring);
                let spots = ring.halves.iter().map(|&half| surface.part(half));
                let spots = spots.filter(|&part| surface.has(part));
                spots.map(|part| Spot { part, at: [INSIDE; 2] }).collect()
            })
            .collect();
        Ok(Self { points, faces, own, surface, last })
    }

    /// The feet on the surface of some control points; their own limits where `own` is set.
    pub(crate) fn of(&mut self, control: &[Point3<f64>], own: &[bool]) -> Vec<FootPoint> {
        // A surface whose numbers overflowed has no feet; the iteration notes infinite distances and ends.
        if !self.surface.move_to(control) {
            return vec![FootPoint::nowhere(); control.len()];
        }
        let (faces, surface) = (self.faces, &self.surface);
        let walks = self.points.par_iter().zip(&mut self.last).enumerate().with_min_len(64);
        let feet = walks.map(|(vertex, (&to, last))| {
            fn off(end: &Nearest, to: Point3<f64>) -> f64 {
                (to - end.point.point).norm_squared()
            }
            let starts = if own[vertex] { &[][..] } else { &last[..] };
            let nearest = starts
                .iter()
                .map(|&start| {
                    downhill(surface, start, to, |part| {
                        let face = faces.face(surface.face(part) as usize);
                        face.contains(&(vertex as u32)) && surface.has(part)
                    })
                })
                .min_by(|a, b| off(a, to).total_cmp(&off(b, to)));
            let Some(Nearest { spot, point, held }) = nearest else {
                let point = self.own.apply_row(vertex, control);
                return FootPoint { point, perpendicular: Perpendicular::Nowhere };
            };
            *last = vec![spot];
            let [u, v] = point.first;
            let perpendicular = if held { Perpendicular::Nowhere } else { along(u.cross(&v)) };
            FootPoint { point: point.point, perpendicular }
        });
        feet.collect()
    }
}

/// A limit surface by its parts, one at each corner of the control mesh.
enum Shape {
    Primal(LimitSurface),
    Dual(Box<Dual>),
}

/// The surface of Doo's and Sabin's scheme.
struct Dual {
    control: Connectivity,
    parts: Level,
    /// Whether a corner has a part: none at the border.
    inside: Vec<bool>,
    /// Where one step puts each corner.
    refined: Vec<Vector3<f64>>,
}

impl Shape {
    /// That of Doo and Sabin: its parts hang together as the quads do that a step of Catmull and Clark makes.
    fn dual(mesh: &Mesh, how: Subdivision, starts: &[u32]) -> Result<Self, SubdivideError> {
        let bare = Mesh::new(mesh.positions().clone(), mesh.faces().clone())?;
        let how = Subdivision { scheme: Scheme::CatmullClark, ..how };
        let level = Level::first(&Topology::of(&bare, how), PrimalScheme::CatmullClark)?;
        let parts = Primal::new(level.into()).next();
        let (control, _) = Connectivity::new(mesh.faces(), mesh.positions().len())?;
        let mut ring = Ring::default();
        let closed: Vec<_> = starts
            .iter()
            .map(|&start| {
                control.ring(start, &mut ring);
                ring.closed && ring.halves.len() > 2
            })
            .collect();
        let inside = control.corners().iter().map(|&vertex| closed[vertex as usize]).collect();
        let refined = dual_surface::refined(&control, mesh.positions());
        Ok(Self::Dual(Box::new(Dual { control, parts, inside, refined })))
    }

    /// Whether this is still a surface with these control points.
    fn move_to(&mut self, to: &[Point3<f64>]) -> bool {
        let is_finite = to.iter().all(|point| point.iter().all(|x| x.is_finite()));
        match self {
            Self::Primal(surface) => match surface.moved(to) {
                Ok(moved) => *surface = moved,
                Err(_) => return false,
            },
            Self::Dual(dual) => dual.refined = dual_surface::refined(&dual.control, to),
        }
        is_finite
    }

    /// The part at a corner.
    fn part(&self, half: u32) -> u32 {
        match self {
            Self::Primal(surface) if surface.scheme().needs_triangles() => half / 3 * 4 + half % 3,
            Self::Primal(surface) if surface.n_steps() > 1 => 4 * half,
            _ => half,
        }
    }

    /// The face of the control mesh in which a part lies.
    fn face(&self, part: u32) -> u32 {
        match self {
            Self::Primal(surface) => surface.face_of(part),
            Self::Dual(dual) => dual.control.face_of(part),
        }
    }

    fn has(&self, part: u32) -> bool {
        match self {
            Self::Primal(_) => true,
            Self::Dual(dual) => dual.inside[part as usize],
        }
    }
}

impl Parts for Shape {
    fn mesh(&self) -> &Connectivity {
        match self {
            Self::Primal(surface) => surface.parts(),
            Self::Dual(dual) => &dual.parts.mesh,
        }
    }

    fn part(&self, part: u32) -> impl Part {
        match self {
            Self::Primal(surface) => ShapePart::Primal(surface.part(part)),
            Self::Dual(dual) => {
                ShapePart::Dual(DualPart::at_corner(&dual.control, &dual.refined, part))
            }
        }
    }
}

/// A part of a limit surface.
enum ShapePart<'a> {
    Primal(LimitPart<'a>),
    Dual(DualPart),
}

impl Part for ShapePart<'_> {
    fn at(&mut self, at: [f64; 2]) -> LimitPoint {
        let place = FacePoint::new(at[0], at[1]);
        match self {
            Self::Primal(part) => part.at(place),
            Self::Dual(part) => part.at(place),
        }
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::TriangleTree;

    use super::*;
    use crate::Plan;
    use crate::limit::limit_rows::LimitPlaces;
    use crate::refine::without_border::select_faces;
    use crate::shapes::{bumpy, sphere, torus};

    fn how(scheme: Scheme, levels: u32) -> Subdivision {
        let (boundary, creases, corners) = Default::default();
        Subdivision { scheme, levels, limit: true, boundary, creases, corners }
    }

    fn feet(mesh: &Mesh, scheme: Scheme, own: &[bool]) -> Vec<FootPoint> {
        let how = how(scheme, 0);
        let limits = LimitPlaces::new(&Topology::of(mesh, how)).unwrap().positions;
        ClosestFeet::new(mesh, how, &limits).unwrap().of(mesh.positions(), own)
    }

    #[test]
    fn feet_are_perpendicular_and_no_farther_than_on_a_fine_mesh() {
        for (scheme, mesh) in [
            (Scheme::Loop, bumpy(&sphere(2))),
            (Scheme::CatmullClark, torus(12, 8, false)),
            (Scheme::CatmullClark, bumpy(&sphere(1))),
            (Scheme::DooSabin, torus(12, 8, false)),
            (Scheme::DooSabin, bumpy(&sphere(1))),
        ] {
            let own = vec![false; mesh.positions().len()];
            let feet = feet(&mesh, scheme, &own);
            let fine = Plan::new(&mesh, how(scheme, 5)).unwrap().apply(&mesh).unwrap();
            let hits = TriangleTree::new(&fine).nearest_to_all(mesh.positions());
            for ((foot, to), hit) in feet.iter().zip(mesh.positions().iter()).zip(hits) {
                let spoke = to - foot.point;
                // The chords of the fine mesh may be nearer than the surface where it is hollow.
                let least = hit.unwrap().distance_sq.sqrt();
                assert!(spoke.norm() <= least + 5e-4, "{scheme:?} {} {least}", spoke.norm());
                let Perpendicular::Along(normal) = foot.perpendicular else {
                    panic!("a closed surface")
                };
                let aside = spoke.cross(&normal).norm();
                assert!(aside <= 1e-5 * spoke.norm() + 1e-12, "{scheme:?} {foot:?}");
            }
        }
    }

    #[test]
    fn own_limits_are_feet_where_they_are_asked_for_and_at_dual_borders() {
        let open: Vec<_> = (0..72).filter(|face| face % 12 > 2).collect();
        let open = select_faces(&torus(12, 8, false), &open).unwrap();
        for scheme in [Scheme::CatmullClark, Scheme::DooSabin] {
            let limits = LimitPlaces::new(&Topology::of(&open, how(scheme, 0))).unwrap().positions;
            let limits = limits.apply(open.positions());
            let marked: Vec<_> = (0..open.positions().len()).map(|k| k % 3 == 0).collect();
            let edges = open.edges();
            let border = edges.vertices.iter().zip(&edges.faces).filter(|(_, count)| **count == 1);
            let border: Vec<_> = border.flat_map(|(ends, _)| *ends).collect();
            for (k, foot) in feet(&open, scheme, &marked).iter().enumerate() {
                let at_border = scheme == Scheme::DooSabin && border.contains(&(k as u32));
                let off = (foot.point - limits[k]).norm();
                let to = open.positions()[k];
                assert!((to - foot.point).norm() <= (to - limits[k]).norm() + 1e-12);
                assert!(off == 0.0 || !(marked[k] || at_border), "{scheme:?} {k} {off}");
            }
        }
    }
}
