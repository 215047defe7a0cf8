//! Thickens the walls of a solid that are thinner than requested.

use maquette_node::{Error, Progress};
use maquette_value::parallel::*;
use maquette_value::{Backing, Faces, Mesh, MeshError, TriangleTree};
use nalgebra::{Point3, Vector3};

use crate::combine::boolean;
use crate::offset::{Clip, Floor, offset_surface};
use crate::operation::Operation;
use crate::transfer_attributes::transfer_attributes;

/// Maximum number of rounds. In each round, material is added to the walls that are still too thin.
const PASSES: usize = 3;

/// Factor by which the added thickness is multiplied. Without this factor, walls would be thinner than requested, because the added volume
/// has flat faces instead of curved ones.
const THICKNESS_FACTOR: f64 = 1.1;

/// Thickens the walls of a solid to at least `thickness` mm, measured straight inward from the center of each face. Returns the thickened
/// solid, and the walls that are still thinner than requested.
///
/// Where a wall is too thin, the volume within half of `thickness` of the wall's middle surface is united with the solid. The wall
/// therefore grows equally on both sides; where the wall is just thick enough, it does not grow. Nothing grows through the floor.
pub(crate) fn thicken(
    solid: &Mesh,
    thickness: f64,
    floor: Option<Floor>,
    progress: &Progress<'_>,
) -> Result<(Mesh, Option<ThinWalls>), Error> {
    let mut made = solid.clone();
    let mut passes = 0..PASSES;
    loop {
        let tree = TriangleTree::new(&made);
        let thin = thin(&made, &tree, thickness);
        let pass = passes.next().filter(|_| !thin.is_empty());
        let Some(pass) = pass else {
            let left = ThinWalls::new(&made, &thin);
            return Ok((made, left));
        };
        fn share(part: f64, pass: usize) -> f64 {
            (pass as f64 + part) / PASSES as f64
        }
        let middle = middle_surface(&made, &tree, &thin, (thickness, floor))?;
        let added = progress.part(share(0.0, pass)..share(0.7, pass), |progress| {
            let clip = floor.map_or(Clip::Nothing, Clip::Floor);
            offset_surface(&middle, (THICKNESS_FACTOR * thickness / 2.0, 3.0), clip, progress)
        })?;
        let added = transfer_attributes(&made, &tree, added)?.with_frame(made.frame().copied());
        made = progress.part(share(0.7, pass)..share(1.0, pass), |progress| {
            boolean(&made, &[&added], Operation::Union, progress)
        })?;
    }
}

/// The walls of a solid that are thinner than requested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinWalls {
    /// The number of faces with a thin wall behind them.
    pub count: usize,
    /// The face with the thinnest wall behind it.
    pub face: usize,
    /// The middle of that face.
    pub at: Point3<f64>,
    /// The thickness of that wall in mm.
    pub thickness: f64,
}

impl ThinWalls {
    /// Returns the walls of the given faces of a mesh, each with its thickness; `None` if there are no faces.
    pub(crate) fn new(mesh: &Mesh, thin: &[(usize, f64)]) -> Option<Self> {
        let &(face, thickness) = thin.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let at = mesh.first_triangle_center(mesh.faces().face(face));
        Some(Self { count: thin.len(), face, at, thickness })
    }

    /// Returns the warning that walls are still thinner than `asked` mm.
    pub(crate) fn warning(&self, asked: f64) -> String {
        let Self { count, face, at, thickness } = self;
        let [faces, them] = if *count == 1 { ["face has", "it"] } else { ["faces have", "them"] };
        format!(
            "{count} {faces} still a wall of less than {asked} mm behind {them}; the thinnest, {thickness:.3} mm, is behind face {face} at ({:.3}, {:.3}, {:.3}); add `Printable(thickness: ..)` to `expect` to see all positions",
            at.x, at.y, at.z
        )
    }
}

/// Returns the indices of the faces at which the wall is thinner than `thickness` mm, each with the thickness of the wall there.
pub(crate) fn thin(mesh: &Mesh, tree: &TriangleTree, thickness: f64) -> Vec<(usize, f64)> {
    let behind = mesh.backings(tree).into_iter().enumerate();
    let thin = behind.filter_map(|(face, behind)| match behind {
        Backing::Wall(distance) if distance < thickness * (1.0 - 1e-9) => Some((face, distance)),
        _ => None,
    });
    thin.collect()
}

/// Returns the middle surface of the given thin walls: each face is moved inward, at each corner by half of the wall's thickness there.
/// Points too close to the floor are raised.
pub(crate) fn middle_surface(
    mesh: &Mesh,
    tree: &TriangleTree,
    thin: &[(usize, f64)],
    (thickness, floor): (f64, Option<Floor>),
) -> Result<Mesh, MeshError> {
    let places: Vec<Vec<Point3<f64>>> = thin
        .par_iter()
        .map(|&(face, distance)| {
            let face = mesh.faces().face(face);
            let inward = -mesh.area_vector(face).normalize();
            let center = mesh.first_triangle_center(face);
            face.iter()
                .map(move |&vertex| {
                    let at = mesh.positions()[vertex as usize];
                    // The ray starts beside the corner: from the corner itself it would hit the adjacent faces.
                    let start = at + (center - at) * 0.01;
                    let hit = tree.first_hit(start + inward * (1e-6 * distance), inward);
                    let depth = hit.map_or(distance, |hit| hit.along).min(thickness);
                    let middle = start + inward * (depth / 2.0);
                    let lacks = floor.map_or(Vector3::zeros(), |floor| {
                        floor.up
                            * (THICKNESS_FACTOR * thickness / 2.0 - floor.height_above(&middle))
                                .max(0.0)
                    });
                    middle + lacks
                })
                .collect::<Vec<_>>()
        })
        .collect();
    let sides: Vec<_> = places.iter().map(Vec::len).collect();
    let places = places.concat();
    let corners: Vec<_> = (0..places.len() as u32).collect();
    Mesh::new(places, Faces::polygons(&sides, corners)?)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Returns a box with one corner at the origin, each side divided into n x n cells of two triangles.
    pub(crate) fn cuboid(size: [f64; 3], n: u32) -> Mesh {
        let mut numbers = std::collections::HashMap::new();
        let (mut places, mut triangles) = (Vec::new(), Vec::new());
        for axis in 0..3 {
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
            for (end, i, j) in (0..2 * n * n).map(|k| (k / (n * n), k % n, k / n % n)) {
                let mut vertex = |i: u32, j: u32| {
                    let mut at = [0; 3];
                    (at[axis], at[u], at[v]) = (end * n, i, j);
                    *numbers.entry(at).or_insert_with(|| {
                        fn share(k: usize, at: [u32; 3], n: u32, size: [f64; 3]) -> f64 {
                            f64::from(at[k]) / f64::from(n) * size[k]
                        }
                        places.push(Point3::new(
                            share(0, at, n, size),
                            share(1, at, n, size),
                            share(2, at, n, size),
                        ));
                        places.len() as u32 - 1
                    })
                };
                let [a, b, c, d] =
                    [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[di, dj]| vertex(i + di, j + dj));
                triangles.extend(match end {
                    0 => [[a, c, b], [a, d, c]],
                    _ => [[a, b, c], [a, c, d]],
                });
            }
        }
        Mesh::new(places, Faces::triangles(triangles)).unwrap()
    }

    fn is_solid(mesh: &Mesh) -> bool {
        let edges = mesh.edges();
        edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2)
    }

    #[test]
    fn a_thin_plate_becomes_as_thick_as_asked() {
        let plate = cuboid([20.0, 12.0, 0.3], 12);
        let (thick, left) = thicken(&plate, 1.5, None, &Progress::silent()).unwrap();
        assert!(is_solid(&thick));
        assert_eq!(left, None);
        let (low, high) = thick.bounds().unwrap();
        assert!((1.5..1.7).contains(&(high.z - low.z)), "{low} {high}");
    }

    #[test]
    fn what_is_thick_enough_stays() {
        let block = cuboid([4.0, 6.0, 5.0], 3);
        assert_eq!(thicken(&block, 1.5, None, &Progress::silent()).unwrap(), (block, None));
    }

    #[test]
    fn a_fin_on_a_block_grows_and_the_block_does_not() {
        let block = cuboid([10.0; 3], 4);
        let fin = cuboid([0.4, 8.0, 8.0], 6);
        let up = Vector3::new(4.7, 1.1, 9.0);
        let fin = fin.with_positions(fin.positions().iter().map(|p| p + up).collect()).unwrap();
        let both = boolean(&block, &[&fin], Operation::Union, &Progress::silent()).unwrap();
        let (thick, left) = thicken(&both, 1.2, None, &Progress::silent()).unwrap();
        assert!(is_solid(&thick));
        assert_eq!(left, None);
        let corners = [Point3::origin(), Point3::new(10.0, 10.0, 0.0)];
        assert!(corners.iter().all(|corner| thick.positions().contains(corner)));
        let (low, high) = thick.bounds().unwrap();
        assert!(low.z == 0.0 && (17.0..17.8).contains(&high.z), "{low} {high}");
    }

    #[test]
    fn a_plate_on_a_floor_grows_upward() {
        let plate = cuboid([20.0, 12.0, 0.3], 12);
        let floor = Floor { up: Vector3::z(), height: 0.0 };
        let (thick, left) = thicken(&plate, 1.5, Some(floor), &Progress::silent()).unwrap();
        assert!(is_solid(&thick) && left.is_none());
        let (low, high) = thick.bounds().unwrap();
        assert!(low.z == 0.0 && (1.5..1.8).contains(&high.z), "{low} {high}");
    }
}
