//! What is no farther from triangles than a radius.
//!
//! Tetrahedra of a grid never cross each other. So a vertex is moved from an edge of the grid to the surface only if no faces cross
//! afterwards.

use maquette_node::{Cancelled, Limit, Progress, TooMuch};
use maquette_value::parallel::*;
use maquette_value::{Bounds, Faces, Mesh, MeshError, NearestPlace, TriangleTree};
use nalgebra::{Point3, Vector3};
use thiserror::Error;

use crate::contour::Contour;

/// Cells along an edge of a block. Blocks that no triangle comes near to are left out.
const BLOCK: usize = 4;

/// Nodes along an edge of a block: neighbors share those between them.
const SIDE: usize = BLOCK + 1;

/// Blocks that are measured between two looks at whether to stop.
const CHUNK: usize = 64;

/// Half a minute.
const BLOCKS: Limit = Limit {
    most: 800_000,
    of: "blocks of a grid",
    help: "choose a larger `thickness`, or a smaller part of the mesh",
};

/// How near a vertex is to a node at least, before it is moved to the radius: so triangles are nowhere slivers, whose normals would be anything.
const NEAREST: f64 = 0.25;

/// How far above the floor it ends, as a share of the radius: too little to be seen, and more than what rounding makes of walls in one plane.
const GAP: f64 = 0.002;

/// Why there is nothing around triangles.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum RoundError {
    /// More cells than memory should hold.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// Too much for a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A half-space that nothing may leave: what is at least so high along a direction of the length 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Floor {
    pub(crate) up: Vector3<f64>,
    pub(crate) height: f64,
}

impl Floor {
    pub(crate) fn above(&self, at: &Point3<f64>) -> f64 {
        at.coords.dot(&self.up) - self.height
    }
}

/// The skin of all that is no farther than `radius` from a triangle of the mesh, and above the floor: closed, manifold and free of crossings, whatever the
/// triangles do. It is made of flat faces, with so many `cells` along the radius: within some 2 % of it with 3 cells, 4 % with 2.
pub(crate) fn round(
    mesh: &Mesh,
    (radius, cells): (f64, f64),
    floor: Option<Floor>,
    progress: &Progress<'_>,
) -> Result<Mesh, RoundError> {
    let Some((low, high)) = mesh.bounds() else { return Ok(mesh.clone()) };
    let spacing = radius / cells;
    let reach = radius + 2.0 * spacing;
    // Off the places of the mesh, which are often round numbers.
    let low = low - Vector3::repeat(reach + 0.37 * spacing);
    let block = spacing * BLOCK as f64;
    let sizes = [0, 1, 2].map(|axis| ((high[axis] + reach - low[axis]) / block).ceil());
    fn few(count: f64) -> Result<(), TooMuch> {
        BLOCKS.check("the space around the triangles", count)
    }
    // So that blocks along an axis, and those of each triangle, can be counted.
    few(sizes.into_iter().fold(0.0, f64::max))?;
    let mut blocks = Vec::new();
    for face in mesh.faces().iter() {
        let corners: Vec<_> = face.iter().map(|&it| mesh.positions()[it as usize]).collect();
        let bounds = Bounds::around(&corners);
        let range = [0, 1, 2].map(|axis| {
            let ends = [bounds.low[axis] - reach, bounds.high[axis] + reach];
            ends.map(|at| ((at - low[axis]) / block).max(0.0) as usize)
        });
        few(range.iter().map(|[from, to]| (to - from + 1) as f64).product())?;
        for z in range[2][0]..=range[2][1] {
            for y in range[1][0]..=range[1][1] {
                blocks.extend((range[0][0]..=range[0][1]).map(|x| [z, y, x]));
            }
        }
        // Many faces are near to the same block.
        if 4 * BLOCKS.most <= blocks.len() {
            once(&mut blocks);
            few(blocks.len() as f64)?;
        }
    }
    once(&mut blocks);
    few(blocks.len() as f64)?;
    let tree = TriangleTree::new(mesh);
    // Blocks that the skin may run through: as far from the triangles as it is, but for half of their diagonal.
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
    let is_near =
        far.map(|far| far.abs() <= half || (floor.is_some() && far <= half)).collect::<Vec<_>>();
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
        let depth = |at: usize| {
            let inside = nearest[at].map_or(0.0, |it| radius - it.distance_sq.sqrt());
            floor.map_or(inside, |floor| inside.min(floor.above(&places[at]) - gap))
        };
        for (block, &[z, y, x]) in chunk.iter().enumerate() {
            let first = block * SIDE * SIDE * SIDE;
            for k in 0..BLOCK * BLOCK * BLOCK {
                let [i, j, k] = [k % BLOCK, k / BLOCK % BLOCK, k / BLOCK / BLOCK];
                let node = |step: usize| {
                    let (i, j, k) = (i + (step & 1), j + (step >> 1 & 1), k + (step >> 2));
                    first + i + SIDE * (j + SIDE * k)
                };
                let depths = std::array::from_fn(|step| depth(node(step)));
                contour.add([BLOCK * x + i, BLOCK * y + j, BLOCK * z + k], depths, place);
            }
        }
    }
    // The surface looks to where it is deep, and a skin away from it.
    let triangles = contour.triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
    let mut skin = Mesh::new(contour.points.clone(), Faces::triangles(triangles))?;
    let nearest = tree.nearest_to_all(&contour.points);
    let mut moved: Vec<_> = contour
        .points
        .iter()
        .zip(&nearest)
        .map(|(point, nearest): (&Point3<f64>, &Option<NearestPlace>)| {
            let Some(nearest) = nearest else { return *point };
            let distance = nearest.distance_sq.sqrt();
            match floor.map(|floor| (floor.up, floor.above(point) - gap)) {
                Some((up, above)) if above < radius - distance => point - up * above,
                _ => {
                    let on = nearest.place(mesh);
                    on + (point - on) * (radius / distance)
                }
            }
        })
        .collect();
    // Where places at the radius come near to others, moved vertices may get past each other, and go back to their edges of the grid: these nowhere cross.
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

/// Sorts blocks, each once.
fn once(blocks: &mut Vec<[usize; 3]>) {
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
        let plate = round(&triangle(), (radius, 3.0), None, &Progress::none()).unwrap();
        let edges = plate.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert_eq!(plate.crossings(|| Progress::none().check()).unwrap(), Vec::<[u32; 2]>::new());
        // Steiner's formula: area times height, half a cylinder along the border, and a ball.
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
        let plate = round(&triangle(), (1.0, 3.0), Some(floor), &Progress::none()).unwrap();
        let edges = plate.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        let lowest = plate.positions().iter().map(|at| at.z).fold(f64::INFINITY, f64::min);
        assert!((-0.4..-0.39).contains(&lowest), "{lowest}");
    }
}
