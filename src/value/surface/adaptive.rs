//! Adaptive tessellation: the mesh is fine only where the surface is curved.
//!
//! The cells of a quadtree over each span are divided until their chords are within a tolerance of the surface. Then they are divided until
//! neighbors differ by at most one level, which makes the quadtree restricted: von Herzen and Barr, "Accurate triangulations of deformed,
//! intersecting surfaces" (1987). A cell next to smaller ones becomes a fan of triangles that includes all vertices of the smaller cells on
//! its border, so that no vertex is on the edge of another face.

use nalgebra::{Point3, Unit, Vector3};

use super::super::{Faces, Mesh, MeshError};
use super::joints::{Joints, MIN_AROUND, OpenMesh};
use super::tessellate::{distance, divide_spans, to_unit};
use super::{ParameterDirection, Surface};
use crate::parallel::*;
use crate::union_find::UnionFind;

/// The maximum number of times that a span is halved, which gives 1024 x 1024 cells. With a tolerance near rounding the division would
/// never end.
const MAX_DEPTH: u32 = 10;

/// The side of a span in units of the smallest cell.
const SPAN: u32 = 1 << MAX_DEPTH;

/// The maximum number of cells. It gives a mesh of about 130 MB and takes a second or two, which is more than any use of a mesh needs.
const MAX_CELLS: usize = 1 << 20;

/// The number of samples along each side of a cell. A single sample in the middle would miss a curve that bends both ways.
const SAMPLES: usize = 5;

/// The index of the last sample along a side.
const LAST: usize = SAMPLES - 1;

impl Surface {
    /// A mesh whose edges and quad diagonals are within `tolerance` (mm) of the surface. It consists of quads, and of triangles where small
    /// quads meet large ones. It has the attributes, the joints and the orientation of [`tessellate`](Self::tessellate).
    ///
    /// The distance is measured at a few samples of each cell, and no span is divided into more than 1024 x 1024 cells.
    ///
    /// # Errors
    /// If there are more cells than allowed, or a point is not finite because the net's numbers are too large.
    pub fn tessellate_within(&self, tolerance: f64) -> Result<Mesh, MeshError> {
        let mut tree = Tree::new(self, MAX_CELLS)?;
        tree.divide_for_joints()?;
        tree.refine(tolerance)?;
        tree.balance()?;
        tree.mesh()
    }
}

/// A quadtree of cells in the domain of a surface. The positions of cells are in units of the smallest cell.
struct Tree<'a> {
    surface: &'a Surface,
    /// The parameters at the ends of the spans along u. `vs` has those along v.
    us: Vec<f64>,
    vs: Vec<f64>,
    /// The cells: first the spans, row by row, then the quarters of divided cells, four at a time.
    cells: Vec<Cell>,
    leaves: usize,
    /// The maximum number of undivided cells.
    max_leaves: usize,
    joints: Joints<'a>,
    /// For each of `us`, true if the surface has only one point there; `is_pole_v` says so for each of `vs`.
    is_pole_u: Vec<bool>,
    is_pole_v: Vec<bool>,
}

#[derive(Clone, Copy)]
struct Cell {
    x: u32,
    y: u32,
    side: u32,
    /// The index of the cell's first quarter if the cell is divided, otherwise 0.
    quarters: u32,
}

impl<'a> Tree<'a> {
    fn new(surface: &'a Surface, max_leaves: usize) -> Result<Self, MeshError> {
        let (us, vs) = (divide_spans(&surface.u, 1), divide_spans(&surface.v, 1));
        let (rows, columns) = (us.len() - 1, vs.len() - 1);
        // The positions of cells must fit in 32 bits in both directions.
        if (u32::MAX / SPAN) as usize <= rows.max(columns) {
            return Err(MeshError::TooLarge { what: "spans", count: rows.max(columns) });
        }
        let cells: Vec<Cell> = (0..rows * columns)
            .map(|k| [(k / columns) as u32 * SPAN, (k % columns) as u32 * SPAN])
            .map(|[x, y]| Cell { x, y, side: SPAN, quarters: 0 })
            .collect();
        let joints = Joints::new(surface);
        let is_pole_u = us.iter().map(|&u| joints.is_pole(ParameterDirection::U, u)).collect();
        let is_pole_v = vs.iter().map(|&v| joints.is_pole(ParameterDirection::V, v)).collect();
        let leaves = cells.len();
        Ok(Self { surface, us, vs, leaves, max_leaves, cells, joints, is_pole_u, is_pole_v })
    }

    /// Divides all spans until a closed surface has enough cells around, and one with two poles enough cells between them.
    fn divide_for_joints(&mut self) -> Result<(), MeshError> {
        fn needs(is_closed: bool, is_pole: &[bool]) -> usize {
            let has_poles = is_pole.first() == Some(&true) && is_pole.last() == Some(&true);
            if is_closed { MIN_AROUND } else { 1 + usize::from(has_poles) }
        }
        let [rows, columns] = [&self.us, &self.vs].map(|ends| ends.len() - 1);
        let is_few = |parts: usize, this: &Self| {
            rows * parts < needs(this.joints.is_closed_u, &this.is_pole_u)
                || columns * parts < needs(this.joints.is_closed_v, &this.is_pole_v)
        };
        let mut parts = 1;
        while is_few(parts, self) {
            let undivided = (0..self.cells.len()).filter(|&cell| self.cells[cell].quarters == 0);
            for cell in undivided.collect::<Vec<_>>() {
                self.divide(cell)?;
            }
            parts *= 2;
        }
        Ok(())
    }

    /// Divides cells until all of them are flat.
    fn refine(&mut self, tolerance: f64) -> Result<(), MeshError> {
        let mut open: Vec<usize> =
            (0..self.cells.len()).filter(|&cell| self.cells[cell].quarters == 0).collect();
        while !open.is_empty() {
            let bent = open.par_iter().with_min_len(16).filter(|&&cell| {
                let cell = &self.cells[cell];
                // A height or tolerance that is NaN does not count as flat.
                let is_flat = self.height(cell) <= tolerance;
                cell.side > 1 && !is_flat
            });
            let bent: Vec<usize> = bent.copied().collect();
            open = Vec::with_capacity(4 * bent.len());
            for cell in bent {
                let first = self.divide(cell)?;
                open.extend(first..first + 4);
            }
        }
        Ok(())
    }

    /// Divides cells until no two neighbors differ by more than one level.
    fn balance(&mut self) -> Result<(), MeshError> {
        let mut open: Vec<usize> =
            (0..self.cells.len()).filter(|&cell| self.cells[cell].quarters == 0).collect();
        while let Some(index) = open.pop() {
            let cell = self.cells[index];
            if cell.quarters != 0 {
                continue;
            }
            for near in self.neighbors(&cell).into_iter().flatten() {
                if self.cells[near].quarters == 0 && self.cells[near].side > 2 * cell.side {
                    let first = self.divide(near)?;
                    open.extend(first..first + 4);
                    // The cell is checked again later, because the quarters of the neighbor may still be too large.
                    open.push(index);
                }
            }
        }
        Ok(())
    }

    fn divide(&mut self, index: usize) -> Result<usize, MeshError> {
        self.leaves += 3;
        if self.max_leaves < self.leaves {
            return Err(MeshError::TooLarge { what: "faces", count: self.leaves });
        }
        let first = self.cells.len();
        let Cell { x, y, side, .. } = self.cells[index];
        let side = side / 2;
        for [right, down] in [[0, 0], [side, 0], [0, side], [side, side]] {
            self.cells.push(Cell { x: x + right, y: y + down, side, quarters: 0 });
        }
        self.cells[index].quarters = first as u32;
        Ok(first)
    }

    /// The undivided cell that contains the smallest cell at (x, y).
    fn find(&self, x: u32, y: u32) -> usize {
        let mut index = (x / SPAN) as usize * (self.vs.len() - 1) + (y / SPAN) as usize;
        while self.cells[index].quarters != 0 {
            let Cell { x: left, y: top, side, quarters } = self.cells[index];
            let half = side / 2;
            let quarter = u32::from(x - left >= half) + 2 * u32::from(y - top >= half);
            index = (quarters + quarter) as usize;
        }
        index
    }

    /// For each of a cell's four sides, the undivided cell outside of it that touches the start of the side; `None` outside of the domain,
    /// unless the surface is closed there. The sides are counter-clockwise, in the order of [`ring`](Self::ring).
    fn neighbors(&self, cell: &Cell) -> [Option<usize>; 4] {
        let Cell { x, y, side, .. } = *cell;
        let (right, bottom) = (x + side, y + side);
        let [end_x, end_y] = self.ends();
        fn before(at: u32, end: u32, is_closed: bool) -> Option<u32> {
            match at {
                0 => is_closed.then_some(end - 1),
                _ => Some(at - 1),
            }
        }
        fn after(at: u32, end: u32, is_closed: bool) -> Option<u32> {
            match at < end {
                true => Some(at),
                false => is_closed.then_some(0),
            }
        }
        let (closed_x, closed_y) = (self.joints.is_closed_u, self.joints.is_closed_v);
        [
            before(y, end_y, closed_y).map(|y| self.find(x, y)),
            after(right, end_x, closed_x).map(|x| self.find(x, y)),
            after(bottom, end_y, closed_y).map(|y| self.find(x, y)),
            before(x, end_x, closed_x).map(|x| self.find(x, y)),
        ]
    }

    /// The positions of the last row and of the last column.
    fn ends(&self) -> [u32; 2] {
        [&self.us, &self.vs].map(|ends| (ends.len() - 1) as u32 * SPAN)
    }

    /// The vertices around a cell, including those in the middle of the cell's sides.
    fn ring(&self, cell: &Cell) -> Vec<u64> {
        let Cell { x, y, side, .. } = *cell;
        let half = side / 2;
        let corners = [[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
        let middles = [[x + half, y], [x + side, y + half], [x + half, y + side], [x, y + half]];
        let mut ring = Vec::with_capacity(8);
        for (k, near) in self.neighbors(cell).into_iter().enumerate() {
            ring.push(key(corners[k]));
            if near.is_some_and(|near| self.cells[near].side < side) {
                ring.push(key(middles[k]));
            }
        }
        ring
    }

    fn parameters(&self, x: u32, y: u32) -> [f64; 2] {
        fn parameter(ends: &[f64], x: u32) -> f64 {
            let (span, fraction) = ((x / SPAN) as usize, f64::from(x % SPAN) / f64::from(SPAN));
            match ends.get(span + 1) {
                Some(end) => ends[span] + (end - ends[span]) * fraction,
                None => ends[span],
            }
        }
        [parameter(&self.us, x), parameter(&self.vs, y)]
    }

    /// The height of the surface over a cell: the maximum distance of a sample from the chord of its line along u or v, or of a diagonal
    /// from the plane of the quad.
    fn height(&self, cell: &Cell) -> f64 {
        let [u, v] = self.parameters(cell.x, cell.y);
        let [u_end, v_end] = self.parameters(cell.x + cell.side, cell.y + cell.side);
        let mut points = [[Point3::origin(); SAMPLES]; SAMPLES];
        for (i, line) in points.iter_mut().enumerate() {
            for (j, point) in line.iter_mut().enumerate() {
                let at = [
                    u + (u_end - u) * (i as f64 / LAST as f64),
                    v + (v_end - v) * (j as f64 / LAST as f64),
                ];
                *point = self.surface.point(at[0], at[1]);
            }
        }
        let mut height = 0.0f64;
        for (fixed, along) in points.iter().enumerate() {
            height = max_height(along, height);
            height = max_height(&points.map(|line| line[fixed]), height);
        }
        // A diagonal may be curved within the plane of its quad, but not out of that plane.
        let [a, b] = [points[0][0], points[0][LAST]];
        let across = (points[LAST][LAST] - a).cross(&(points[LAST][0] - b));
        if let Some(normal) = across.try_normalize(0.0) {
            for k in 1..LAST {
                let beyond =
                    [normal.dot(&(points[k][k] - a)), normal.dot(&(points[k][LAST - k] - b))];
                height = height.max(beyond[0].abs()).max(beyond[1].abs());
            }
        }
        height
    }

    fn mesh(&self) -> Result<Mesh, MeshError> {
        let leaves = || self.cells.iter().filter(|cell| cell.quarters == 0);
        let rings: Vec<(Vec<Vertex>, Vertex)> = leaves()
            .map(|cell| {
                let center = [cell.x + cell.side / 2, cell.y + cell.side / 2];
                let ring = self.ring(cell).into_iter();
                let ring =
                    ring.map(|place| Vertex { place, is_after: self.is_after_pole(place, cell) });
                (ring.collect(), Vertex { place: key(center), is_after: false })
            })
            .collect();
        let mut vertices: Vec<Vertex> = Vec::with_capacity(2 * rings.len());
        for (ring, center) in &rings {
            vertices.extend(ring);
            if ring.len() > 4 {
                vertices.push(*center);
            }
        }
        vertices.par_sort_unstable();
        vertices.dedup();
        fn index(vertex: Vertex, vertices: &[Vertex]) -> u32 {
            vertices.partition_point(|&other| other < vertex) as u32
        }
        let (mut sides, mut corners) = (Vec::new(), Vec::new());
        for (ring, center) in &rings {
            let ring: Vec<u32> = ring.iter().map(|&vertex| index(vertex, &vertices)).collect();
            if ring.len() == 4 {
                sides.push(4);
                corners.extend(ring);
            } else {
                let center = index(*center, &vertices);
                for (k, &vertex) in ring.iter().enumerate() {
                    sides.push(3);
                    corners.extend([center, vertex, ring[(k + 1) % ring.len()]]);
                }
            }
        }
        let at = |vertex: &Vertex| {
            let [x, y] = position(vertex.place);
            self.parameters(x, y)
        };
        let (points, normals): (Vec<_>, Vec<_>) = (vertices.par_iter())
            .map(|vertex| {
                let [u, v] = at(vertex);
                (self.surface.point(u, v), self.normal(*vertex))
            })
            .unzip();
        let (us, vs): (Vec<f64>, Vec<f64>) = vertices.iter().map(at).map(|[u, v]| (u, v)).unzip();
        let uv = to_unit(&self.surface.u, &us).into_iter().zip(to_unit(&self.surface.v, &vs));
        let uv = uv.map(|(u, v)| [u, v]).collect();
        let open = OpenMesh { points, normals, uv, faces: Faces::polygons(&sides, corners)? };
        let mesh = match self.join(&vertices) {
            Some(mut joined) => open.join(&mut joined)?,
            None => open.into_mesh()?,
        };
        Ok(mesh.with_frame(self.surface.net.frame().copied()))
    }

    /// Joins the vertices, which are sorted, at seams and poles. Returns `None` if there are neither.
    fn join(&self, vertices: &[Vertex]) -> Option<UnionFind> {
        let mut joined = UnionFind::new(vertices.len());
        let mut is_joined = false;
        let [end_x, end_y] = self.ends();
        for (number, vertex) in (0..).zip(vertices) {
            let [x, y] = position(vertex.place);
            let seam_u = (self.joints.is_closed_u && x == end_x).then_some([0, y]);
            let seam_v = (self.joints.is_closed_v && y == end_y).then_some([x, 0]);
            let pole_u = is_pole(&self.is_pole_u, x).then_some([x, 0]);
            let pole_v = is_pole(&self.is_pole_v, y).then_some([0, y]);
            for place in [seam_u, seam_v, pole_u, pole_v].into_iter().flatten().map(key) {
                if let Ok(other) = vertices.binary_search(&Vertex { place, ..*vertex }) {
                    is_joined |= other as u32 != number;
                    joined.union(number, other as u32);
                }
            }
        }
        is_joined.then_some(joined)
    }

    /// Returns true if there is a pole that is not at an end of the domain, and the cell comes after it.
    fn is_after_pole(&self, place: u64, cell: &Cell) -> bool {
        let [x, y] = position(place);
        fn is_inner(is_pole_at: &[bool], at: u32) -> bool {
            let span = (at / SPAN) as usize;
            is_pole(is_pole_at, at) && 0 < span && span + 1 < is_pole_at.len()
        }
        x == cell.x && is_inner(&self.is_pole_u, x) || y == cell.y && is_inner(&self.is_pole_v, y)
    }

    fn normal(&self, vertex: Vertex) -> Vector3<f64> {
        let [x, y] = position(vertex.place);
        let at = self.parameters(x, y);
        if is_pole(&self.is_pole_u, x) {
            let is_before = !vertex.is_after && 0 < x;
            return self.joints.normal_beside(ParameterDirection::U, at, is_before);
        }
        if is_pole(&self.is_pole_v, y) {
            let is_before = !vertex.is_after && 0 < y;
            return self.joints.normal_beside(ParameterDirection::V, at, is_before);
        }
        self.surface.normal(at[0], at[1]).map_or(Vector3::zeros(), Unit::into_inner)
    }
}

/// A vertex of the tessellation. The cells before and after a pole between them have separate vertices there.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Vertex {
    place: u64,
    /// True if the vertex belongs to the cells after a pole that is not at an end of the domain.
    is_after: bool,
}

/// Returns true if a position is at the end of a span where the surface has only one point.
fn is_pole(is_pole_at: &[bool], at: u32) -> bool {
    at.is_multiple_of(SPAN) && is_pole_at[(at / SPAN) as usize]
}

/// The maximum of `height` and the distances of the samples of a line from the chord of that line. A distance of NaN counts as the maximum.
fn max_height(line: &[Point3<f64>; SAMPLES], mut height: f64) -> f64 {
    for point in &line[1..LAST] {
        let sample = distance(*point, line[0], line[LAST]);
        height = if sample <= height { height } else { sample };
    }
    height
}

/// The position that [`key`] encodes.
fn position(key: u64) -> [u32; 2] {
    [(key >> 32) as u32, key as u32]
}

/// Encodes a position as one number. The order of the numbers is row by row.
fn key([x, y]: [u32; 2]) -> u64 {
    u64::from(x) << 32 | u64::from(y)
}

#[cfg(test)]
mod tests {
    use super::super::super::KnotVector;
    use super::super::evaluate::tests::{net, surface};
    use super::*;

    /// A plane with one steep hill as a test surface.
    fn hill() -> Surface {
        let net =
            net(12, 12, |y, x| Point3::new(x, y, if (x, y) == (3.0, 4.0) { 6.0 } else { 0.0 }));
        let knots = KnotVector::uniform(12, 4).unwrap();
        Surface::new(net, knots.clone(), knots).unwrap()
    }

    /// The distance of a point from the nearest triangle of a face, if the face is divided as a fan.
    fn from_face(mesh: &Mesh, face: &[u32], point: Point3<f64>) -> f64 {
        fn corner(k: usize, mesh: &Mesh, face: &[u32]) -> Point3<f64> {
            mesh.positions()[face[k] as usize]
        }
        fn plane([a, b, c]: [Point3<f64>; 3], point: Point3<f64>) -> f64 {
            let normal = (b - a).cross(&(c - a));
            ((point - a).dot(&normal) / normal.norm()).abs()
        }
        (2..face.len())
            .map(|k| {
                plane(
                    [corner(0, mesh, face), corner(k - 1, mesh, face), corner(k, mesh, face)],
                    point,
                )
            })
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn a_hill_on_a_plain_is_fine_on_the_hill_only() {
        let hill = hill();
        let coarse = hill.tessellate_within(0.1).unwrap();
        let fine = hill.tessellate_within(0.001).unwrap();
        assert!(fine.faces().len() > 10 * coarse.faces().len());
        // The corner of the mesh far from the hill is flat, and has one quad per span.
        let uv = fine.vertex().pairs("uv").unwrap();
        assert_eq!(uv.iter().filter(|uv| uv[0] > 0.888 && uv[1] > 0.888).count(), 4);
        let even = hill.tessellate(0, 0).unwrap();
        assert!(coarse.faces().len() * 4 < even.faces().len());
    }

    #[test]
    fn no_vertex_lies_on_an_edge_and_the_border_is_closed() {
        for surface in [hill(), surface([4, 3]), surface([2, 5])] {
            for tolerance in [0.3, 0.02, 0.004] {
                let mesh = surface.tessellate_within(tolerance).unwrap();
                assert_eq!(mesh.edges().misoriented, 0);
                // A vertex on the edge of another face (a T-junction) would make that edge an open edge inside of the domain.
                let uv = mesh.vertex().pairs("uv").unwrap();
                let mut sides = std::collections::BTreeMap::new();
                for face in mesh.faces().iter() {
                    for (k, &a) in face.iter().enumerate() {
                        let b = face[(k + 1) % face.len()];
                        *sides.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
                    }
                }
                for ([a, b], count) in sides {
                    let [a, b] = [a, b].map(|vertex| uv[vertex as usize]);
                    let on_border = (0..2).any(|k| a[k] == b[k] && (a[k] == 0.0 || a[k] == 1.0));
                    assert_eq!(count, if on_border { 1 } else { 2 }, "{a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn the_mesh_stays_within_the_tolerance() {
        let surface = surface([4, 3]);
        let tolerance = 0.01;
        let mesh = surface.tessellate_within(tolerance).unwrap();
        let uv = mesh.vertex().pairs("uv").unwrap();
        let (end_u, end_v) = (surface.u().domain().1, surface.v().domain().1);
        let mut highest = 0.0f64;
        for face in mesh.faces().iter() {
            let middle = [0, 1].map(|k| {
                face.iter().map(|&vertex| uv[vertex as usize][k]).sum::<f64>() / face.len() as f64
            });
            let point = surface.point(middle[0] * end_u, middle[1] * end_v);
            highest = highest.max(from_face(&mesh, face, point));
        }
        assert!(highest <= 1.2 * tolerance && highest >= 0.1 * tolerance, "{highest}");
        let normals = mesh.vertex().vectors("normal").unwrap();
        let [u, v] = uv[uv.len() / 2];
        let exact = surface.normal(u * end_u, v * end_v).unwrap().into_inner();
        assert_eq!(normals[uv.len() / 2], <[f64; 3]>::from(exact));
    }

    #[test]
    fn a_tolerance_of_zero_needs_too_many_cells() {
        let hill = hill();
        for nothing in [0.0, f64::NAN] {
            let refused = Tree::new(&hill, 5000).unwrap().refine(nothing);
            assert!(matches!(refused, Err(MeshError::TooLarge { .. })));
        }
    }

    #[test]
    fn a_flat_surface_needs_one_quad_per_span() {
        let hill = hill();
        let flat: Vec<_> = hill.net().points().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        let net = hill.net().clone().with_points(flat).unwrap();
        let flat = Surface::new(net, hill.u().clone(), hill.v().clone()).unwrap();
        assert_eq!(flat.tessellate_within(1e-9).unwrap().faces().len(), 81);
    }
}
