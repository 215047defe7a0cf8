//! A layer of material behind a surface, with the faces of the surface.
//!
//! Each vertex of the surface is moved backwards along a direction of its own until the moved faces are far enough from the whole surface.
//! Where the moved faces would fold, the directions are smoothed; where there is no room, the vertices move less. So a layer never
//! intersects itself, but may be thinner than requested: the caller adds material there.

use maquette_base::topology::lists::Lists;
use maquette_base::topology::union_find::UnionFind;
use maquette_node::{CancelledError, Error, Progress, bail};
use maquette_value::parallel::*;
use maquette_value::{Mesh, TriangleTree};
use nalgebra::{Point3, Vector3, center};

use crate::extended::ExtendedMesh;

/// Requested height of a layer, as a multiple of its thickness: the room for rounding errors and small chords.
const AIM: f64 = 1.01;

/// Maximum height of a layer at a vertex, as a multiple of the thickness. At a sharp edge the height is greater than the thickness.
const MAX_HEIGHT: f64 = 2.5;

/// Minimum cosine of the angle between the direction of a vertex and the normal of each of its faces, where one exists.
const MIN_COSINE: f64 = 0.2;

/// Minimum cosine of the angle between the directions at both ends of an edge of a smooth surface.
const SMOOTH: f64 = 0.8;

/// Minimum cosine of the angle between a moved point's direction and the way from its nearest point of the surface. At smaller cosines the
/// point is as near to another part of the surface: it does not gain distance by moving on.
const FREE: f64 = 0.3;

/// Minimum cosine of the angle between the direction of a vertex and the normals of its faces, at which the vertex is not on a sharp edge.
const BLUNT: f64 = 0.9;

/// Weight of the way to the middles of the faces in the directions of fans that share a vertex: large, so that fans at right angles
/// part.
const INWARDS: f64 = 3.0;

/// Factor by which the height at a vertex is reduced in each round in which there is no room.
const RETREAT: f64 = 0.6;

/// Maximum difference of the heights at the ends of an edge, as a multiple of its length, beside vertices without room.
const STEEPEST: f64 = 1.5;

/// Maximum numbers of rounds: of smoothing directions, of raising heights, and of reducing them with and without the test for
/// self-intersections.
const SMOOTHINGS: usize = 10;
const RAISES: usize = 6;
const RETREATS: usize = 8;
const SETTLINGS: usize = 60;

/// The vertices of a surface, separated where faces meet in a vertex without a common edge: one back vertex for each fan of faces.
pub(super) struct Backs<'a> {
    mesh: &'a Mesh,
    /// The back vertex of each corner.
    of_corner: Vec<u32>,
    /// The first corner of each back vertex.
    first: Vec<u32>,
    sides: Vec<Side>,
    /// The indices of the sides at borders.
    borders: Vec<u32>,
    /// For each back vertex, the faces around it.
    faces: Lists,
    /// The unit normals of the faces; reversed for motions to the front.
    normals: Vec<Vector3<f64>>,
    /// The triangles of all faces, by back vertices.
    triangles: Vec<[u32; 3]>,
}

/// A side of a face.
struct Side {
    face: u32,
    corners: [u32; 2],
    backs: [u32; 2],
    is_border: bool,
}

/// The distance of a point of a moved face from the surface.
#[derive(Clone, Copy)]
struct Probe {
    distance: f64,
    /// The cosine of the angle between the point's direction and the way from its nearest point of the surface.
    cosine: f64,
}

/// The motion of each back vertex: a unit direction and a height in mm, and a shift along the surface.
#[derive(Clone)]
pub(super) struct Motion {
    pub(super) directions: Vec<Vector3<f64>>,
    pub(super) heights: Vec<f64>,
    pub(super) shifts: Vec<Vector3<f64>>,
}

impl<'a> Backs<'a> {
    /// `sign` is 1 for motions backwards, and -1 for motions to the front.
    pub(super) fn new(mesh: &'a Mesh, sign: f64) -> Self {
        let (faces, edges) = (mesh.faces(), mesh.edges());
        let mut fans = UnionFind::new(faces.corners().len());
        let mut older: Vec<Option<[u32; 2]>> = vec![None; edges.vertices.len()];
        let mut sides = Vec::with_capacity(faces.corners().len());
        for face in 0..faces.len() {
            let (first, count) = (faces.first_corner(face), faces.face(face).len());
            for k in 0..count {
                let corners = [first + k, first + (k + 1) % count].map(|it| it as u32);
                let edge = edges.of_corner[first + k] as usize;
                if let Some([from, to]) = older[edge].replace(corners) {
                    fans.union(corners[0], to);
                    fans.union(corners[1], from);
                }
                let is_border = edges.faces[edge] == 1;
                sides.push(Side { face: face as u32, corners, backs: [0; 2], is_border });
            }
        }
        let (of_corner, first) = fans.into_labels();
        for side in &mut sides {
            side.backs = side.corners.map(|corner| of_corner[corner as usize]);
        }
        let normals = (0..faces.len()).into_par_iter().map(|face: usize| {
            sign * mesh.area_vector(faces.face(face)).try_normalize(0.0).unwrap_or_default()
        });
        let around =
            Lists::group(first.len(), || sides.iter().map(|side| (side.backs[0], side.face)));
        let triangles = mesh.triangle_corners().into_iter();
        let triangles = triangles.map(|it| it.map(|corner| of_corner[corner as usize])).collect();
        let borders = (0..sides.len() as u32).filter(|&side| sides[side as usize].is_border);
        Self {
            mesh,
            first,
            borders: borders.collect(),
            sides,
            faces: around,
            normals: normals.collect(),
            triangles,
            of_corner,
        }
    }

    fn vertex(&self, back: usize) -> u32 {
        self.mesh.faces().corners()[self.first[back] as usize]
    }

    fn position(&self, back: usize) -> Point3<f64> {
        self.mesh.positions()[self.vertex(back) as usize]
    }

    fn moved(&self, motion: &Motion) -> Vec<Point3<f64>> {
        (0..self.first.len())
            .map(|back| {
                let along = motion.directions[back] * motion.heights[back];
                self.position(back) + along + motion.shifts[back]
            })
            .collect()
    }

    /// Returns for each back vertex at a border the shift by `distance` mm out of the surface, but by at most a third of the shorter edge
    /// of the border.
    pub(super) fn shifts(&self, distance: f64) -> Vec<Vector3<f64>> {
        let mut shifts = vec![Vector3::zeros(); self.first.len()];
        let mut shortest = vec![f64::INFINITY; self.first.len()];
        for side in self.borders.iter().map(|&side| &self.sides[side as usize]) {
            let [a, b] = side.backs.map(|back| back as usize);
            let edge = self.position(b) - self.position(a);
            let out = edge.cross(&self.normals[side.face as usize]).try_normalize(0.0);
            for back in [a, b] {
                shifts[back] += out.unwrap_or_default();
                shortest[back] = shortest[back].min(edge.norm());
            }
        }
        for (shift, shortest) in shifts.iter_mut().zip(shortest) {
            let unit = shift.try_normalize(0.0).unwrap_or_default();
            *shift = unit * distance.min(shortest / 3.0);
        }
        shifts
    }

    /// Returns the motion that makes the layer behind the surface as thick as possible, at most `thickness` mm. `tree` is the tree of the
    /// surface.
    pub(super) fn fit(
        &self,
        tree: &TriangleTree,
        thickness: f64,
        progress: &Progress<'_>,
    ) -> Result<Motion, CancelledError> {
        let heights = Vec::new();
        let shifts = vec![Vector3::zeros(); self.first.len()];
        let mut motion = Motion { directions: self.directions(), heights, shifts };
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
        for round in 0..RAISES {
            progress.check()?;
            if !self.raise(tree, &mut motion, thickness, round < RAISES / 2) && RAISES / 2 <= round
            {
                break;
            }
        }
        for _ in 0..RETREATS {
            progress.check()?;
            let probes = self.probe_backs(tree, &motion);
            let mut is_tight = self.folded(&self.moved(&motion));
            for (is_tight, probe) in is_tight.iter_mut().zip(&probes) {
                *is_tight |= probe.distance < 0.99 * thickness && probe.cosine <= FREE;
            }
            if !is_tight.contains(&true) {
                break;
            }
            self.retreat(&mut motion.heights, is_tight);
        }
        Ok(motion)
    }

    /// Increases the heights of back vertices that are too close to the surface, or, if `vertices_only` is false, that belong to a moved face
    /// of which a point is too close. Returns true if there are any.
    fn raise(
        &self,
        tree: &TriangleTree,
        motion: &mut Motion,
        thickness: f64,
        vertices_only: bool,
    ) -> bool {
        let lack = |probe: &Probe| match probe.distance < thickness && FREE < probe.cosine {
            true => (AIM * thickness - probe.distance) / probe.cosine.max(0.5),
            false => 0.0,
        };
        let lacks = match vertices_only {
            true => self.probe_backs(tree, motion).iter().map(lack).collect(),
            false => {
                let (of_backs, of_triangles) = self.probe(tree, motion);
                let mut lacks: Vec<f64> = of_backs.iter().map(lack).collect();
                for (triangle, probes) in self.triangles.iter().zip(of_triangles.chunks(PROBES)) {
                    let most = probes.iter().map(lack).fold(0.0, f64::max);
                    for &back in triangle {
                        lacks[back as usize] = most.max(lacks[back as usize]);
                    }
                }
                lacks
            }
        };
        for (height, lack) in motion.heights.iter_mut().zip(&lacks) {
            *height = (*height + lack).min(MAX_HEIGHT * thickness);
        }
        lacks.iter().any(|lack| 0.0 < *lack)
    }

    /// Returns the motion by `height` mm along the rays of the sensor of a capture, or else against the mean direction of the faces. A surface that is
    /// seen whole from there does not fold, however rough it is.
    pub(super) fn away(&self, height: f64) -> Motion {
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

    /// Extrapolates the directions at borders. All faces of a border vertex are on one side of it, so that the mean of their normals is that
    /// at a place half an edge away: the direction at the border is as far from this mean as the mean is from the directions one edge away.
    /// Walls that would lean inwards stay perpendicular to the faces, so that the layer is thick enough behind all of them.
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
    fn retreat(&self, heights: &mut [f64], mut is_tight: Vec<bool>) {
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

    fn probe_backs(&self, tree: &TriangleTree, motion: &Motion) -> Vec<Probe> {
        self.probe_points(tree, &self.moved(motion), |k| motion.directions[k])
    }

    /// Measures the distance of the moved faces from the surface: at each back vertex, and at [`PROBES`] points of each triangle.
    fn probe(&self, tree: &TriangleTree, motion: &Motion) -> (Vec<Probe>, Vec<Probe>) {
        let moved = self.moved(motion);
        let points = self.triangles.iter().flat_map(|triangle| {
            let [a, b, c] = triangle.map(|back| moved[back as usize]);
            let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            [center(&a, &b), center(&b, &c), center(&c, &a), middle]
        });
        let of_triangles = self.probe_points(tree, &points.collect::<Vec<_>>(), |k| {
            let triangle = self.triangles[k / PROBES];
            let sum: Vector3<f64> =
                triangle.iter().map(|&back| motion.directions[back as usize]).sum();
            sum.try_normalize(0.0).unwrap_or_default()
        });
        (self.probe_backs(tree, motion), of_triangles)
    }

    fn probe_points(
        &self,
        tree: &TriangleTree,
        points: &[Point3<f64>],
        direction: impl Fn(usize) -> Vector3<f64>,
    ) -> Vec<Probe> {
        let nearest = tree.nearest_to_all(points).into_iter().zip(points).enumerate();
        nearest
            .map(|(k, (nearest, at))| {
                let way = nearest.map_or(Vector3::zeros(), |it| at - it.position(self.mesh));
                let distance = way.norm();
                let cosine = way.try_normalize(0.0).unwrap_or_default().dot(&direction(k));
                Probe { distance, cosine }
            })
            .collect()
    }

    /// Returns the faces behind which a layer is thinner than `thickness` mm: the moved face is too near, or a ray straight inwards from the
    /// face leaves the layer too early. Rays that leave it by a wall at a border do not count.
    pub(super) fn thin_faces(
        &self,
        tree: &TriangleTree,
        motion: &Motion,
        layer: &Mesh,
        thickness: f64,
    ) -> Vec<u32> {
        let mut is_thin = vec![false; self.mesh.faces().len()];
        let (of_backs, of_triangles) = self.probe(tree, motion);
        let of_layer = TriangleTree::new(layer);
        let face_of_triangle = (0..self.mesh.faces().len())
            .flat_map(|face| std::iter::repeat_n(face, self.mesh.faces().face(face).len() - 2));
        let triangles =
            self.triangles.iter().zip(of_triangles.chunks(PROBES)).zip(face_of_triangle);
        let triangles: Vec<_> = triangles.collect();
        let thin: Vec<bool> = triangles
            .par_iter()
            .map(|((triangle, probes), face)| {
                let corners = triangle.iter().map(|&back| &of_backs[back as usize]);
                corners.chain(*probes).any(|probe| probe.distance < thickness)
                    || self.is_thin_behind(&of_layer, **triangle, *face, thickness)
            })
            .collect();
        for (&(_, face), thin) in triangles.iter().zip(thin) {
            is_thin[face] |= thin;
        }
        (0..is_thin.len() as u32).filter(|&face| is_thin[face as usize]).collect()
    }

    /// Returns true if a ray from the triangle straight inwards leaves the layer before `thickness`.
    fn is_thin_behind(
        &self,
        layer: &TriangleTree,
        triangle: [u32; 3],
        face: usize,
        thickness: f64,
    ) -> bool {
        let corners = triangle.map(|back| self.position(back as usize));
        let middle = Point3::from(corners.iter().map(|at| at.coords).sum::<Vector3<f64>>() / 3.0);
        let inward = -self.normals[face];
        let starts = [middle].into_iter().chain(corners.map(|at| center(&at, &middle)));
        let first_wall = 2 * self.mesh.faces().len() as u32;
        starts.into_iter().any(|start| {
            let hit = layer.first_hit(start + inward * (1e-6 * thickness), inward);
            hit.is_some_and(|hit| hit.face < first_wall && hit.along < thickness * (1.0 - 1e-5))
        })
    }

    /// Returns the closed layer between the surface, or its motion by `front`, and its motion by `back`. Heights are reduced until the layer
    /// does not intersect itself.
    ///
    /// # Errors
    /// Returns an error if the surface intersects itself, or folds over itself at a vertex.
    pub(super) fn settle(
        &self,
        front: &mut Option<Motion>,
        back: &mut Motion,
        progress: &Progress<'_>,
    ) -> Result<Mesh, Error> {
        for round in 0..SETTLINGS {
            progress.tick(round as f64 / SETTLINGS as f64)?;
            let layer = self.layer(front.as_ref(), back)?;
            let crossing = layer.crossings(|| progress.check())?;
            if crossing.is_empty() {
                return Ok(layer);
            }
            let faces = self.mesh.faces().len() as u32;
            let mut is_tight = [vec![false; self.first.len()], vec![false; self.first.len()]];
            for [a, b] in crossing {
                // The first faces of the layer are those of the surface, which do not move.
                if front.is_none() && b < faces || round + 1 == SETTLINGS {
                    let at = layer.first_triangle_center(layer.faces().face(a as usize));
                    bail!(
                        "the surface intersects itself or folds over itself near ({:.3}, {:.3}, {:.3}); use `Smooth` there, or `Reconstruct` to make one surface of it",
                        at.x,
                        at.y,
                        at.z
                    );
                }
                for face in [a, b] {
                    let (of_front, of_back) = self.backs_of(face);
                    of_front.iter().for_each(|&back| is_tight[0][back as usize] = true);
                    of_back.iter().for_each(|&back| is_tight[1][back as usize] = true);
                }
            }
            let [of_front, of_back] = is_tight;
            if let Some(front) = front {
                self.retreat(&mut front.heights, of_front);
            }
            self.retreat(&mut back.heights, of_back);
        }
        unreachable!("the last round returns")
    }

    /// Returns the back vertices of the front and of the back of a face of a layer.
    fn backs_of(&self, face: u32) -> (Vec<u32>, Vec<u32>) {
        let count = self.mesh.faces().len();
        fn backs(face: usize, of_corner: &[u32], mesh: &Mesh) -> Vec<u32> {
            let first = mesh.faces().first_corner(face);
            of_corner[first..first + mesh.faces().face(face).len()].to_vec()
        }
        match face as usize {
            face if face < count => (backs(face, &self.of_corner, self.mesh), Vec::new()),
            face if face < 2 * count => {
                (Vec::new(), backs(face - count, &self.of_corner, self.mesh))
            }
            face => {
                let side = self.borders[(face - 2 * count) / 2];
                let backs = self.sides[side as usize].backs.to_vec();
                (backs.clone(), backs)
            }
        }
    }

    /// Returns the layer: its front, its back, and two triangles for each side of a border.
    fn layer(&self, front: Option<&Motion>, back: &Motion) -> Result<Mesh, Error> {
        let mesh = self.mesh;
        let faces = mesh.faces();
        let mut layer = match front {
            None => ExtendedMesh::new(mesh),
            Some(_) => ExtendedMesh::without_elements(mesh),
        };
        let front: Vec<u32> = match front {
            None => (0..self.first.len()).map(|back| self.vertex(back)).collect(),
            Some(front) => {
                let moved = self.moved(front).into_iter().enumerate();
                moved.map(|(back, at)| layer.add_vertex(at, self.vertex(back))).collect()
            }
        };
        let back: Vec<u32> = {
            let moved = self.moved(back).into_iter().enumerate();
            moved.map(|(back, at)| layer.add_vertex(at, self.vertex(back))).collect()
        };
        fn corners(face: usize, faces: &maquette_value::Faces) -> std::ops::Range<u32> {
            let first = faces.first_corner(face);
            first as u32..(first + faces.face(face).len()) as u32
        }
        let place =
            |of: &[u32], corner: u32| [of[self.of_corner[corner as usize] as usize], corner];
        if !layer.has_faces() {
            for face in 0..faces.len() {
                layer.add_face(
                    corners(face, faces).map(|corner| place(&front, corner)),
                    face as u32,
                );
            }
        }
        for face in 0..faces.len() {
            layer.add_face(
                corners(face, faces).rev().map(|corner| place(&back, corner)),
                face as u32,
            );
        }
        for side in self.borders.iter().map(|&side| &self.sides[side as usize]) {
            let [a, b] = side.corners;
            let wall = [place(&front, b), place(&front, a), place(&back, a), place(&back, b)];
            layer.add_face([0, 1, 2].map(|k: usize| wall[k]), side.face);
            layer.add_face([0, 2, 3].map(|k: usize| wall[k]), side.face);
        }
        Ok(layer.mesh()?)
    }
}

/// Number of points inside of a triangle at which its distance from the surface is measured.
const PROBES: usize = 4;
