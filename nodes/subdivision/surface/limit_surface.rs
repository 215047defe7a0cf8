//! The limit surface of a primal scheme at any place, not only at vertices.
//!
//! What lies around a face is refined until the place is in a part all of whose corners are regular; there the surface is a B-spline or
//! box spline patch. Each step halves the distance to the nearest corner that is not regular, so that few steps do; exactly there the
//! limit masks are taken. Away from borders and creases the same few numbers are refined again and again (`smooth_triangle.rs`,
//! `smooth_quad.rs`), near them small meshes (`piece.rs`). This gives what Stam's eigenvectors give ("Exact evaluation of Catmull-Clark subdivision surfaces at arbitrary
//! parameter values", 1998), without their tables, and at creases, too.

use std::sync::Arc;

use maquette_value::{Faces, Mesh};
use nalgebra::Point3;

use super::face_point::{FacePoint, QUAD, TRIANGLE};
use super::limit_point::LimitPoint;
use super::piece::Piece;
use super::smooth_quad::SmoothQuad;
use super::smooth_triangle::{MOST, SmoothTriangle, scaled};
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::HalfEdges;
use crate::refine::level::Level;
use crate::refine::primal::Primal;
use crate::refine::topology::Topology;
use crate::rules::Rules;
use crate::scheme::PrimalScheme;
use crate::{SubdivideError, Subdivision};

/// So many steps bring a place as near to a corner as its coordinates can tell.
const DEEPEST: usize = 40;

/// A surface that Loop's or Catmull's and Clark's scheme tends to.
#[derive(Clone)]
pub struct LimitSurface {
    frame: Arc<SurfaceFrame>,
    /// The vertices of the parts.
    points: Vec<Point3<f64>>,
}

/// What of a limit surface does not depend on places.
struct SurfaceFrame {
    rules: Rules<PrimalScheme>,
    /// The faces of the control mesh.
    faces: Faces,
    /// The steps to the parts: one, but two if there are polygons other than quads to be made quads first.
    steps: Vec<Primal>,
    /// The parts of the faces: each has one corner at most where other than the usual number of them meet.
    mesh: Level,
    /// Number of neighbors of its vertices; 0 at borders and creases, and where it is too large to be counted.
    smooth: Vec<u8>,
}

impl LimitSurface {
    /// The limit surface of `mesh` by the scheme and the rules of `how`; its number of levels does not matter.
    ///
    /// # Errors
    /// If the scheme cannot refine a face, or is [`Scheme::DooSabin`](crate::Scheme::DooSabin), or the mesh is not manifold.
    pub fn new(mesh: &Mesh, how: Subdivision) -> Result<Self, SubdivideError> {
        let rules = how.rules().primal().ok_or(SubdivideError::NoPatches)?;
        let first = Level::first(&Topology::of(mesh, how), rules.scheme)?;
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

    /// The surface of other control points, as many as before: much faster than a new one.
    ///
    /// # Errors
    /// If there are more or fewer.
    pub fn moved(&self, control: &[Point3<f64>]) -> Result<Self, SubdivideError> {
        if control.len() != self.frame.steps[0].level.mesh.vertices {
            return Err(SubdivideError::OtherTopology);
        }
        Ok(Self { frame: self.frame.clone(), points: self.frame.points(control) })
    }

    /// The point at `(u, v)` of a face of the control mesh.
    ///
    /// In a triangle, corners 0, 1, 2 are at `(0, 0)`, `(1, 0)`, `(0, 1)`; in a quad, corners 0 to 3 at `(0, 0)`, `(1, 0)`, `(1,
    /// 1)`, `(0, 1)`. With Catmull's and Clark's scheme a face with another number of corners has a quad at each of them: `u` is
    /// the corner's number and a fraction along the half edge that follows it, `v` the fraction along the half edge before it.
    /// Coordinates outside of the face are taken to its nearest side.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn at(&self, face: usize, u: f64, v: f64) -> LimitPoint {
        let faces = &self.frame.faces;
        let (first, sides) = (faces.first_corner(face), faces.face(face).len());
        let mut place = FacePoint::new(u, v);
        let part = match self.frame.rules.scheme {
            PrimalScheme::Loop => 4 * face + place.halve_triangle(),
            PrimalScheme::CatmullClark if sides == 4 => first + place.halve_quad(),
            PrimalScheme::CatmullClark => first + place.corner(sides),
        };
        let later = 1..self.n_steps();
        let part = later.fold(part, |part, _| 4 * part + place.halve_quad());
        self.at_part(part as u32, place)
    }

    /// The number of steps that make the parts.
    pub(crate) fn n_steps(&self) -> usize {
        self.frame.steps.len()
    }

    /// The mesh of the parts.
    pub(crate) fn parts(&self) -> &Connectivity {
        &self.frame.mesh.mesh
    }

    /// The face of the control mesh in which a part lies.
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

    /// The point at a place of a part, by the coordinates that the place came from.
    pub(crate) fn at_part(&self, part: u32, place: FacePoint) -> LimitPoint {
        self.part(part).at(place)
    }

    /// A part, for looking at several places of it.
    pub(crate) fn part(&self, part: u32) -> LimitPart<'_> {
        LimitPart { surface: self, part, smooth: self.smooth(part) }
    }

    /// A part without creases, with one irregular corner at most.
    fn smooth(&self, part: u32) -> Smooth {
        let SurfaceFrame { rules, mesh: Level { mesh, .. }, smooth, .. } = &*self.frame;
        let valence = |half: u32| smooth[mesh.corners()[half as usize] as usize];
        fn is_known(n: u8) -> bool {
            (3..=MOST).contains(&usize::from(n))
        }
        match rules.scheme {
            PrimalScheme::Loop => match [3 * part, 3 * part + 1, 3 * part + 2].map(valence) {
                [n, 6, 6] if is_known(n) => {
                    let half = 3 * part;
                    Smooth::Triangle(SmoothTriangle::around(mesh, &self.points, half, n.into()))
                }
                _ => Smooth::Not,
            },
            PrimalScheme::CatmullClark => {
                let half = 4 * part;
                let quad =
                    |half: u32, n: u8| SmoothQuad::around(mesh, &self.points, half, n.into());
                // One step puts the irregular corner first, or across from it where it is the middle of a polygon.
                match [half, half + 1, half + 2, half + 3].map(valence) {
                    [n, 4, 4, 4] if is_known(n) => Smooth::Quad(quad(half, n)),
                    [4, 4, n, 4] if is_known(n) => Smooth::TurnedQuad(quad(half + 2, n)),
                    _ => Smooth::Not,
                }
            }
        }
    }

    /// The point at a place of any part: by refinement of what lies around it.
    pub(crate) fn by_pieces(&self, part: u32, mut place: FacePoint) -> LimitPoint {
        let SurfaceFrame { rules, mesh: Level { mesh, creases, .. }, .. } = &*self.frame;
        let rules = *rules;
        let corners = match rules.scheme {
            PrimalScheme::Loop => TRIANGLE,
            PrimalScheme::CatmullClark => QUAD,
        };
        let mut piece = Piece::around(mesh, creases, &self.points, part);
        for _ in 0..DEEPEST {
            if let Some(jet) = piece.regular(rules, place.at) {
                return place.point(jet);
            }
            if let Some(corner) = place.is_corner(corners) {
                return piece.corner(rules, corner);
            }
            let part = match rules.scheme {
                PrimalScheme::Loop => place.halve_triangle(),
                PrimalScheme::CatmullClark => place.halve_quad(),
            };
            piece = piece.refined(rules, part);
        }
        piece.corner(rules, place.nearest_corner(corners))
    }
}

/// A part of a limit surface, with what refinement made of it where places of it were asked for.
pub(crate) struct LimitPart<'a> {
    surface: &'a LimitSurface,
    part: u32,
    smooth: Smooth,
}

/// A part without creases, with one irregular corner at most.
enum Smooth {
    Triangle(SmoothTriangle),
    Quad(SmoothQuad),
    /// A quad from its third corner on.
    TurnedQuad(SmoothQuad),
    Not,
}

impl LimitPart<'_> {
    /// The point at a place of the part, by the coordinates that the place came from.
    pub(crate) fn at(&mut self, place: FacePoint) -> LimitPoint {
        let [u, v] = place.at;
        let jet = match &mut self.smooth {
            Smooth::Triangle(triangle) => triangle.jet(u, v),
            Smooth::Quad(quad) => quad.jet(u, v),
            Smooth::TurnedQuad(quad) => quad.jet(1.0 - u, 1.0 - v).map(|jet| scaled(jet, -1.0)),
            Smooth::Not => None,
        };
        // Too near to an irregular corner there is none, either.
        match jet {
            Some(jet) => place.point(jet),
            None => self.surface.by_pieces(self.part, place),
        }
    }
}

impl SurfaceFrame {
    fn points(&self, control: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let first = self.steps[0].positions(control);
        self.steps[1..].iter().fold(first, |points, step| step.positions(&points))
    }
}

/// Number of neighbors of the vertices that no sharp edge touches, where it fits; 0 for the others.
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
