//! Evaluation of the limit surface of a primal scheme at any parameter, not only at vertices.
//!
//! The surface is stored as *parts*: each is the surface over one face of the mesh that one or two refinement steps make of the control
//! mesh. To evaluate a position, the neighborhood of its part is refined further, until the position is in a smaller part whose corners are
//! all regular. Over such a part the surface is a B-spline or box spline patch. Each step halves the size of the part around an irregular
//! corner, so few steps are enough; exactly at the corner the limit masks are used. Away from borders and creases the refined neighborhoods
//! are small fixed-size arrays (`smooth_triangle.rs`, `smooth_quad.rs`), near borders and creases they are small meshes (`piece.rs`). The
//! result equals that of Stam's eigenvector method ("Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary parameter values",
//! 1998), but needs no tables and also supports creases.

use std::sync::Arc;

use maquette_node::{Error, bail};
use maquette_value::{Faces, Mesh};
use nalgebra::Point3;

use super::face_point::{FacePoint, QUAD, TRIANGLE};
use super::limit_point::LimitPoint;
use super::piece::Piece;
use super::smooth_quad::SmoothQuad;
use super::smooth_triangle::{MAX_VALENCE, SmoothTriangle, scale_jet};
use crate::Subdivision;
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;
use crate::refine::level::Level;
use crate::refine::primal::Primal;
use crate::refine::topology::Topology;
use crate::rules::Rules;
use crate::scheme::PrimalScheme;

/// The maximum number of refinement steps. After so many halvings, floating-point numbers cannot distinguish positions near a corner.
const MAX_DEPTH: usize = 40;

/// The limit surface of Loop's or the Catmull-Clark scheme.
#[derive(Clone)]
pub struct LimitSurface {
    frame: Arc<SurfaceFrame>,
    /// The vertices of the mesh whose faces are the parts of the surface.
    points: Vec<Point3<f64>>,
}

/// The part of a limit surface that does not depend on the positions of control points.
struct SurfaceFrame {
    rules: Rules<PrimalScheme>,
    /// The faces of the control mesh.
    faces: Faces,
    /// The refinement steps from the control mesh to the mesh whose faces are the parts: one, or two if polygons must first be divided into
    /// quads.
    steps: Vec<Primal>,
    /// The mesh whose faces are the parts. Each part has at most one irregular corner.
    mesh: Level,
    /// The number of neighbors of each vertex in `mesh`, or 255 if there are more; 0 for a vertex on a border or crease.
    smooth: Vec<u8>,
}

impl LimitSurface {
    /// Creates the limit surface of `mesh` with the scheme and the rules in `options`. The number of levels is ignored.
    ///
    /// # Errors
    /// If the scheme cannot refine a face, or is neither `Loop` nor `CatmullClark`, or the mesh is not manifold.
    pub fn new(mesh: &Mesh, options: Subdivision) -> Result<Self, Error> {
        options.scheme.check_limit()?;
        let rules = options.rules().primal().ok_or_else(|| {
            Error::new("the surface of Doo and Sabin has patches over vertices, not over faces")
        })?;
        let first = Level::from_topology(&Topology::from_mesh(mesh, options), rules.scheme)?;
        let mut steps = vec![Primal::new(first.into())];
        if rules.scheme.has_middles() && mesh.faces().sides() != Some(4) {
            steps.push(Primal::new(steps[0].next().into()));
        }
        let parts = steps[steps.len() - 1].next();
        let smooth = smooth_valences(&parts);
        let faces = mesh.faces().clone();
        let frame = Arc::new(SurfaceFrame { rules, faces, steps, mesh: parts, smooth });
        Ok(Self { points: frame.points(mesh.positions()), frame })
    }

    /// Returns the surface for other control points. This is much faster than creating a new surface.
    ///
    /// # Errors
    /// If the number of control points differs from that of the surface.
    pub fn with_control_points(&self, control: &[Point3<f64>]) -> Result<Self, Error> {
        if control.len() != self.frame.steps[0].level.mesh.vertices {
            bail!("the plan was made for a mesh with another topology");
        }
        Ok(Self { frame: self.frame.clone(), points: self.frame.points(control) })
    }

    /// Evaluates the surface at `(u, v)` of a face of the control mesh.
    ///
    /// In a triangle, corners 0, 1, 2 are at `(0, 0)`, `(1, 0)`, `(0, 1)`; in a quad, corners 0 to 3 are at `(0, 0)`, `(1, 0)`, `(1, 1)`,
    /// `(0, 1)`. With the Catmull-Clark scheme a face with another number of corners is divided into one quad per corner. In such a face
    /// the integer part of `u` is the index of the corner, the fraction of `u` is the position along the half edge after the corner, and
    /// `v` is the position along the half edge before it. Coordinates outside of the face are moved to the nearest side.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn evaluate(&self, face: usize, u: f64, v: f64) -> LimitPoint {
        let faces = &self.frame.faces;
        let (first, sides) = (faces.first_corner(face), faces.face(face).len());
        let mut position = FacePoint::new(u, v);
        let part = match self.frame.rules.scheme {
            PrimalScheme::Loop => 4 * face + position.halve_triangle(),
            PrimalScheme::CatmullClark if sides == 4 => first + position.halve_quad(),
            PrimalScheme::CatmullClark => first + position.corner(sides),
        };
        let later = 1..self.n_steps();
        let part = later.fold(part, |part, _| 4 * part + position.halve_quad());
        self.evaluate_part(part as u32, position)
    }

    /// The number of refinement steps from the control mesh to the mesh whose faces are the parts.
    pub(crate) fn n_steps(&self) -> usize {
        self.frame.steps.len()
    }

    /// The mesh whose faces are the parts of the surface.
    pub(crate) fn parts(&self) -> &Connectivity {
        &self.frame.mesh.mesh
    }

    /// Returns the index of the control mesh's face from which the refinement made the part with the index `part`.
    pub(crate) fn face_of(&self, part: u32) -> u32 {
        let control = &self.frame.steps[0].level.mesh;
        match self.frame.rules.scheme {
            PrimalScheme::Loop => part / 4,
            PrimalScheme::CatmullClark => control.face_of(part >> (2 * (self.n_steps() - 1))),
        }
    }

    pub(crate) fn scheme(&self) -> PrimalScheme {
        self.frame.rules.scheme
    }

    /// Evaluates the part with the index `part` at a position. The derivatives are with respect to the coordinates from which the
    /// [`FacePoint`] was created.
    pub(crate) fn evaluate_part(&self, part: u32, position: FacePoint) -> LimitPoint {
        self.part(part).evaluate(position)
    }

    /// Returns the part with the index `part`, for evaluation at several positions.
    pub(crate) fn part(&self, part: u32) -> LimitPart<'_> {
        LimitPart { surface: self, part, smooth: self.smooth(part) }
    }

    /// Returns the fast representation of a part that has no creases and at most one irregular corner; `Smooth::Not` for any other part.
    fn smooth(&self, part: u32) -> Smooth {
        let SurfaceFrame { rules, mesh: Level { mesh, .. }, smooth, .. } = &*self.frame;
        let valence = |half: u32| smooth[mesh.corners()[half as usize] as usize];
        fn is_known(n: u8) -> bool {
            (3..=MAX_VALENCE).contains(&usize::from(n))
        }
        match rules.scheme {
            PrimalScheme::Loop => match [3 * part, 3 * part + 1, 3 * part + 2].map(valence) {
                [n, 6, 6] if is_known(n) => {
                    let half = 3 * part;
                    Smooth::Triangle(SmoothTriangle::from_half_edge(
                        mesh,
                        &self.points,
                        half,
                        n.into(),
                    ))
                }
                _ => Smooth::Not,
            },
            PrimalScheme::CatmullClark => {
                let half = 4 * part;
                // After the refinement steps the irregular corner is the part's first corner; if it is the center of a polygon, the
                // irregular corner is opposite to the first corner.
                match [half, half + 1, half + 2, half + 3].map(valence) {
                    [n, 4, 4, 4] if is_known(n) => Smooth::Quad(self.smooth_quad(half, n)),
                    [4, 4, n, 4] if is_known(n) => {
                        Smooth::TurnedQuad(self.smooth_quad(half + 2, n))
                    }
                    _ => Smooth::Not,
                }
            }
        }
    }

    fn smooth_quad(&self, half: u32, n: u8) -> SmoothQuad {
        SmoothQuad::from_half_edge(&self.frame.mesh.mesh, &self.points, half, n.into())
    }

    /// Evaluates a part at a position by refining its neighborhood as a small mesh. This method works for all parts, also near borders and
    /// creases.
    pub(crate) fn evaluate_by_pieces(&self, part: u32, mut position: FacePoint) -> LimitPoint {
        let SurfaceFrame { rules, mesh: Level { mesh, creases, .. }, .. } = &*self.frame;
        let rules = *rules;
        let corners = match rules.scheme {
            PrimalScheme::Loop => TRIANGLE,
            PrimalScheme::CatmullClark => QUAD,
        };
        let mut piece = Piece::from_face(mesh, creases, &self.points, part);
        for _ in 0..MAX_DEPTH {
            if let Some(jet) = piece.regular(rules, position.at) {
                return position.point(jet);
            }
            if let Some(corner) = position.is_corner(corners) {
                return piece.corner(rules, corner);
            }
            let part = match rules.scheme {
                PrimalScheme::Loop => position.halve_triangle(),
                PrimalScheme::CatmullClark => position.halve_quad(),
            };
            piece = piece.refine(rules, part);
        }
        piece.corner(rules, position.nearest_corner(corners))
    }
}

/// A part of a limit surface, with a cache of the refined neighborhoods for the evaluated positions.
pub(crate) struct LimitPart<'a> {
    surface: &'a LimitSurface,
    part: u32,
    smooth: Smooth,
}

/// The fast representation of a part that has no creases and at most one irregular corner; `Not` for other parts.
enum Smooth {
    Triangle(SmoothTriangle),
    Quad(SmoothQuad),
    /// A quad whose irregular corner is the third corner, stored with its corners rotated so that this corner comes first.
    TurnedQuad(SmoothQuad),
    Not,
}

impl LimitPart<'_> {
    /// Evaluates this part of the limit surface at a position. The derivatives are with respect to the coordinates from which the
    /// [`FacePoint`] was created.
    pub(crate) fn evaluate(&mut self, position: FacePoint) -> LimitPoint {
        let [u, v] = position.at;
        let jet = match &mut self.smooth {
            Smooth::Triangle(triangle) => triangle.jet(u, v),
            Smooth::Quad(quad) => quad.jet(u, v),
            Smooth::TurnedQuad(quad) => quad.jet(1.0 - u, 1.0 - v).map(|jet| scale_jet(jet, -1.0)),
            Smooth::Not => None,
        };
        // Very close to an irregular corner there is no regular patch.
        match jet {
            Some(jet) => position.point(jet),
            None => self.surface.evaluate_by_pieces(self.part, position),
        }
    }
}

impl SurfaceFrame {
    fn points(&self, control: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let first = self.steps[0].positions(control);
        self.steps[1..].iter().fold(first, |points, step| step.positions(&points))
    }
}

/// Returns the number of neighbors of each vertex, or 255 if there are more; 0 for a vertex with a sharp edge, such as a border edge.
fn smooth_valences(level: &Level) -> Vec<u8> {
    let mut valences = vec![0u8; level.mesh.vertices];
    for &corner in level.mesh.corners() {
        let valence = &mut valences[corner as usize];
        *valence = valence.saturating_add(1);
    }
    for end in level.creases.iter().flat_map(|(edge, _)| level.mesh.ends(*edge)) {
        valences[end as usize] = 0;
    }
    valences
}
