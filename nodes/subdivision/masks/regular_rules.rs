//! The rules of the primal schemes at regular vertices and on smooth edges, as direct formulas without stored matrix rows. They give the
//! same results as the masks of `loop_masks.rs` and `catmull_clark.rs`.

use nalgebra::Point3;

use super::catmull_clark::CatmullClarkMasks;
use super::loop_masks::LoopMasks;
use super::vertex_rings::Masks;
use crate::refine::face_order::FaceOrder;
use crate::refine::half_edges::NONE;
use crate::refine::split::{Corners, Split, Triangles};

/// The direct formulas of a scheme for regular vertices and smooth edges, and the scheme's masks for all other vertices and edges.
pub(crate) trait RegularRules: Split {
    type Masks: Masks + Default;

    /// Computes the new vertex of the regular vertex at the position `old`, from the vertex's neighbors and the new vertices inside its
    /// faces.
    fn regular(
        self,
        old: Point3<f64>,
        neighbors: impl Iterator<Item = Point3<f64>>,
        faces: impl Iterator<Item = Point3<f64>>,
    ) -> Point3<f64>;

    /// Computes the new vertex on the smooth edge with the half-edges `halves`. `faces` are the new vertices inside the two faces of the
    /// edge.
    fn on_edge(
        self,
        walk: &impl Walk,
        corners: &[u32],
        halves: [u32; 2],
        old: &[Point3<f64>],
        faces: &[Point3<f64>],
    ) -> Point3<f64>;
}

/// Finds the next half-edge and the face of a half-edge. If all faces have the same number of sides, both follow by arithmetic without
/// reading the mesh.
pub(crate) trait Walk: Sync {
    fn next(&self, half: u32) -> u32;
    fn face(&self, half: u32) -> u32;
}

/// Finds next half-edges and faces in a mesh that has only quads.
pub(crate) struct QuadMesh;

impl Walk for QuadMesh {
    #[inline]
    fn next(&self, half: u32) -> u32 {
        half & !3 | (half + 1) & 3
    }

    #[inline]
    fn face(&self, half: u32) -> u32 {
        half / 4
    }
}

/// Finds next half-edges and faces in a mesh that has only triangles.
pub(crate) struct TriangleMesh;

impl Walk for TriangleMesh {
    #[inline]
    fn next(&self, half: u32) -> u32 {
        if half % 3 == 2 { half - 2 } else { half + 1 }
    }

    #[inline]
    fn face(&self, half: u32) -> u32 {
        half / 3
    }
}

impl Walk for FaceOrder {
    fn next(&self, half: u32) -> u32 {
        self.next(half)
    }

    fn face(&self, half: u32) -> u32 {
        self.face(half)
    }
}

impl RegularRules for Triangles {
    type Masks = LoopMasks;

    #[inline]
    fn regular(
        self,
        old: Point3<f64>,
        neighbors: impl Iterator<Item = Point3<f64>>,
        _: impl Iterator<Item = Point3<f64>>,
    ) -> Point3<f64> {
        let sum = neighbors.map(|point| point.coords).fold(Point3::origin(), |sum, x| sum + x);
        (old.coords * 0.625 + sum.coords * 0.0625).into()
    }

    #[inline]
    fn on_edge(
        self,
        walk: &impl Walk,
        corners: &[u32],
        [owner, twin]: [u32; 2],
        old: &[Point3<f64>],
        _: &[Point3<f64>],
    ) -> Point3<f64> {
        fn tip_coordinates(
            half: u32,
            old: &[Point3<f64>],
            corners: &[u32],
        ) -> nalgebra::Vector3<f64> {
            old[corners[half as usize] as usize].coords
        }
        let next = walk.next(owner);
        let [a, b, c] = [
            tip_coordinates(owner, old, corners),
            tip_coordinates(next, old, corners),
            tip_coordinates(walk.next(next), old, corners),
        ];
        if twin == NONE {
            return ((a + b) * 0.5).into();
        }
        let d = tip_coordinates(walk.next(walk.next(twin)), old, corners);
        ((a + b) * 0.375 + (c + d) * 0.125).into()
    }
}

impl RegularRules for Corners {
    type Masks = CatmullClarkMasks;

    #[inline]
    fn regular(
        self,
        old: Point3<f64>,
        neighbors: impl Iterator<Item = Point3<f64>>,
        faces: impl Iterator<Item = Point3<f64>>,
    ) -> Point3<f64> {
        let pairs = neighbors.zip(faces);
        let sum = pairs.fold(Point3::origin(), |sum, (a, b)| sum + (a.coords + b.coords));
        (old.coords * 0.5 + sum.coords * 0.0625).into()
    }

    #[inline]
    fn on_edge(
        self,
        walk: &impl Walk,
        corners: &[u32],
        [owner, twin]: [u32; 2],
        old: &[Point3<f64>],
        faces: &[Point3<f64>],
    ) -> Point3<f64> {
        let [a, b] =
            [owner, walk.next(owner)].map(|half| old[corners[half as usize] as usize].coords);
        if twin == NONE {
            return ((a + b) * 0.5).into();
        }
        let [f, g] = [owner, twin].map(|half| faces[walk.face(half) as usize].coords);
        (((a + b) + (f + g)) * 0.25).into()
    }
}
