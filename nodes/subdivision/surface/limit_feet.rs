//! The foot points of given vertices on a subdivision surface: the surface points with which the vertices are compared.
//!
//! The surface is evaluated exactly, with derivatives, and not approximated by a mesh.

use maquette_base::linear::stencils::Stencils;
use maquette_node::Error;
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh};
use nalgebra::{Point3, Vector3};

use super::closest_point_walk::{FacePosition, Nearest, Part, Parts, walk_to_closest_point};
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
use crate::{LimitPoint, LimitSurface, Scheme, Subdivision};

/// Returns the foot points of the vertices for `foot: Vertex`: each is the limit point of the vertex's own control point. The normal at a
/// foot point is computed only if `facing` is given and the vertex is not marked in `own`.
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
                    perpendicular_along(limit.normal(vertex, control, Vector3::zeros()))
                }),
            }
        })
        .collect()
}

/// Converts a normal to a perpendicular direction; the zero vector becomes `Nowhere`.
fn perpendicular_along(normal: Vector3<f64>) -> Perpendicular {
    normal.try_normalize(0.0).map_or(Perpendicular::Nowhere, Perpendicular::Along)
}

/// Finds the foot points of the given vertices: for each vertex the nearest point of the current surface on the faces at this vertex.
///
/// The search is a descent that starts at the foot points of the previous iteration, in the first iteration at the limits of the control
/// points. A global search could find the nearest point on another sheet of the surface, to which the control point does not belong.
pub(crate) struct ClosestFeet<'a> {
    points: &'a [Point3<f64>],
    faces: &'a Faces,
    /// The limit masks: row `i` gives the limit point of control point `i`.
    own: &'a Stencils,
    surface: Shape,
    /// The foot points of the previous iteration. Before the first iteration each vertex has one start position in each of its faces. Empty
    /// for a vertex whose foot point is always the limit of its own control point.
    last: Vec<Vec<FacePosition>>,
}

/// The coordinates at which a walk starts on a face whose corner (0, 0) is at the vertex. At the vertex itself the surface may have no
/// derivatives.
const START_OFFSET: f64 = 1e-3;

impl<'a> ClosestFeet<'a> {
    /// Creates the search for the vertices of `mesh`. `own` are the limit masks of the control points.
    ///
    /// # Errors
    /// If the scheme cannot refine the mesh.
    pub(crate) fn new(
        mesh: &'a Mesh,
        options: Subdivision,
        own: &'a Stencils,
    ) -> Result<Self, Error> {
        let (points, faces) = (mesh.positions(), mesh.faces());
        let (halves, starts) = Connectivity::new(faces, points.len())?;
        let surface = match options.scheme {
            Scheme::DooSabin => Shape::dual(mesh, options, &starts)?,
            Scheme::Loop | Scheme::CatmullClark | Scheme::Butterfly => {
                Shape::Primal(LimitSurface::new(mesh, options)?)
            }
        };
        let mut ring = Ring::default();
        let previous = starts
            .iter()
            .map(|&start| {
                halves.ring(start, &mut ring);
                let spots = ring.halves.iter().map(|&half| surface.part(half));
                let spots = spots.filter(|&part| surface.has_part(part));
                spots.map(|part| FacePosition { part, at: [START_OFFSET; 2] }).collect()
            })
            .collect();
        Ok(Self { points, faces, own, surface, last: previous })
    }

    /// Finds the foot points on the surface of the control points `control`. Where `own` is set, the foot point is the limit of the
    /// vertex's own control point.
    pub(crate) fn find(&mut self, control: &[Point3<f64>], own: &[bool]) -> Vec<FootPoint> {
        // A surface with overflowed coordinates has no foot points; the iteration records infinite distances and ends.
        if !self.surface.move_to(control) {
            return vec![FootPoint::nowhere(); control.len()];
        }
        let (faces, surface) = (self.faces, &self.surface);
        let walks = self.points.par_iter().zip(&mut self.last).enumerate().with_min_len(64);
        let feet = walks.map(|(vertex, (&to, last))| {
            fn foot_distance(end: &Nearest, to: Point3<f64>) -> f64 {
                (to - end.point.point).norm_squared()
            }
            let starts = if own[vertex] { &[][..] } else { &last[..] };
            let nearest = starts
                .iter()
                .map(|&start| {
                    walk_to_closest_point(surface, start, to, |part| {
                        let face = faces.face(surface.face(part) as usize);
                        face.contains(&(vertex as u32)) && surface.has_part(part)
                    })
                })
                .min_by(|a, b| foot_distance(a, to).total_cmp(&foot_distance(b, to)));
            let Some(Nearest { spot, point, held }) = nearest else {
                let point = self.own.apply_row(vertex, control);
                return FootPoint { point, perpendicular: Perpendicular::Nowhere };
            };
            *last = vec![spot];
            let [u, v] = point.first;
            let perpendicular =
                if held { Perpendicular::Nowhere } else { perpendicular_along(u.cross(&v)) };
            FootPoint { point: point.point, perpendicular }
        });
        feet.collect()
    }
}

/// A limit surface divided into parts. Each part belongs to a corner of the control mesh.
enum Shape {
    Primal(LimitSurface),
    Dual(Box<Dual>),
}

/// The limit surface of the Doo-Sabin scheme.
struct Dual {
    control: Connectivity,
    parts: Level,
    /// Marks the corners that have a part: those whose vertex is not on the border.
    inside: Vec<bool>,
    /// The new vertex that each corner has after one step.
    refined: Vec<Vector3<f64>>,
}

impl Shape {
    /// Creates the limit surface of the Doo-Sabin scheme. Its parts are connected in the same way as the quads that a Catmull-Clark step
    /// makes.
    fn dual(mesh: &Mesh, options: Subdivision, starts: &[u32]) -> Result<Self, Error> {
        let bare = Mesh::new(mesh.positions().clone(), mesh.faces().clone())?;
        let options = Subdivision { scheme: Scheme::CatmullClark, ..options };
        let level =
            Level::from_topology(&Topology::from_mesh(&bare, options), PrimalScheme::CatmullClark)?;
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
        let refined = dual_surface::refine_corners(&control, mesh.positions());
        Ok(Self::Dual(Box::new(Dual { control, parts, inside, refined })))
    }

    /// Replaces the control points. Returns false if the coordinates overflow.
    fn move_to(&mut self, to: &[Point3<f64>]) -> bool {
        let is_finite = to.iter().all(|point| point.iter().all(|x| x.is_finite()));
        match self {
            Self::Primal(surface) => match surface.with_control_points(to) {
                Ok(moved) => *surface = moved,
                Err(_) => return false,
            },
            Self::Dual(dual) => dual.refined = dual_surface::refine_corners(&dual.control, to),
        }
        is_finite
    }

    /// Returns the index of the part of the limit surface at the face corner where a half-edge starts.
    fn part(&self, half: u32) -> u32 {
        match self {
            Self::Primal(surface) if surface.scheme().needs_triangles() => half / 3 * 4 + half % 3,
            Self::Primal(surface) if surface.n_steps() > 1 => 4 * half,
            _ => half,
        }
    }

    /// Returns the index of the control mesh's face over which a part of the limit surface is.
    fn face(&self, part: u32) -> u32 {
        match self {
            Self::Primal(surface) => surface.face_of(part),
            Self::Dual(dual) => dual.control.face_of(part),
        }
    }

    fn has_part(&self, part: u32) -> bool {
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
    fn evaluate(&mut self, at: [f64; 2]) -> LimitPoint {
        let position = FacePoint::new(at[0], at[1]);
        match self {
            Self::Primal(part) => part.evaluate(position),
            Self::Dual(part) => part.evaluate(position),
        }
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::TriangleTree;

    use super::*;
    use crate::Plan;
    use crate::limit::limit_rows::LimitPositions;
    use crate::refine::without_border::select_faces;
    use crate::shapes::{add_bumps, sphere, torus};

    fn subdivision_options(scheme: Scheme, levels: u32) -> Subdivision {
        let (boundary, creases, corners) = Default::default();
        Subdivision { scheme, levels, limit: true, boundary, creases, corners }
    }

    fn feet(mesh: &Mesh, scheme: Scheme, own: &[bool]) -> Vec<FootPoint> {
        let how = subdivision_options(scheme, 0);
        let limits = LimitPositions::new(&Topology::from_mesh(mesh, how)).unwrap().positions;
        ClosestFeet::new(mesh, how, &limits).unwrap().find(mesh.positions(), own)
    }

    #[test]
    fn feet_are_perpendicular_and_at_least_as_near_as_on_a_fine_mesh() {
        for (scheme, mesh) in [
            (Scheme::Loop, add_bumps(&sphere(2))),
            (Scheme::CatmullClark, torus(12, 8, false)),
            (Scheme::CatmullClark, add_bumps(&sphere(1))),
            (Scheme::DooSabin, torus(12, 8, false)),
            (Scheme::DooSabin, add_bumps(&sphere(1))),
        ] {
            let own = vec![false; mesh.positions().len()];
            let feet = feet(&mesh, scheme, &own);
            let fine =
                Plan::new(&mesh, subdivision_options(scheme, 5)).unwrap().apply(&mesh).unwrap();
            let hits = TriangleTree::new(&fine).nearest_to_all(mesh.positions());
            for ((foot, to), hit) in feet.iter().zip(mesh.positions().iter()).zip(hits) {
                let spoke = to - foot.point;
                // The chords of the fine mesh may be nearer to the vertex than the surface is, where the surface is concave.
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
    fn own_limits_are_feet_where_requested_and_at_dual_borders() {
        let open: Vec<_> = (0..72).filter(|face| face % 12 > 2).collect();
        let open = select_faces(&torus(12, 8, false), &open).unwrap();
        for scheme in [Scheme::CatmullClark, Scheme::DooSabin] {
            let limits =
                LimitPositions::new(&Topology::from_mesh(&open, subdivision_options(scheme, 0)))
                    .unwrap()
                    .positions;
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
