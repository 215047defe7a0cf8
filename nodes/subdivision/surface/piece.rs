//! A face with its neighborhood as a small mesh, which is refined by the general rules. Borders and creases are supported.
//!
//! If each corner of the face is regular, or on a regular part of a border or crease, the surface over the face is a B-spline or box spline
//! patch. Control points beyond a border are then obtained by mirroring.

use maquette_base::linear::stencils::Stencils;
use maquette_value::Faces;
use nalgebra::{Point3, Vector3};

use super::limit_point::LimitPoint;
use super::patches::{Jet, Quartic, bicubic};
use crate::masks::catmull_clark::CatmullClarkMasks;
use crate::masks::loop_masks::LoopMasks;
use crate::masks::sharpness::{Class, Edges, Sharpness};
use crate::masks::vertex_rings::{Masks, RingMasks, Scratch};
use crate::refine::connectivity::Connectivity;
use crate::refine::half_edges::{HalfEdges, Ring};
use crate::refine::level::Level;
use crate::refine::primal::Primal;
use crate::rules::Rules;
use crate::scheme::PrimalScheme;

/// A face with its neighboring faces, as a small mesh.
pub(crate) struct Piece {
    mesh: Connectivity,
    creases: Vec<(u32, f64)>,
    points: Vec<Point3<f64>>,
    face: u32,
}

impl Piece {
    /// Extracts a face of a larger mesh with its neighboring faces.
    pub(crate) fn from_face(
        whole: &Connectivity,
        creases: &[(u32, f64)],
        points: &[Point3<f64>],
        face: u32,
    ) -> Self {
        let mut ring = Ring::default();
        let mut faces: Vec<u32> = Vec::new();
        for half in whole.halves_around(face) {
            whole.ring(whole.clockwise_most(half), &mut ring);
            faces.extend(ring.halves.iter().map(|&half| whole.face_of(half)));
        }
        faces.sort_unstable();
        faces.dedup();
        let halves: Vec<u32> = faces.iter().flat_map(|&face| whole.halves_around(face)).collect();
        let mut vertices: Vec<u32> =
            halves.iter().map(|&half| whole.corners()[half as usize]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let sides = whole.faces.sides().expect("one step makes all faces alike");
        let faces_here = Faces::uniform(
            sides,
            halves
                .iter()
                .map(|half| {
                    let vertex = whole.corners()[*half as usize];
                    vertices.partition_point(|&other| other < vertex) as u32
                })
                .collect::<Vec<_>>(),
        );
        let mesh = Connectivity::new_unchecked(
            &faces_here.expect("as many corners as counted"),
            vertices.len(),
        );
        let mut creases_here: Vec<(u32, f64)> = Vec::new();
        for (half, &edge) in halves.iter().zip(&mesh.edge_of) {
            let old = whole.edge_of[*half as usize];
            if let Ok(index) = creases.binary_search_by_key(&old, |crease| crease.0) {
                creases_here.push((edge, creases[index].1));
            }
        }
        creases_here.sort_unstable_by_key(|crease| crease.0);
        creases_here.dedup_by_key(|crease| crease.0);
        let points = vertices.iter().map(|&vertex| points[vertex as usize]).collect();
        let face = faces.partition_point(|&other| other < face) as u32;
        Self { mesh, creases: creases_here, points, face }
    }

    /// Refines the piece by one step. Returns the neighborhood of the refined face with the index `part`.
    pub(crate) fn refine(self, rules: Rules<PrimalScheme>, part: usize) -> Self {
        let level = Level::piece(rules, self.mesh, self.creases);
        let first = level.mesh.faces.first_corner(self.face as usize);
        let face = match rules.scheme {
            PrimalScheme::Loop => 4 * self.face as usize + part,
            PrimalScheme::CatmullClark => first + part,
        };
        let step = Primal::new(level.into());
        let points = step.positions(&self.points);
        let finer = step.next();
        Self::from_face(&finer.mesh, &finer.creases, &points, face as u32)
    }

    /// Evaluates the surface at a position of the face; `None` if the face is not regular.
    pub(crate) fn regular(&self, rules: Rules<PrimalScheme>, [u, v]: [f64; 2]) -> Option<Jet> {
        let sharpness = Sharpness::new(&self.mesh, rules, &self.creases);
        match rules.scheme {
            PrimalScheme::Loop => {
                let [h, i, j] = std::array::from_fn(|k| 3 * self.face + k as u32);
                let rings = [
                    self.triangles_around(&sharpness, h)?,
                    self.triangles_around(&sharpness, i)?,
                    self.triangles_around(&sharpness, j)?,
                ];
                Some(
                    Quartic::new(&[h, i, j].map(|half| self.tip_coordinates(half)), &rings)
                        .jet(u, v),
                )
            }
            PrimalScheme::CatmullClark => {
                let halves: [u32; 4] = std::array::from_fn(|k| 4 * self.face + k as u32);
                halves.iter().all(|&half| self.is_regular_corner(&sharpness, half)).then(|| {
                    let net = self.net(&sharpness, halves);
                    bicubic(|[i, j]| net[i][j], u, v)
                })
            }
        }
    }

    fn tip_coordinates(&self, half: u32) -> Vector3<f64> {
        self.points[self.mesh.corners()[half as usize] as usize].coords
    }

    /// Returns four things: the ring around the vertex where a half-edge of the face starts, the sharpness of the ring's edges, the class
    /// of the vertex, and the index of the half-edge in the ring.
    fn collect_ring(
        &self,
        sharpness: &Sharpness<'_, Connectivity>,
        half: u32,
    ) -> (Ring, Edges, Class, usize) {
        let (mut ring, mut edges) = (Ring::default(), Edges::default());
        self.mesh.ring(self.mesh.clockwise_most(half), &mut ring);
        sharpness.collect_around(self.mesh.corners()[half as usize], &ring, &mut edges);
        let class = sharpness.class(&ring, &edges.before);
        let index = ring.halves.iter().position(|&other| other == half).unwrap_or_default();
        (ring, edges, class, index)
    }

    /// Returns true if the quad's corner at a half-edge is regular. A regular corner is a smooth vertex with four quads, a vertex on a
    /// permanent crease with two quads on this side, or a corner at which both edges of the quad are sharp.
    fn is_regular_corner(&self, sharpness: &Sharpness<'_, Connectivity>, half: u32) -> bool {
        let (ring, edges, class, index) = self.collect_ring(sharpness, half);
        let n = ring.edges.len();
        let softens = edges.before.iter().any(|&s| s > 0.0 && s < PERMANENT);
        fn is_sharp(index: usize, n: usize, edges_before: &[f64]) -> bool {
            edges_before[index % n] > 0.0
        }
        match class {
            Class::Smooth => n == 4 && !edges.before.iter().any(|&s| s > 0.0),
            Class::Crease(first, second) => {
                let inside = (first..second).contains(&index);
                let q = if inside { second - first } else { n - (second - first) };
                q == 2 && !softens
            }
            Class::Corner => {
                is_sharp(index, n, &edges.before)
                    && is_sharp(index + 1, n, &edges.before)
                    && !softens
            }
        }
    }

    /// Returns the 4 by 4 control points of the bicubic B-spline patch over the quad whose sides are `halves`.
    fn net(
        &self,
        sharpness: &Sharpness<'_, Connectivity>,
        halves: [u32; 4],
    ) -> [[Vector3<f64>; 4]; 4] {
        let mesh = &self.mesh;
        let mut net = [[Vector3::zeros(); 4]; 4];
        // For each corner k of the quad: its index in the net, the step of the index along the next side, and the step outwards across this
        // side.
        let sides: [([i32; 2], [i32; 2], [i32; 2]); 4] = [
            ([1, 1], [1, 0], [0, -1]),
            ([2, 1], [0, 1], [1, 0]),
            ([2, 2], [-1, 0], [0, 1]),
            ([1, 2], [0, -1], [-1, 0]),
        ];
        let is_sharp =
            halves.map(|half| sharpness.edge_sharpness(mesh.edge_of[half as usize]) > 0.0);
        for (&half, (corner, _, _)) in halves.iter().zip(sides) {
            *get(&mut net, corner) = self.tip_coordinates(half);
        }
        for (k, (corner, along, out)) in sides.into_iter().enumerate() {
            let ends = [corner, add(corner, along)];
            if is_sharp[k] {
                for end in ends {
                    let inner = add(end, [-out[0], -out[1]]);
                    *get(&mut net, add(end, out)) =
                        *get(&mut net, end) * 2.0 - *get(&mut net, inner);
                }
            } else {
                let next = mesh.next(mesh.twin(halves[k]));
                *get(&mut net, add(ends[0], out)) = self.tip_coordinates(mesh.next(next));
                *get(&mut net, add(ends[1], out)) =
                    self.tip_coordinates(mesh.next(mesh.next(next)));
            }
        }
        for (k, (corner, along, out)) in sides.into_iter().enumerate() {
            let far = add(add(corner, out), [-along[0], -along[1]]);
            let before = (k + 3) % 4;
            *get(&mut net, far) = if is_sharp[k] {
                let [on, inner] = [0, 1].map(|s| add(far, [-out[0] * (1 + s), -out[1] * (1 + s)]));
                *get(&mut net, on) * 2.0 - *get(&mut net, inner)
            } else if is_sharp[before] {
                let [on, inner] =
                    [0, 1].map(|s| add(far, [along[0] * (1 + s), along[1] * (1 + s)]));
                *get(&mut net, on) * 2.0 - *get(&mut net, inner)
            } else {
                let beyond = mesh.twin(mesh.next(mesh.twin(halves[k])));
                self.tip_coordinates(mesh.previous(beyond))
            };
        }
        net
    }

    /// Returns the six neighbors of the triangle's corner at which a half-edge starts, beginning with the other end of the half-edge.
    /// Neighbors beyond a crease are mirrored. Returns `None` if the corner is not regular.
    fn triangles_around(
        &self,
        sharpness: &Sharpness<'_, Connectivity>,
        half: u32,
    ) -> Option<[Vector3<f64>; 6]> {
        let (ring, edges, class, index) = self.collect_ring(sharpness, half);
        let n = ring.edges.len();
        fn evaluate(
            index: usize,
            n: usize,
            ring_neighbors: &[u32],
            points: &[Point3<f64>],
        ) -> Vector3<f64> {
            points[ring_neighbors[index % n] as usize].coords
        }
        if edges.before.iter().any(|&s| s > 0.0 && s < PERMANENT) {
            return None;
        }
        match class {
            Class::Smooth if n == 6 && edges.before.iter().all(|&s| s == 0.0) => {
                Some(std::array::from_fn(|k| evaluate(index + k, n, &ring.neighbors, &self.points)))
            }
            Class::Crease(first, second) => {
                let inside = (first..second).contains(&index);
                let (start, q) =
                    if inside { (first, second - first) } else { (second, n - (second - first)) };
                if q != 3 {
                    return None;
                }
                let own = self.tip_coordinates(half);
                let side: [Vector3<f64>; 4] =
                    std::array::from_fn(|k| evaluate(start + k, n, &ring.neighbors, &self.points));
                let mirrored = [own + side[3] - side[2], own + side[0] - side[1]];
                let around: [Vector3<f64>; 6] =
                    std::array::from_fn(|k| if k < 4 { side[k] } else { mirrored[k - 4] });
                let turn = (index + n - start) % n;
                Some(std::array::from_fn(|k| around[(turn + k) % 6]))
            }
            _ => None,
        }
    }

    /// Evaluates the limit point at a corner of the face, and the tangents there. If creases meet at the corner, the tangents are those on
    /// the side of this face.
    pub(crate) fn corner(&self, rules: Rules<PrimalScheme>, corner: usize) -> LimitPoint {
        match rules.scheme {
            PrimalScheme::Loop => self.apply_masks(rules, corner, LoopMasks),
            PrimalScheme::CatmullClark => self.apply_masks(rules, corner, CatmullClarkMasks),
        }
    }

    fn apply_masks(
        &self,
        rules: Rules<PrimalScheme>,
        corner: usize,
        masks: impl Masks,
    ) -> LimitPoint {
        let sharpness = Sharpness::new(&self.mesh, rules, &self.creases);
        let half = self.mesh.faces.first_corner(self.face as usize) as u32 + corner as u32;
        let (_, edges, _, index) = self.collect_ring(&sharpness, half);
        let (vertex, start) = (self.mesh.corners()[half as usize], self.mesh.clockwise_most(half));
        let stars =
            RingMasks { mesh: &self.mesh, sharpness: &sharpness, rules: rules.of_edges(), masks };
        let (rows, _) = Stencils::build(1, |scratch: &mut Scratch, _, rows| {
            stars.limit(scratch, vertex, start, rows);
            rows.end();
            stars.tangents(scratch, vertex, start, rows);
        });
        fn apply_row(row: usize, rows: &Stencils, points: &[Point3<f64>]) -> Vector3<f64> {
            rows.point(row.min(rows.len() - 1), |column| points[column as usize]).coords
        }
        // Each side of the vertex begins at a sharp edge; edges before the first sharp edge belong to the last side.
        let sides = (rows.len() - 1) / 2;
        let before = edges.before[..=index].iter().filter(|&&s| s > 0.0).count();
        let side = (before + sides).saturating_sub(1) % sides.max(1);
        LimitPoint {
            point: apply_row(0, &rows, &self.points).into(),
            first: [
                apply_row(1 + 2 * side, &rows, &self.points),
                apply_row(2 + 2 * side, &rows, &self.points),
            ],
            second: None,
        }
    }
}

/// Edges with at least this sharpness are permanently sharp.
const PERMANENT: f64 = 10.0;

fn add(a: [i32; 2], b: [i32; 2]) -> [i32; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

fn get(net: &mut [[Vector3<f64>; 4]; 4], at: [i32; 2]) -> &mut Vector3<f64> {
    &mut net[at[0] as usize][at[1] as usize]
}
