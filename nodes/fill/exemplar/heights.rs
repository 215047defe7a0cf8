//! Represents the surface around a vertex as heights over the plane of a local frame, measured at the nodes of a square lattice.

use std::cmp::Ordering;

use maquette_value::simd::{Kernel, widest};
use nalgebra::{Point3, Vector3};

use super::frame::{Frame, Orientation};
use super::surface::{NONE, Surface};

/// Number of lattice nodes from the center of the lattice to each side. With fewer nodes, the features of a patch that is about 7 edges
/// wide are blurred; more nodes cost memory.
const HALF: usize = 8;

/// The number of nodes in a row of the lattice.
pub(super) const SIDE: usize = 2 * HALF + 1;

/// The number of nodes of the lattice.
pub(super) const NODES: usize = SIDE * SIDE;

/// The index of the center node.
const MIDDLE: usize = NODES / 2;

/// A square lattice over a disk around a vertex. The heights of the surface are measured at the nodes inside the disk.
pub(super) struct Lattice {
    pub(super) step: f64,
    /// The nodes inside the disk, without the center node, ordered from the center outward.
    nodes: Vec<Nodes>,
    count: usize,
}

/// Up to [`LANES`] nodes of a lattice inside its disk, all on one square ring around the center node.
struct Nodes {
    /// The indices of the nodes; shorter than [`LANES`] for the last group of a ring.
    indices: Vec<usize>,
    /// For each node, the index of the node that is one step nearer to the center.
    inner: [usize; LANES],
    /// The columns and rows of the nodes, relative to the center node.
    at: [[f64; LANES]; 2],
}

impl Nodes {
    /// Creates a group of nodes from their columns and rows relative to the center node.
    fn new(nodes: &[[i32; 2]]) -> Self {
        let padded: [[i32; 2]; LANES] =
            std::array::from_fn(|k| nodes.get(k).copied().unwrap_or_default());
        Self {
            indices: nodes.iter().copied().map(node_index).collect(),
            inner: padded.map(inner_node),
            at: [0, 1].map(|axis| padded.map(|node| f64::from(node[axis]))),
        }
    }
}

/// Returns the index of the node with the given column and row, relative to the center node.
fn node_index([x, y]: [i32; 2]) -> usize {
    let half = HALF as i32;
    ((y + half) * SIDE as i32 + x + half) as usize
}

/// Returns the index of the node that is one step nearer to the center.
fn inner_node([x, y]: [i32; 2]) -> usize {
    match x.abs().cmp(&y.abs()) {
        Ordering::Less => node_index([x, y - y.signum()]),
        Ordering::Equal => node_index([x - x.signum(), y - y.signum()]),
        Ordering::Greater => node_index([x - x.signum(), y]),
    }
}

impl Lattice {
    /// Returns a lattice for a disk with the given radius.
    pub(super) fn new(radius: f64) -> Self {
        let half = HALF as i32;
        let mut nodes: Vec<[i32; 2]> =
            (-half..=half).flat_map(|y| (-half..=half).map(move |x| [x, y])).collect();
        nodes.retain(|[x, y]| x * x + y * y <= half * half + half);
        fn ring([x, y]: [i32; 2]) -> i32 {
            x.abs().max(y.abs())
        }
        nodes.sort_by_key(|&node| (ring(node), node[1], node[0]));
        let count = nodes.len();
        let rings = nodes[1..].chunk_by(|&a, &b| ring(a) == ring(b));
        let nodes = rings.flat_map(|ring| ring.chunks(LANES)).map(Nodes::new).collect();
        Self { step: radius / HALF as f64, nodes, count }
    }

    /// Returns the indices of the nodes whose distance from the center is at most `fraction` times the disk's radius.
    pub(super) fn nodes_within(&self, fraction: f64) -> Vec<usize> {
        let max_radius = fraction * HALF as f64;
        let all =
            self.nodes.iter().flat_map(|nodes| (0..nodes.indices.len()).map(move |k| (nodes, k)));
        [MIDDLE]
            .into_iter()
            .chain(all.filter_map(|(nodes, k): (&Nodes, usize)| {
                let [x, y] = [0, 1].map(|axis| nodes.at[axis][k]);
                (x * x + y * y <= max_radius * max_radius).then_some(nodes.indices[k])
            }))
            .collect()
    }

    /// Measures heights of the surface around a vertex over the plane of a frame. Walks from node to node over the triangles with an index
    /// below `limit`. Heights are NaN where the triangles end or face away. Returns the fraction of the disk's nodes that have a height.
    pub(super) fn measure(
        &self,
        surface: &Surface<'_>,
        points: &[Point3<f64>],
        limit: u32,
        vertex: u32,
        frame: &Frame,
        heights: &mut [f32],
    ) -> f64 {
        let walk = Walk { surface, points, limit, frame };
        let mut count = 0;
        widest(Measure { lattice: self, walk, vertex, heights, count: &mut count });
        f64::from(count) / self.count as f64
    }
}

/// A kernel that measures the heights of a surface around a vertex.
struct Measure<'a> {
    lattice: &'a Lattice,
    walk: Walk<'a>,
    vertex: u32,
    heights: &'a mut [f32],
    /// The number of nodes that have a height.
    count: &'a mut u32,
}

impl Kernel for Measure<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { lattice, walk, vertex, heights, count } = self;
        heights.fill(f32::NAN);
        let mut found = [NONE; NODES];
        let first = walk.surface.faces_around(vertex).iter().filter(|face| **face < walk.limit);
        let reached =
            first.map(|&face| walk.walk_to([face], &[[0.0]; 2])).find(|&([face], _)| face != NONE);
        let Some(([face], [height])) = reached else { return };
        (found[MIDDLE], heights[MIDDLE], *count) = (face, height as f32, 1);
        for nodes in &lattice.nodes {
            let mut from = [NONE; LANES];
            for k in 0..nodes.indices.len() {
                from[k] = found[nodes.inner[k]];
            }
            let (faces, reached) =
                walk.walk_to(from, &nodes.at.map(|at| at.map(|x| x * lattice.step)));
            for (k, &index) in nodes.indices.iter().enumerate() {
                if faces[k] != NONE {
                    found[index] = faces[k];
                    heights[index] = reached[k] as f32;
                    *count += 1;
                }
            }
        }
    }
}

/// Factor of a correction of heights for exemplars (patches of the input surface) that must not be shifted to fit a patch. Each lattice
/// node is moved away from its four neighbors by this factor times the sum of its height differences to them. Without the correction,
/// interpolated heights are on the concave side of a curved surface: between nodes on average by 1/12 of the sum, and inside regular facets
/// with edges of one step by 1/16. With 1/12, a filled cap of a sphere still sinks with each iteration. If all vertices are samples, the
/// value 1/6 reduces the mean distance of 12 filled holes from a unit sphere from 0.026 to 0.001. For 8 holes in a ridge, filled from a
/// plate, it reduces the mean distance from 0.010 to 0.008.
const SAG: f32 = 1.0 / 6.0;

/// Moves heights onto a smooth surface that, on average, passes through the vertices of the measured surface. Nodes at the border of the
/// lattice and nodes next to missing heights do not move.
pub(super) fn round_out(heights: &mut [f32]) {
    let measured = heights.to_vec();
    for row in 1..SIDE - 1 {
        for column in 1..SIDE - 1 {
            let node = row * SIDE + column;
            let beside = [node - 1, node + 1, node - SIDE, node + SIDE];
            let sum: f32 = beside.iter().map(|&other| measured[other] - measured[node]).sum();
            if sum.is_finite() {
                heights[node] -= SAG * sum;
            }
        }
    }
}

/// Maximum number of steps of a walk over triangles; a walk that takes more is going in circles.
const MAX_STEPS: usize = 128;

/// Walks over the triangles of a mesh, projected to the plane of a frame.
struct Walk<'a> {
    surface: &'a Surface<'a>,
    points: &'a [Point3<f64>],
    limit: u32,
    frame: &'a Frame,
}

/// The x, y and z coordinates of several points, one array per axis.
type Columns<const N: usize> = [[f64; N]; 3];

impl Walk<'_> {
    /// Returns the coordinates of vertices in the frame.
    #[inline(always)]
    fn local<const N: usize>(&self, vertices: [u32; N]) -> Columns<N> {
        let Frame { origin: at, x, y, z, .. } = self.frame;
        let (mut given, mut local) = ([[0.0; N]; 3], [[0.0; N]; 3]);
        for k in 0..N {
            let point = &self.points[vertices[k] as usize];
            (given[0][k], given[1][k], given[2][k]) = (point.x, point.y, point.z);
        }
        for k in 0..N {
            let [a, b, c] = [given[0][k] - at.x, given[1][k] - at.y, given[2][k] - at.z];
            local[0][k] = a * x.x + b * x.y + c * x.z;
            local[1][k] = a * y.x + b * y.y + c * y.z;
            local[2][k] = a * z.x + b * z.y + c * z.z;
        }
        local
    }

    /// Walks from each triangle in `from` to the triangle above the position in `to`, on the plane of the frame. Returns the triangles
    /// reached and their heights at the positions; [`NONE`] where the surface does not extend to the position. All walks advance by one
    /// step at a time, for SIMD: a step depends only on the previous step of the same walk.
    #[inline(always)]
    fn walk_to<const N: usize>(&self, from: [u32; N], to: &[[f64; N]; 2]) -> ([u32; N], [f64; N]) {
        let mut faces = from.map(|face| if face == NONE { 0 } else { face });
        let mut state = from.map(|face| if face == NONE { LOST } else { WALKING });
        let mut corners = [[0; N]; 3];
        for k in 0..N {
            let face = &self.surface.faces[faces[k] as usize];
            (corners[0][k], corners[1][k], corners[2][k]) = (face[0], face[1], face[2]);
        }
        let mut at = [self.local(corners[0]), self.local(corners[1]), self.local(corners[2])];
        for _ in 0..MAX_STEPS {
            let Sides { sides, areas } = Sides::new(&at, to);
            // Find the edge of the triangle that separates it farthest from the position.
            let mut out = [0_u64; N];
            for k in 0..N {
                let [a, b, c] = [sides[0][k], sides[1][k], sides[2][k]];
                let (edge, min_side) = if b < a { (1, b) } else { (0, a) };
                let (edge, min_side) = if c < min_side { (2, c) } else { (edge, min_side) };
                out[k] = edge;
                let is_beyond = min_side < -1e-9 * areas[k];
                let next = if is_beyond { WALKING } else { ARRIVED };
                let next = if areas[k] > 0.0 { next } else { LOST };
                state[k] = if state[k] == WALKING { next } else { state[k] };
            }
            if state.iter().all(|&state| state != WALKING) {
                break;
            }
            let (mut next, mut across) = ([0; N], [0; N]);
            let mut ends = [[0; N]; 2];
            for k in 0..N {
                let beside = self.surface.adjacent_face(faces[k], out[k] as usize);
                let [first, second] = FIRST_OR_SECOND[beside.end as usize];
                (next[k], across[k]) = (beside.face, beside.across);
                (ends[0][k], ends[1][k]) = (first, second);
            }
            for k in 0..N {
                let goes = if next[k] < self.limit { WALKING } else { LOST };
                state[k] = if state[k] == WALKING { goes } else { state[k] };
                faces[k] = if state[k] == WALKING { next[k] } else { faces[k] };
            }
            // Keep the corners in the order that they have in the face, so that sums over corners are always computed in the same order.
            let apex = self.local(across);
            for axis in 0..3 {
                let ([a, b, c], apex) = ([at[0][axis], at[1][axis], at[2][axis]], apex[axis]);
                for k in 0..N {
                    let goes = if state[k] == WALKING { u64::MAX } else { 0 };
                    let first = if out[k] == 0 { u64::MAX } else { 0 };
                    let second = if out[k] == 1 { u64::MAX } else { 0 };
                    let start = pick(first, a[k], pick(second, b[k], c[k]));
                    let end = pick(first, b[k], pick(second, c[k], a[k]));
                    let (first, second) = (ends[0][k], ends[1][k]);
                    let x = pick(first, end, pick(second, apex[k], start));
                    let y = pick(first, start, pick(second, end, apex[k]));
                    let z = pick(first, apex[k], pick(second, start, end));
                    at[0][axis][k] = pick(goes, x, a[k]);
                    at[1][axis][k] = pick(goes, y, b[k]);
                    at[2][axis][k] = pick(goes, z, c[k]);
                }
            }
        }
        let Sides { sides, areas } = Sides::new(&at, to);
        let mut heights = [0.0; N];
        for k in 0..N {
            let [a, b, c] = [at[0][2][k], at[1][2][k], at[2][2][k]];
            heights[k] = (sides[1][k] * a + sides[2][k] * b + sides[0][k] * c) / areas[k];
            faces[k] = if state[k] == ARRIVED { faces[k] } else { NONE };
        }
        (faces, heights)
    }
}

/// For each corner of a triangle, the index of the next corner.
const AFTER: [usize; 3] = [1, 2, 0];

/// The states of a walk over triangles: it continues, has arrived, or has left the surface. States are as wide as coordinates, so that both
/// fit the same SIMD lanes.
const WALKING: u64 = 0;
const ARRIVED: u64 = 1;
const LOST: u64 = 2;

/// For each corner index of a triangle, two masks: the first is all ones for corner 0, the second is all ones for corner 1.
const FIRST_OR_SECOND: [[u64; 2]; 3] = [[u64::MAX, 0], [0, u64::MAX], [0, 0]];

/// Returns `one` if the mask is all ones, `other` if it is 0. Uses bit operations, since the compiler would turn a condition into a branch.
#[inline(always)]
fn pick(mask: u64, one: f64, other: f64) -> f64 {
    f64::from_bits((one.to_bits() & mask) | (other.to_bits() & !mask))
}

/// Twice the signed areas of the triangles between a position and each edge of a face, and twice the area of the face, for `N` faces.
struct Sides<const N: usize> {
    sides: [[f64; N]; 3],
    areas: [f64; N],
}

impl<const N: usize> Sides<N> {
    #[inline(always)]
    fn new(at: &[Columns<N>; 3], to: &[[f64; N]; 2]) -> Self {
        let mut found = Self { sides: [[0.0; N]; 3], areas: [0.0; N] };
        for k in 0..N {
            let side = |corner: usize| {
                let [a, b] = [&at[corner], &at[AFTER[corner]]].map(|at| [at[0][k], at[1][k]]);
                (b[0] - a[0]) * (to[1][k] - a[1]) - (b[1] - a[1]) * (to[0][k] - a[0])
            };
            let [a, b, c] = [side(0), side(1), side(2)];
            (found.sides[0][k], found.sides[1][k], found.sides[2][k]) = (a, b, c);
            found.areas[k] = a + b + c;
        }
        found
    }
}

/// A sample of a patch: a point of the surface and its normal in the coordinates of the patch's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) at: [f64; 2],
    pub(super) height: f64,
    pub(super) normal: [f64; 3],
}

impl Sample {
    fn new(point: [f64; 3], normal: [f64; 3]) -> Self {
        Self { at: [point[0], point[1]], height: point[2], normal }
    }
}

/// The number of samples that are compared at once.
pub(super) const LANES: usize = 8;

/// Samples in the coordinates of exemplars with one orientation: positions in columns and rows of the lattice, and normals in the same
/// units.
#[derive(Clone, Copy)]
pub(super) struct View<const N: usize> {
    at: [[f64; N]; 2],
    /// The lattice cells that contain the positions.
    cells: Cells<N>,
    heights: [f64; N],
    normals: [[f64; N]; 3],
}

impl<const N: usize> View<N> {
    /// Creates a view of at most `N` samples for lattices with spacing `step`; unused lanes have no position. The samples are shifted by
    /// `shift` columns and rows.
    pub(super) fn new(
        samples: &[Sample],
        step: f64,
        orientation: &Orientation,
        shift: [f64; 2],
    ) -> Self {
        let (mut at, mut heights, mut normals) = ([[f64::NAN; N]; 2], [0.0; N], [[0.0; N]; 3]);
        let middle = HALF as f64;
        for (k, sample) in samples.iter().enumerate() {
            let [u, v] = orientation.apply(sample.at);
            let [x, y] = orientation.apply([sample.normal[0], sample.normal[1]]);
            (at[0][k], at[1][k]) = (u / step + middle + shift[0], v / step + middle + shift[1]);
            heights[k] = sample.height;
            (normals[0][k], normals[1][k], normals[2][k]) = (x / step, y / step, sample.normal[2]);
        }
        Self { at, cells: Cells::locate(&at), heights, normals }
    }

    /// Returns the signed distances from the samples along their normals to the surface given by `heights`; NaN where it has no height.
    #[inline(always)]
    pub(super) fn distances(&self, heights: &[f32]) -> [f64; N] {
        // Distance, in lattice steps, by which the line along a normal may move sideways before the surface is evaluated again.
        const MAX_DEVIATION: f64 = 0.05;
        let [x, y, z] = &self.normals;
        let mut distances = [0.0; N];
        let below = self.cells.interpolate(heights);
        for k in 0..N {
            let descent = descent(below.slopes(k), [x[k], y[k], z[k]]);
            distances[k] = (below.heights[k] - self.heights[k]) / descent;
        }
        let (mut there, mut leaves) = (self.at, [0_u64; N]);
        for k in 0..N {
            let (du, dv) = (distances[k] * x[k], distances[k] * y[k]);
            there[0][k] += du;
            there[1][k] += dv;
            leaves[k] = u64::from(du * du + dv * dv > MAX_DEVIATION * MAX_DEVIATION);
        }
        if leaves.iter().fold(0, |any, leaves| any | leaves) == 0 {
            return distances;
        }
        let below = Cells::locate(&there).interpolate(heights);
        for k in 0..N {
            let rest = below.heights[k] - self.heights[k] - distances[k] * z[k];
            let again = distances[k] + rest / descent(below.slopes(k), [x[k], y[k], z[k]]);
            distances[k] = if leaves[k] == 0 { distances[k] } else { again };
        }
        distances
    }
}

impl<const N: usize> View<N> {
    /// Returns the changes of the distances of the samples if they are shifted by a column or a row.
    #[inline(always)]
    pub(super) fn distance_slopes(&self, heights: &[f32]) -> [[f64; N]; 2] {
        let [x, y, z] = &self.normals;
        let below = self.cells.interpolate(heights);
        let mut slopes = below.slopes;
        for k in 0..N {
            let descent = descent(below.slopes(k), [x[k], y[k], z[k]]);
            slopes[0][k] /= descent;
            slopes[1][k] /= descent;
        }
        slopes
    }
}

/// Returns the rate at which a line in the given direction approaches a surface with the given slope. The rate is at least 0.25, so that
/// the search ends for lines parallel to the surface.
#[inline(always)]
fn descent(slope: [f64; 2], [x, y, z]: [f64; 3]) -> f64 {
    let descent = z - slope[0] * x - slope[1] * y;
    if descent > 0.25 { descent } else { 0.25 }
}

/// Positions on a lattice, each given by the cell of four nodes that contains it.
#[derive(Clone, Copy)]
struct Cells<const N: usize> {
    /// The index of the node with the smallest column and row of each cell.
    corners: [u64; N],
    /// The offsets of the positions from the nodes in `corners`, in columns and rows; NaN outside of the lattice.
    columns: [f64; N],
    rows: [f64; N],
}

impl<const N: usize> Cells<N> {
    #[inline(always)]
    fn locate([u, v]: &[[f64; N]; 2]) -> Self {
        let mut cells = Self { corners: [0; N], columns: [0.0; N], rows: [0.0; N] };
        let last = (SIDE - 1) as f64;
        for k in 0..N {
            let is_inside = (0.0 <= u[k]) & (u[k] < last) & (0.0 <= v[k]) & (v[k] < last);
            let column = floor(if is_inside { u[k] } else { 0.0 });
            let row = floor(if is_inside { v[k] } else { 0.0 });
            // Convert to an integer by bit operations; an `as` cast would check the range.
            cells.corners[k] = (row * SIDE as f64 + column + INTEGER).to_bits() & 0xffff;
            cells.columns[k] = if is_inside { u[k] - column } else { f64::NAN };
            cells.rows[k] = if is_inside { v[k] - row } else { f64::NAN };
        }
        cells
    }

    /// Interpolates heights and slopes at the positions; NaN if one of the four nodes has no height.
    #[inline(always)]
    fn interpolate(&self, heights: &[f32]) -> HeightsAndSlopes<N> {
        // Load two adjacent heights as one 64-bit number, which halves the number of loads.
        let (mut below, mut above) = ([0; N], [0; N]);
        for k in 0..N {
            let corner = self.corners[k] as usize;
            let cell = &heights[corner..corner + SIDE + 2];
            #[inline(always)]
            fn pair(first: usize, cell: &[f32]) -> u64 {
                let [a, b] =
                    [cell[first], cell[first + 1]].map(|height| u64::from(height.to_bits()));
                a | (b << 32)
            }
            (below[k], above[k]) = (pair(0, cell), pair(SIDE, cell));
        }
        let mut under = HeightsAndSlopes { heights: [0.0; N], slopes: [[0.0; N]; 2] };
        for k in 0..N {
            #[inline(always)]
            fn low_half(pair: u64) -> f64 {
                f64::from(f32::from_bits(pair as u32))
            }
            #[inline(always)]
            fn high_half(pair: u64) -> f64 {
                f64::from(f32::from_bits((pair >> 32) as u32))
            }
            let [a, b] = [low_half(below[k]), high_half(below[k])];
            let [c, d] = [low_half(above[k]), high_half(above[k])];
            let (s, t) = (self.columns[k], self.rows[k]);
            let (below, above) = (a + s * (b - a), c + s * (d - c));
            under.heights[k] = below + t * (above - below);
            under.slopes[0][k] = (b - a) + t * ((d - c) - (b - a));
            under.slopes[1][k] = above - below;
        }
        under
    }
}

/// Adding this constant to a small number leaves the nearest integer in the lowest bits of the sum.
const INTEGER: f64 = (3_u64 << 51) as f64;

/// Returns the largest integer that is not above `x`, for `x` much smaller than 2^51.
#[inline(always)]
fn floor(x: f64) -> f64 {
    let nearest = (x + INTEGER) - INTEGER;
    nearest - if nearest > x { 1.0 } else { 0.0 }
}

/// The heights and slopes of a surface at some positions of a lattice.
struct HeightsAndSlopes<const N: usize> {
    heights: [f64; N],
    slopes: [[f64; N]; 2],
}

impl<const N: usize> HeightsAndSlopes<N> {
    #[inline(always)]
    fn slopes(&self, k: usize) -> [f64; 2] {
        [self.slopes[0][k], self.slopes[1][k]]
    }
}

/// Returns the interpolated height at a position, given in lattice steps from the center; NaN where heights are missing.
pub(super) fn height_at(heights: &[f32], place: [f64; 2]) -> f64 {
    let [u, v] = place.map(|x| [x + HALF as f64]);
    Cells::locate(&[u, v]).interpolate(heights).heights[0]
}

/// Returns a sample of a patch: a point and a normal in the patch's frame.
pub(super) fn sample(frame: &Frame, point: &Point3<f64>, normal: &Vector3<f64>) -> Sample {
    Sample::new(frame.local(point - frame.origin), frame.local(*normal))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_lifts_a_bowl_evenly_and_keeps_a_plane() {
        fn lattice(height: fn(f32, f32) -> f32) -> Vec<f32> {
            fn coordinate(k: usize) -> f32 {
                k as f32 - HALF as f32
            }
            (0..NODES)
                .map(|node| height(coordinate(node % SIDE), coordinate(node / SIDE)))
                .collect()
        }
        fn moves(height: fn(f32, f32) -> f32) -> Vec<f32> {
            let before = lattice(height);
            let mut after = before.clone();
            round_out(&mut after);
            (0..NODES)
                .filter(|node| {
                    (1..SIDE - 1).contains(&(node % SIDE)) && (1..SIDE - 1).contains(&(node / SIDE))
                })
                .map(|node| after[node] - before[node])
                .collect()
        }
        assert!(moves(|x, y| 0.5 * x - 0.25 * y).iter().all(|&by| by == 0.0));
        // The differences between a node and its four neighbors sum up to -1, so each node rises by `SAG`.
        let bowl = moves(|x, y| -0.25 * (x * x + y * y));
        assert!(bowl.iter().all(|&by| (by - SAG).abs() < 1e-5), "{bowl:?}");
    }

    #[test]
    fn nodes_next_to_missing_heights_are_unchanged() {
        let mut heights = vec![1.0; NODES];
        let middle = NODES / 2;
        heights[middle] = f32::NAN;
        heights[middle + 2] = 3.0;
        round_out(&mut heights);
        assert!(heights[middle].is_nan());
        assert_eq!(heights[middle + 1], 1.0);
        assert!(heights[middle + 2] > 3.0);
    }
}
