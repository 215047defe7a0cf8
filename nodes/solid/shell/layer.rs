//! A layer of material behind a surface, with the faces of the surface.
//!
//! Each vertex of the surface is moved backwards along a direction of its own until the moved faces are far enough from the whole surface.
//! Where the moved faces would fold, the directions are smoothed; where there is no room, the vertices move less. So a layer never
//! intersects itself, but may be thinner than requested: the caller adds material there.

use maquette_base::topology::lists::Lists;
use maquette_node::{CancelledError, Progress};
use maquette_value::TriangleTree;
use nalgebra::{Point3, Vector3};

use super::backs::{Backs, Motion, Side};
use super::probes::{Probe, Probes};

/// Requested height of a layer, as a multiple of its thickness: the room for rounding errors and small chords.
const AIM: f64 = 1.01;

/// Maximum height of a layer at a vertex, as a multiple of the thickness. At a sharp edge the height is greater than the thickness.
const MAX_HEIGHT: f64 = 2.5;

/// Maximum height of a layer along the rays of a sensor, as a multiple of the thickness: behind faces that are seen at a grazing angle.
const MAX_SLANT: f64 = 4.0;

/// Maximum fraction of the corners whose face looks away from the sensor: noise turns some faces over.
const MAX_AWAY: f64 = 0.02;

/// Minimum cosine of the angle between the direction of a vertex and the normal of each of its faces, where one exists.
const MIN_COSINE: f64 = 0.2;

/// Minimum cosine of the angle between the directions at both ends of an edge of a smooth surface.
const SMOOTH: f64 = 0.8;

/// Minimum cosine of the angle between a moved point's direction and the way from its nearest point of the surface. At smaller cosines the
/// point is as near to another part of the surface: it does not gain distance by moving on.
const FREE: f64 = 0.3;

/// Minimum cosine of the angle between the direction of a vertex and the normals of its faces, at which the vertex is not on a sharp edge.
const BLUNT: f64 = 0.9;

/// Maximum number of vertices near a border vertex that determine the direction there.
const MAX_NEAR: usize = 200;

/// Weight of the way to the middles of the faces in the directions of fans that share a vertex: large, so that fans at right angles
/// part.
const INWARDS: f64 = 3.0;

/// Factor by which the height at a vertex is reduced in each round in which there is no room.
pub(super) const RETREAT: f64 = 0.6;

/// Maximum difference of the heights at the ends of an edge, as a multiple of its length, beside vertices without room.
const STEEPEST: f64 = 1.5;

/// Maximum numbers of rounds: of smoothing directions, of raising heights, and of reducing them.
const SMOOTHINGS: usize = 10;
const RAISES: usize = 6;
const RETREATS: usize = 8;
const RECESSIONS: usize = 8;

impl Backs<'_> {
    /// Returns the motion that makes the layer behind the surface as thick as possible, at most `thickness` mm, and the distances that were
    /// measured for it. `tree` is the tree of the surface.
    pub(super) fn fit<'a>(
        &'a self,
        tree: &'a TriangleTree,
        thickness: f64,
        progress: &Progress<'_>,
    ) -> Result<(Motion, Probes<'a>), CancelledError> {
        let heights = Vec::new();
        let shifts = vec![Vector3::zeros(); self.first.len()];
        let mut motion = Motion { directions: self.directions(), heights, shifts };
        self.lean_outward(&mut motion.directions, thickness);
        for _ in 0..SMOOTHINGS {
            progress.check()?;
            motion.heights = self.miters(&motion.directions, AIM * thickness);
            let folded = self.folded(&self.moved(&motion));
            if !folded.contains(&true) {
                break;
            }
            self.smooth(&mut motion.directions, folded);
        }
        motion.heights = self.miters(&motion.directions, AIM * thickness);
        let mut probes = Probes::new(self, tree, thickness);
        for round in 0..RAISES {
            progress.check()?;
            let is_raised = raise(&mut probes, &mut motion, thickness, round < RAISES / 2);
            if !is_raised && RAISES / 2 <= round {
                break;
            }
        }
        for _ in 0..RETREATS {
            progress.check()?;
            let mut is_tight = self.folded(&self.moved(&motion));
            for (is_tight, probe) in is_tight.iter_mut().zip(probes.at_backs(&motion)) {
                *is_tight |= probe.distance < 0.99 * thickness && probe.cosine <= FREE;
            }
            if !is_tight.contains(&true) {
                break;
            }
            self.retreat(&mut motion.heights, is_tight);
        }
        Ok((motion, probes))
    }

    /// Leans the directions at borders outward until the walls there enclose all places that are `thickness` mm behind the vertices nearby.
    /// Such places are beyond an upright wall where the surface bends more tightly than the thickness.
    fn lean_outward(&self, directions: &mut [Vector3<f64>], thickness: f64) {
        let outward = self.shifts(1.0);
        let neighbors = Lists::group(self.first.len(), || {
            self.sides
                .iter()
                .flat_map(|side| [side.backs, [side.backs[1], side.backs[0]]])
                .map(|[from, to]| (from, to))
        });
        let upright = directions.to_vec();
        for (back, outward) in outward.iter().enumerate() {
            let Some(outward) = outward.try_normalize(0.0) else { continue };
            let up = upright[back] - outward * upright[back].dot(&outward);
            let Some(up) = up.try_normalize(0.0) else { continue };
            let start = upright[back].dot(&outward) / upright[back].dot(&up);
            let mut lean = start;
            let mut near = vec![back as u32];
            let mut next = 0;
            while let Some(&at) = near.get(next) {
                next += 1;
                let way = self.position(at as usize) - self.position(back);
                let end = way + upright[at as usize] * thickness;
                if MIN_COSINE * thickness < end.dot(&up) {
                    lean = lean.max(end.dot(&outward) / end.dot(&up));
                }
                let others = neighbors.list(at as usize).iter().filter(|&&other| {
                    let way = self.position(other as usize) - self.position(back);
                    way.norm() < thickness && !near.contains(&other)
                });
                let others: Vec<u32> =
                    others.copied().take(MAX_NEAR - near.len().min(MAX_NEAR)).collect();
                near.extend(others);
            }
            if start < lean {
                directions[back] = self.turn(back, up + outward * lean);
            }
        }
    }

    /// Returns the motion by `height` mm along the rays of the sensor of a capture, or else against the mean direction of the faces. A
    /// surface that is seen whole from there does not fold, however rough it is.
    fn away(&self, height: f64) -> Motion {
        let faces = self.mesh.faces().iter();
        let mean = -faces.map(|face| self.mesh.area_vector(face)).sum::<Vector3<f64>>();
        let count = self.first.len();
        Motion {
            directions: (0..count)
                .map(|back: usize| match self.mesh.frame() {
                    Some(_) => {
                        let ray = self.position(back).coords;
                        let sign = if mean.dot(&ray) < 0.0 { -1.0 } else { 1.0 };
                        ray.try_normalize(0.0).unwrap_or_default() * sign
                    }
                    None => mean.try_normalize(0.0).unwrap_or_default(),
                })
                .collect(),
            heights: vec![height; count],
            shifts: vec![Vector3::zeros(); count],
        }
    }

    /// Returns the motion along the rays of the sensor of a capture, see [`away`](Self::away), by which the moved faces are `thickness` mm
    /// from the surface, as far as [`MAX_SLANT`] allows it, and the distances that were measured for it; `None` if too many
    /// faces look away from the sensor.
    pub(super) fn recede<'a>(
        &'a self,
        tree: &'a TriangleTree,
        thickness: f64,
        progress: &Progress<'_>,
    ) -> Result<Option<(Motion, Probes<'a>)>, CancelledError> {
        let mut motion = self.away(AIM * thickness);
        let faces_away = |side: &&Side| {
            let direction = motion.directions[side.backs[0] as usize];
            0.0 <= self.normals[side.face as usize].dot(&direction)
        };
        let away: Vec<u32> =
            self.sides.iter().filter(faces_away).map(|side| side.backs[0]).collect();
        if MAX_AWAY * (self.sides.len() as f64) < away.len() as f64 {
            return Ok(None);
        }
        for back in away {
            let direction = motion.directions[back as usize];
            motion.directions[back as usize] = self.turn(back as usize, direction);
        }
        let mut probes = Probes::new(self, tree, thickness);
        for round in 0..RECESSIONS {
            progress.check()?;
            let slant = |probe: &Probe| match probe.distance < thickness {
                true => (AIM * thickness - probe.distance) / probe.cosine.max(1.0 / MAX_SLANT),
                false => 0.0,
            };
            let lacks = probes.lacks(&motion, slant, round < RECESSIONS / 2);
            for (height, lack) in motion.heights.iter_mut().zip(&lacks) {
                *height = (*height + lack).min(MAX_SLANT * thickness);
            }
            if RECESSIONS / 2 <= round && lacks.iter().all(|lack| *lack == 0.0) {
                break;
            }
        }
        Ok(Some((motion, probes)))
    }

    /// Returns for each back vertex the direction backwards: the mean of the normals of its faces, by angle, reversed, and turned until all
    /// of its faces look away from it, if there is such a direction.
    pub(super) fn directions(&self) -> Vec<Vector3<f64>> {
        let mut sums = vec![Vector3::zeros(); self.first.len()];
        let (faces, positions) = (self.mesh.faces(), self.mesh.positions());
        for face in 0..faces.len() {
            let (corners, first) = (faces.face(face), faces.first_corner(face));
            for (k, &vertex) in corners.iter().enumerate() {
                let at = positions[vertex as usize];
                let [next, last] = [k + 1, k + corners.len() - 1]
                    .map(|k| positions[corners[k % corners.len()] as usize] - at);
                let angle = libm::atan2(next.cross(&last).norm(), next.dot(&last));
                sums[self.of_corner[first + k] as usize] -= self.normals[face] * angle;
            }
        }
        for (back, sum) in sums.iter_mut().enumerate() {
            *sum = self.turn(back, *sum);
        }
        self.extrapolate(&mut sums);
        self.separate(&mut sums);
        sums
    }

    /// Returns the height at each back vertex at which the layer has the given thickness behind each face there; it is greater than the
    /// thickness at sharp edges only.
    fn miters(&self, directions: &[Vector3<f64>], thickness: f64) -> Vec<f64> {
        let heights = directions.iter().enumerate().map(|(back, direction)| {
            let faces = self.faces.list(back).iter();
            let cosines = faces.map(|&face| -self.normals[face as usize].dot(direction));
            match cosines.fold(1.0, f64::min) {
                least if least < BLUNT => thickness * (1.0 / least.max(1e-9)).min(MAX_HEIGHT),
                _ => thickness,
            }
        });
        heights.collect()
    }

    /// Turns the directions of fans that share a vertex towards the middles of their own faces, so that their walls do not touch.
    fn separate(&self, directions: &mut [Vector3<f64>]) {
        let mut fans = vec![0u32; self.mesh.positions().len()];
        (0..self.first.len()).for_each(|back| fans[self.vertex(back) as usize] += 1);
        for back in (0..self.first.len()).filter(|&back| 1 < fans[self.vertex(back) as usize]) {
            let faces = self.faces.list(back).iter();
            let middles = faces.map(|&face| {
                let face = self.mesh.faces().face(face as usize);
                let points = face.iter().map(|&it| self.mesh.positions()[it as usize].coords);
                points.sum::<Vector3<f64>>() / face.len() as f64 - self.position(back).coords
            });
            let inwards = middles.sum::<Vector3<f64>>().try_normalize(0.0).unwrap_or_default();
            directions[back] = self.turn(back, directions[back] + inwards * INWARDS);
        }
    }

    /// Extrapolates the directions at borders. All faces of a border vertex are on one side of it, so that the mean of their normals is
    /// that at a place half an edge away: the direction at the border is as far from this mean as the mean is from the directions one edge
    /// away. Walls that would lean inwards stay perpendicular to the faces, so that the layer is thick enough behind all of them.
    fn extrapolate(&self, directions: &mut [Vector3<f64>]) {
        let mut along: Vec<Option<Vector3<f64>>> = vec![None; directions.len()];
        for side in self.borders.iter().map(|&side| &self.sides[side as usize]) {
            let [a, b] = side.backs.map(|back| back as usize);
            for [to, from] in [[a, b], [b, a]] {
                *along[to].get_or_insert(directions[to] * 2.0) += directions[from];
            }
        }
        let mut inner = vec![[Vector3::zeros(); 2]; directions.len()];
        for side in &self.sides {
            let [a, b] = side.backs.map(|back| back as usize);
            for [to, from] in [[a, b], [b, a]] {
                if along[to].is_some() && along[from].is_none() {
                    inner[to][0] += directions[from];
                    inner[to][1] += self.position(from) - self.position(to);
                }
            }
        }
        for (back, (along, [inner, inwards])) in along.into_iter().zip(inner).enumerate() {
            let ends =
                along.and_then(|it| Some((it.try_normalize(0.0)?, inner.try_normalize(0.0)?)));
            let Some((along, inner)) = ends else { continue };
            // At a sharp edge there is nothing to extrapolate.
            if SMOOTH < along.dot(&inner) && (along - inner).dot(&inwards) < 0.0 {
                directions[back] = self.turn(back, along * 2.0 - inner);
            }
        }
    }

    /// Turns a direction until the faces of the back vertex look away from it: the perceptron algorithm of Rosenblatt, "The perceptron"
    /// (1958).
    fn turn(&self, back: usize, direction: Vector3<f64>) -> Vector3<f64> {
        let faces = self.faces.list(back).iter().map(|&face| self.normals[face as usize]);
        let mut direction = direction.try_normalize(0.0).unwrap_or_default();
        for _ in 0..32 {
            let worst =
                faces.clone().max_by(|a, b| a.dot(&direction).total_cmp(&b.dot(&direction)));
            let Some(worst) = worst.filter(|it| -MIN_COSINE < it.dot(&direction)) else { break };
            direction = (direction - worst * 0.5).try_normalize(0.0).unwrap_or(-worst);
        }
        direction
    }

    /// Averages the directions of the given back vertices, and of those near them, with those of their neighbors. The directions at a
    /// border are averaged along it, so that the walls at a border stay upright.
    fn smooth(&self, directions: &mut [Vector3<f64>], mut chosen: Vec<bool>) {
        let mut is_border = vec![false; chosen.len()];
        for side in self.borders.iter().map(|&side| &self.sides[side as usize]) {
            side.backs.iter().for_each(|&back| is_border[back as usize] = true);
        }
        for _ in 0..2 {
            let before = chosen.clone();
            for side in &self.sides {
                let [a, b] = side.backs.map(|back| back as usize);
                chosen[a] |= before[b];
                chosen[b] |= before[a];
            }
        }
        let mut sums = directions.to_vec();
        for side in &self.sides {
            let [a, b] = side.backs.map(|back| back as usize);
            // An edge inside of the surface has two sides, so each of its ends is added twice.
            let weight = if side.is_border { 1.0 } else { 0.5 };
            for [to, from] in [[a, b], [b, a]] {
                if side.is_border || !is_border[to] {
                    sums[to] += directions[from] * weight;
                }
            }
        }
        for (back, sum) in sums.into_iter().enumerate().filter(|it| chosen[it.0]) {
            directions[back] = self.turn(back, sum);
        }
    }

    /// Returns for each back vertex true if a moved face there is turned over.
    fn folded(&self, moved: &[Point3<f64>]) -> Vec<bool> {
        let mut folded = vec![false; self.first.len()];
        for triangle in &self.triangles {
            let [now, before] = [
                triangle.map(|back| moved[back as usize]),
                triangle.map(|back| self.position(back as usize)),
            ]
            .map(|[a, b, c]| (b - a).cross(&(c - a)));
            if now.dot(&before) <= 0.01 * before.norm_squared() {
                triangle.iter().for_each(|&back| folded[back as usize] = true);
            }
        }
        folded
    }

    /// Reduces the heights of the given back vertices, and of those beside them that would be much higher.
    pub(super) fn retreat(&self, heights: &mut [f64], mut is_tight: Vec<bool>) {
        for (height, _) in heights.iter_mut().zip(&is_tight).filter(|it| *it.1) {
            *height *= RETREAT;
        }
        loop {
            let mut changes = false;
            for side in &self.sides {
                let [a, b] = side.backs.map(|back| back as usize);
                for [high, low] in [[a, b], [b, a]] {
                    let most =
                        heights[low] + STEEPEST * (self.position(high) - self.position(low)).norm();
                    if is_tight[low] && most < heights[high] * (1.0 - 1e-9) {
                        (heights[high], is_tight[high]) = (most, true);
                        changes = true;
                    }
                }
            }
            if !changes {
                return;
            }
        }
    }
}

/// Increases the heights of back vertices that are too close to the surface, or, if `vertices_only` is false, that belong to a moved face
/// of which a point is too close. Returns true if there are any.
fn raise(
    probes: &mut Probes<'_>,
    motion: &mut Motion,
    thickness: f64,
    vertices_only: bool,
) -> bool {
    let lack = |probe: &Probe| match probe.distance < thickness && FREE < probe.cosine {
        true => (AIM * thickness - probe.distance) / probe.cosine.max(0.5),
        false => 0.0,
    };
    let lacks = probes.lacks(motion, lack, vertices_only);
    for (height, lack) in motion.heights.iter_mut().zip(&lacks) {
        *height = (*height + lack).min(MAX_HEIGHT * thickness);
    }
    lacks.iter().any(|lack| 0.0 < *lack)
}
