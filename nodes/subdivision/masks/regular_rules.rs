//! The rules of the primal schemes at regular vertices and on smooth edges, as formulas on points: most of a mesh needs no row of
//! its own. They are those of `loop_masks.rs` and `catmull_clark.rs`.

use nalgebra::Point3;

use super::catmull_clark::CatmullClarkMasks;
use super::loop_masks::LoopMasks;
use super::stars::Masks;
use crate::refine::half_edges::NONE;
use crate::refine::split::{Corners, Split, Triangles};
use crate::refine::turns::Turns;

/// The formulas of a scheme, and its masks for everything else.
pub(crate) trait RegularRules: Split {
    type Masks: Masks + Default;

    /// The new vertex at a regular one at `old`, from its neighbors and the new vertices of its faces.
    fn regular(
        self,
        old: Point3<f64>,
        neighbors: impl Iterator<Item = Point3<f64>>,
        faces: impl Iterator<Item = Point3<f64>>,
    ) -> Point3<f64>;

    /// The new vertex on a smooth edge with these half-edges; `faces` are the new vertices of the faces.
    fn on_edge(
        self,
        walk: &impl Walk,
        corners: &[u32],
        halves: [u32; 2],
        old: &[Point3<f64>],
        faces: &[Point3<f64>],
    ) -> Point3<f64>;
}

/// How to go from a half-edge to its neighbor and its face; where all faces are alike, without a look at the mesh.
pub(crate) trait Walk: Sync {
    fn next(&self, half: u32) -> u32;
    fn face(&self, half: u32) -> u32;
}

/// Faces of four sides.
pub(crate) struct Quads;

impl Walk for Quads {
    #[inline]
    fn next(&self, half: u32) -> u32 {
        half & !3 | (half + 1) & 3
    }

    #[inline]
    fn face(&self, half: u32) -> u32 {
        half / 4
    }
}

/// Triangles.
pub(crate) struct ThreeSided;

impl Walk for ThreeSided {
    #[inline]
    fn next(&self, half: u32) -> u32 {
        if half % 3 == 2 { half - 2 } else { half + 1 }
    }

    #[inline]
    fn face(&self, half: u32) -> u32 {
        half / 3
    }
}

impl Walk for Turns {
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
        fn at(half: u32, old: &[Point3<f64>], corners: &[u32]) -> nalgebra::Vector3<f64> {
            old[corners[half as usize] as usize].coords
        }
        let next = walk.next(owner);
        let [a, b, c] =
            [at(owner, old, corners), at(next, old, corners), at(walk.next(next), old, corners)];
        if twin == NONE {
            return ((a + b) * 0.5).into();
        }
        let d = at(walk.next(walk.next(twin)), old, corners);
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
