//! Checks that the connected parts of a mesh together bound a solid.

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Progress};
use maquette_value::parallel::UntilStopped;
use maquette_value::{Bounds, BoxTree, Mesh};
use nalgebra::{Point3, Vector3};

use super::rays::{Hit, STARTS, hit};

/// Distance from a part's surface at which winding numbers are computed, as a fraction of the mesh's extent.
const BESIDE: f64 = 1e-7;

/// Distance between a ray's start and a triangle below which the ray is unclear, as a fraction of the mesh's extent.
const NEAR: f64 = 1e-13;

/// A connected part of a mesh that does not bound a solid together with the other parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BadPart {
    /// The number of the part, from 1 on, in the order of its first face.
    pub(crate) number: usize,
    /// The number of all parts.
    pub(crate) of: usize,
    /// A point of the part's surface.
    pub(crate) at: Point3<f64>,
    pub(crate) defect: Defect,
}

/// What is wrong with a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Defect {
    /// Its surface crosses that of another part.
    Crosses,
    /// It is inside of another part, and both face outward.
    Inside,
    /// Its faces look inward.
    InsideOut,
}

impl BadPart {
    /// Returns a description of the part, its defect and the nodes that repair it, for an error message.
    pub(crate) fn describe(&self) -> String {
        let Self { number, of, at, defect } = self;
        let part = format!("part {number} of {of} at ({:.3}, {:.3}, {:.3})", at.x, at.y, at.z);
        match defect {
            Defect::Crosses => format!(
                "{part} overlaps another part; use `Boolean` with an empty `with` to unite the parts"
            ),
            Defect::Inside => format!(
                "{part} is inside of another part, and both face outward; use `Orient` to make a cavity of it, or `Boolean` with an empty `with` to unite the parts"
            ),
            Defect::InsideOut => {
                format!("{part} is inside out; use `Orient` to turn it outward")
            }
        }
    }
}

/// The connected parts of a closed mesh.
pub(crate) struct Parts<'a> {
    mesh: &'a Mesh,
    /// The part of each face.
    of_face: Vec<u32>,
    count: usize,
}

impl<'a> Parts<'a> {
    pub(crate) fn new(mesh: &'a Mesh) -> Self {
        let mut sets = UnionFind::new(mesh.positions().len());
        for face in mesh.faces().iter() {
            face[1..].iter().for_each(|&vertex| sets.union(face[0], vertex));
        }
        let mut numbers = vec![u32::MAX; mesh.positions().len()];
        let mut count = 0;
        let of_face = mesh.faces().iter().map(|face| {
            let number = &mut numbers[sets.find(face[0]) as usize];
            if *number == u32::MAX {
                *number = count;
                count += 1;
            }
            *number
        });
        let of_face = of_face.collect();
        Self { mesh, of_face, count: count as usize }
    }

    /// Returns the first part whose surface crosses that of another part. Crossings inside of one part are not looked for.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn crossing(
        &self,
        progress: &Progress<'_>,
    ) -> Result<Option<BadPart>, CancelledError> {
        let faces = self.faces_near_other_parts();
        if faces.is_empty() {
            return Ok(None);
        }
        let near = self.mesh.select(&faces);
        let pairs = near.crossings(|| progress.check())?;
        fn part(face: u32, faces: &[u32], of_face: &[u32]) -> u32 {
            of_face[faces[face as usize] as usize]
        }
        let found = pairs
            .into_iter()
            .find(|&[a, b]| part(a, &faces, &self.of_face) != part(b, &faces, &self.of_face));
        Ok(found.map(|[a, b]| {
            let face = near.faces().face(a as usize);
            let at = near.first_triangle_center(face);
            self.bad_part(
                part(a, &faces, &self.of_face).max(part(b, &faces, &self.of_face)),
                at,
                Defect::Crosses,
            )
        }))
    }

    /// Returns the first part that does not separate the outside, in front of its faces, from the inside. The parts do not cross.
    ///
    /// # Errors
    /// Returns an error if the evaluation is cancelled.
    pub(crate) fn misplaced(
        &self,
        progress: &Progress<'_>,
    ) -> Result<Option<BadPart>, CancelledError> {
        let Some((low, high)) = self.mesh.bounds() else { return Ok(None) };
        if self.count < 2 {
            return Ok(None);
        }
        let extent = (high - low).amax();
        let triangles: Vec<[Point3<f64>; 3]> = (0..self.mesh.faces().len())
            .until_stopped()
            .flat_map(|face: usize| self.face_triangles(face))
            .collect();
        let boxes = BoxTree::new(triangles.iter().map(|it| Bounds::from_points(it)));
        for (part, corners) in self.largest_triangles().into_iter().enumerate() {
            progress.check()?;
            let [a, b, c] = corners;
            let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else { continue };
            let windings = [1.0, -1.0].map(|side| {
                let step: Vector3<f64> = normal * (side * BESIDE * extent);
                winding(corners, step, normal.iamax(), extent, (&triangles, &boxes))
            });
            let defect = match windings {
                [0, 1] => continue,
                // The triangle lies on a triangle of another part, which it touches.
                [from, to] if from == to => continue,
                [from, to] if from < to && 1 < to => Defect::Inside,
                _ => Defect::InsideOut,
            };
            return Ok(Some(self.bad_part(part as u32, a, defect)));
        }
        Ok(None)
    }

    fn bad_part(&self, part: u32, at: Point3<f64>, defect: Defect) -> BadPart {
        BadPart { number: part as usize + 1, of: self.count, at, defect }
    }

    fn face_triangles(&self, face: usize) -> impl Iterator<Item = [Point3<f64>; 3]> {
        let corners = self.mesh.faces().face(face);
        let triangles = self.mesh.face_triangles(face);
        triangles.map(|it| it.map(|k| self.mesh.positions()[corners[k as usize] as usize]))
    }

    /// Returns the largest triangle of each part, the first among equals.
    fn largest_triangles(&self) -> Vec<[Point3<f64>; 3]> {
        let mut largest = vec![(-1.0, [Point3::origin(); 3]); self.count];
        for (face, &part) in self.of_face.iter().enumerate().until_stopped() {
            for corners in self.face_triangles(face) {
                let [a, b, c] = corners;
                let area = (b - a).cross(&(c - a)).norm();
                let own = &mut largest[part as usize];
                if own.0 < area {
                    *own = (area, corners);
                }
            }
        }
        largest.into_iter().map(|it| it.1).collect()
    }

    /// Returns the faces whose boxes overlap the box of another part.
    fn faces_near_other_parts(&self) -> Vec<u32> {
        fn bounds_of(face: usize, mesh: &Mesh) -> Bounds {
            let corners = mesh.faces().face(face).iter();
            let corners: Vec<_> =
                corners.map(|&vertex| mesh.positions()[vertex as usize]).collect();
            Bounds::from_points(&corners)
        }
        if self.count < 2 {
            return Vec::new();
        }
        let mut of_parts: Vec<Option<Bounds>> = vec![None; self.count];
        for (face, &part) in self.of_face.iter().enumerate().until_stopped() {
            let bounds = bounds_of(face, self.mesh);
            let own = &mut of_parts[part as usize];
            *own = Some(own.map_or(bounds, |own| own.join(&bounds)));
        }
        let of_parts: Vec<Bounds> = of_parts.into_iter().flatten().collect();
        let tree = BoxTree::new(of_parts.iter().copied());
        // The other parts whose boxes overlap that of each part.
        let others: Vec<Vec<u32>> = (0..)
            .zip(&of_parts)
            .map(|(part, bounds)| {
                let mut others = Vec::new();
                tree.visit_overlapping(bounds, |other| {
                    if other != part {
                        others.push(other);
                    }
                });
                others
            })
            .collect();
        (0..self.of_face.len())
            .until_stopped()
            .filter(|&face| {
                let others = &others[self.of_face[face] as usize];
                !others.is_empty() && {
                    let bounds = bounds_of(face, self.mesh);
                    others.iter().any(|&other| of_parts[other as usize].overlaps(&bounds))
                }
            })
            .map(|face| face as u32)
            .collect()
    }
}

/// Returns the winding number of some triangles around a point beside one of them: `step` from the triangle `corners`. The ray runs along
/// the given axis.
fn winding(
    corners: [Point3<f64>; 3],
    step: Vector3<f64>,
    axis: usize,
    extent: f64,
    (triangles, boxes): (&[[Point3<f64>; 3]], &BoxTree),
) -> i32 {
    let mut winding = 0;
    for weights in STARTS {
        let mut from: Point3<f64> = Point3::from(step);
        corners.iter().zip(weights).for_each(|(corner, weight)| from += corner.coords * weight);
        let found = along_ray(from, axis, NEAR * extent, (triangles, boxes));
        winding = found.winding;
        if found.is_clear {
            break;
        }
    }
    winding
}

/// The winding number at the start of a ray.
struct AlongRay {
    winding: i32,
    /// False if the ray passes so close to an edge that the winding number may be wrong.
    is_clear: bool,
}

fn along_ray(
    from: Point3<f64>,
    axis: usize,
    near: f64,
    (triangles, boxes): (&[[Point3<f64>; 3]], &BoxTree),
) -> AlongRay {
    let mut to = from;
    to[axis] = f64::MAX;
    let mut found = AlongRay { winding: 0, is_clear: true };
    boxes.visit_overlapping(&Bounds { low: from, high: to }, |other| {
        let other = triangles[other as usize].map(|it| it.coords.into());
        match hit(other, from.coords.into(), axis, near) {
            Hit::None => {}
            Hit::Unclear => found.is_clear = false,
            Hit::Enters => found.winding -= 1,
            Hit::Leaves => found.winding += 1,
        }
    });
    found
}

/// Returns the winding number of the triangles of a closed mesh around a point. If rays in all directions pass too close to edges, rays
/// from points at a distance of up to `nudge` decide.
pub(crate) fn winding_number(
    at: Point3<f64>,
    nudge: f64,
    (triangles, boxes): (&[[Point3<f64>; 3]], &BoxTree),
) -> i32 {
    let steps = [0.0, 0.3, -0.7, 1.0].map(|step| Vector3::new(step, 0.61 * step, -0.83 * step));
    let rays = steps.into_iter().flat_map(|step| [2, 1, 0].map(|axis| (at + step * nudge, axis)));
    let mut found = rays.map(|(from, axis)| along_ray(from, axis, 0.0, (triangles, boxes)));
    found.find(|it| it.is_clear).map_or(0, |it| it.winding)
}
