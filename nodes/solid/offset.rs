//! Computes the surface of the volume within a given radius of a set of triangles.
//!
//! The surface is extracted from the tetrahedra of a grid, with its vertices on grid edges; such a surface never intersects itself. Then
//! the vertices are moved to the exact radius. If this makes faces intersect, their vertices are moved back to their grid edges.

use maquette_node::{Error, Limit, LimitError, Progress};
use maquette_value::parallel::*;
use maquette_value::{Bounds, Faces, Mesh, TriangleTree};
use nalgebra::{Point3, Vector3};

use crate::contour::Contour;

/// Number of cells along an edge of a block. The grid consists of blocks; those far from all triangles are left out.
const BLOCK: usize = 4;

/// Number of nodes along an edge of a block; neighboring blocks share the nodes between them.
const SIDE: usize = BLOCK + 1;

/// Number of blocks that are measured between two checks for cancellation.
const CHUNK: usize = 64;

/// Maximum number of blocks of grid cells; measuring the distances in this many blocks takes half a minute.
const BLOCKS: Limit = Limit {
    max: 800_000,
    items: "blocks of a grid",
    help: "choose a larger `thickness`, or a smaller part of the mesh",
};

/// Minimum distance of a vertex from a grid node, as a fraction of a grid edge, in the extracted surface. Without this minimum, triangles
/// degenerate and their normals are arbitrary.
const NEAREST: f64 = 0.25;

/// Distance between the result and the floor, as a fraction of the radius. It is too small to be seen, but larger than the rounding errors
/// of faces that are coplanar with the floor.
const GAP: f64 = 0.002;

/// A half-space that limits the result: the points whose coordinate along the unit vector `up` is at least `height`, in mm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Floor {
    pub(crate) up: Vector3<f64>,
    pub(crate) height: f64,
}

impl Floor {
    pub(crate) fn height_above(&self, at: &Point3<f64>) -> f64 {
        at.coords.dot(&self.up) - self.height
    }
}

/// The volume to which an offset surface is restricted.
#[derive(Clone, Copy)]
pub(crate) enum Clip<'a> {
    Nothing,
    Floor(Floor),
    /// The points of positive depth, by a function that measures the depths of points, in mm.
    Depths(&'a (dyn Fn(&[Point3<f64>]) -> Vec<f64> + Sync)),
}

impl Clip<'_> {
    /// Returns the depth of each point inside of the volume, in mm. `gap` is the distance that is kept from a floor.
    fn depths(&self, points: &[Point3<f64>], gap: f64) -> Vec<f64> {
        match self {
            Self::Nothing => vec![f64::INFINITY; points.len()],
            Self::Floor(floor) => points.iter().map(|at| floor.height_above(at) - gap).collect(),
            Self::Depths(depths) => depths(points),
        }
    }
}

/// Returns the surface of the volume that is within `radius` mm of a triangle of the mesh and inside of `clip`. The surface is closed,
/// manifold and without self-intersections, for any triangles. The grid has `cells` cells per radius. As the faces are flat, the radius is
/// exact to about 2 % with 3 cells, and to 4 % with 2 cells.
pub(crate) fn offset_surface(
    mesh: &Mesh,
    (radius, cells): (f64, f64),
    clip: Clip<'_>,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let Some((low, high)) = mesh.bounds() else { return Ok(mesh.clone()) };
    let spacing = radius / cells;
    let reach = radius + 2.0 * spacing;
    // Shift the grid, so that its nodes do not coincide with vertices, whose coordinates are often round numbers.
    let low = low - Vector3::repeat(reach + 0.37 * spacing);
    let block = spacing * BLOCK as f64;
    let sizes = [0, 1, 2].map(|axis| ((high[axis] + reach - low[axis]) / block).ceil());
    fn check_blocks(count: f64) -> Result<(), LimitError> {
        BLOCKS.check("the space around the triangles", count)
    }
    // Limit the number of blocks along each axis first, and then the number around each triangle, so that products of these numbers cannot
    // overflow.
    check_blocks(sizes.into_iter().fold(0.0, f64::max))?;
    let mut blocks = Vec::new();
    for face in mesh.faces().iter() {
        let corners: Vec<_> = face.iter().map(|&it| mesh.positions()[it as usize]).collect();
        let bounds = Bounds::from_points(&corners);
        let range = [0, 1, 2].map(|axis| {
            let ends = [bounds.low[axis] - reach, bounds.high[axis] + reach];
            ends.map(|at| ((at - low[axis]) / block).max(0.0) as usize)
        });
        check_blocks(range.iter().map(|[from, to]| (to - from + 1) as f64).product())?;
        for z in range[2][0]..=range[2][1] {
            for y in range[1][0]..=range[1][1] {
                blocks.extend((range[0][0]..=range[0][1]).map(|x| [z, y, x]));
            }
        }
        // Remove duplicate blocks early if the list is long: faces close together produce the same blocks.
        if 4 * BLOCKS.max <= blocks.len() {
            sort_unique(&mut blocks);
            check_blocks(blocks.len() as f64)?;
        }
    }
    sort_unique(&mut blocks);
    check_blocks(blocks.len() as f64)?;
    let tree = TriangleTree::new(mesh);
    // Keep only the blocks that the surface may cross: the distance of their center from the triangles differs from the radius by at most
    // half of their diagonal.
    let middles: Vec<_> = blocks
        .iter()
        .map(|[z, y, x]| {
            let at = [x, y, z].map(|k| (*k as f64 + 0.5) * block);
            low + Vector3::from(at)
        })
        .collect();
    progress.tick(0.1)?;
    let far = tree.nearest_to_all(&middles).into_iter().map(|nearest| {
        nearest.map_or(f64::INFINITY, |nearest| nearest.distance_sq.sqrt() - radius)
    });
    let half = 0.5 * 3f64.sqrt() * block + spacing;
    let is_clipped = !matches!(clip, Clip::Nothing);
    let is_near =
        far.map(|far| far.abs() <= half || (is_clipped && far <= half)).collect::<Vec<_>>();
    let mut kept = is_near.into_iter();
    blocks.retain(|_| kept.next() == Some(true));
    progress.tick(0.2)?;
    let place = |at: [usize; 3]| low + Vector3::from(at.map(|k| k as f64)) * spacing;
    let gap = GAP * radius;
    let mut contour = Contour::new(NEAREST);
    for (number, chunk) in blocks.chunks(CHUNK).enumerate() {
        progress.tick(0.2 + 0.7 * (number * CHUNK) as f64 / blocks.len() as f64)?;
        let nodes = chunk.par_iter().flat_map_iter(|&[z, y, x]| {
            (0..SIDE * SIDE * SIDE).map(move |k| {
                let [i, j, k] = [k % SIDE, k / SIDE % SIDE, k / SIDE / SIDE];
                [BLOCK * x + i, BLOCK * y + j, BLOCK * z + k]
            })
        });
        let places: Vec<Point3<f64>> = nodes.map(place).collect();
        let nearest = tree.nearest_to_all(&places);
        let clipped = clip.depths(&places, gap);

        for (block, &[z, y, x]) in chunk.iter().enumerate() {
            let first = block * SIDE * SIDE * SIDE;
            for k in 0..BLOCK * BLOCK * BLOCK {
                let [i, j, k] = [k % BLOCK, k / BLOCK % BLOCK, k / BLOCK / BLOCK];
                fn node(step: usize, i: usize, j: usize, k: usize, first: usize) -> usize {
                    let (i, j, k) = (i + (step & 1), j + (step >> 1 & 1), k + (step >> 2));
                    first + i + SIDE * (j + SIDE * k)
                }
                let depths = std::array::from_fn(|step| {
                    let at = node(step, i, j, k, first);
                    let inside = nearest[at].map_or(0.0, |it| radius - it.distance_sq.sqrt());
                    inside.min(clipped[at])
                });
                contour.add([BLOCK * x + i, BLOCK * y + j, BLOCK * z + k], depths, place);
            }
        }
    }
    // Reverse the faces: the faces of the contour look inward, to the side of positive depth.
    let triangles = contour.triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
    let mut skin = Mesh::new(contour.points.clone(), Faces::triangles(triangles))?;
    let nearest = tree.nearest_to_all(&contour.points);
    let clipped = clip.depths(&contour.points, gap);
    let mut moved: Vec<_> = (0..contour.points.len())
        .map(|vertex| {
            let point = contour.points[vertex];
            let Some(nearest) = nearest[vertex] else { return point };
            let distance = nearest.distance_sq.sqrt();
            if radius - distance <= clipped[vertex] {
                let on = nearest.position(mesh);
                return on + (point - on) * (radius / distance);
            }
            match clip {
                Clip::Floor(floor) => point - floor.up * clipped[vertex],
                // Follow the grid edge inwards, to where the depth would be zero if it were linear.
                Clip::Depths(_) => {
                    let (end, depth) = contour.deep_ends[vertex];
                    let outside = (-clipped[vertex]).max(0.0);
                    point + (end - point) * (outside / (outside + depth))
                }
                Clip::Nothing => point,
            }
        })
        .collect();
    // Moved vertices may pass each other where two parts of the surface are close to each other. The vertices of intersecting faces return
    // to their grid edges, on which faces never intersect.
    loop {
        skin = skin.with_positions(moved.clone())?;
        let found = skin.crossings(|| progress.check())?;
        let faces = found.as_flattened().iter().map(|&face| skin.faces().face(face as usize));
        let mut changes = false;
        for vertex in faces.flatten().map(|&vertex| vertex as usize) {
            changes |= moved[vertex] != contour.points[vertex];
            moved[vertex] = contour.points[vertex];
        }
        if !changes {
            return Ok(skin);
        }
    }
}

fn sort_unique(blocks: &mut Vec<[usize; 3]>) {
    blocks.sort_unstable();
    blocks.dedup();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::volume;

    fn triangle() -> Mesh {
        let corners = [[0.0, 0.0, 0.0], [12.0, 0.0, 0.0], [0.0, 9.0, 0.0]];
        Mesh::new(corners.map(Point3::from).to_vec(), Faces::triangles(vec![[0, 1, 2]])).unwrap()
    }

    #[test]
    fn around_a_triangle_there_is_a_round_plate() {
        let radius = 1.0;
        let plate =
            offset_surface(&triangle(), (radius, 3.0), Clip::Nothing, &Progress::silent()).unwrap();
        let edges = plate.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert_eq!(plate.crossings(|| Progress::silent().check()).unwrap(), Vec::<[u32; 2]>::new());
        // The expected volume is that of Steiner's formula: area times height, half a cylinder along the border, and a ball.
        let pi = std::f64::consts::PI;
        let expected = 54.0 * 2.0 + pi / 2.0 * 36.0 + 4.0 / 3.0 * pi;
        let found = volume(&plate, Point3::origin());
        assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
        let nearest = TriangleTree::new(&triangle()).nearest_to_all(plate.positions());
        let distances = nearest.iter().map(|it| it.unwrap().distance_sq.sqrt());
        assert!(distances.clone().all(|it| (0.94..1.06).contains(&it)));
    }

    #[test]
    fn nothing_is_below_the_floor() {
        let floor = Floor { up: Vector3::z(), height: -0.4 };
        let plate =
            offset_surface(&triangle(), (1.0, 3.0), Clip::Floor(floor), &Progress::silent())
                .unwrap();
        let edges = plate.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        let lowest = plate.positions().iter().map(|at| at.z).fold(f64::INFINITY, f64::min);
        assert!((-0.4..-0.39).contains(&lowest), "{lowest}");
    }
}
