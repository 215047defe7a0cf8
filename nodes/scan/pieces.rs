//! Connected components of a scan.

use std::collections::BTreeMap;

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{Carry, Context, Error, In, Node, Transfer, bail};
use maquette_value::parallel::UntilStopped;
use maquette_value::{Mesh, RangeImage};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::scan::{Scan, has_point};

/// Keeps some of the connected pieces of a scan, such as the largest one.
///
/// Faces of a mesh are connected if they share a vertex. Neighboring cells of a range image are connected if their points are at most `gap`
/// apart, and so are any two points of a point cloud.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Pieces {
    /// Scan to divide into pieces: a mesh, points or a range image.
    pub mesh: In<Scan>,
    /// Pieces to keep.
    #[serde(default)]
    pub keep: Keep,
    /// Maximum distance of connected points or cells. Not used for meshes.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "default_gap")]
    pub gap: f64,
}

/// A selection of pieces. The size of a piece is its area for a mesh, and its number of points otherwise. Of two pieces of equal size the
/// first one counts as larger.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Keep {
    /// The largest pieces.
    Largest {
        /// The number of pieces.
        #[schemars(range(min = 1))]
        #[serde(default = "default_count")]
        count: u32,
    },
    /// The piece of this rank by size.
    Rank(
        /// The rank; 1 is the largest piece.
        #[schemars(range(min = 1))]
        u32,
    ),
    /// All pieces of a minimum size.
    Share {
        /// The minimum size, as a fraction of the size of the largest piece.
        #[schemars(range(min = 0.0, max = 1.0))]
        least: f64,
    },
    /// The pieces nearest to a point.
    Nearest {
        /// The point.
        #[schemars(extend("unit" = "mm"))]
        to: [f64; 3],
        /// The number of pieces.
        #[schemars(range(min = 1))]
        #[serde(default = "default_count")]
        count: u32,
    },
}

impl Default for Keep {
    fn default() -> Self {
        Self::Largest { count: 1 }
    }
}

fn default_count() -> u32 {
    1
}

fn default_gap() -> f64 {
    10.0
}

impl Node for Pieces {
    type Outputs = (Scan,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).and_cells(Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        if scan.count() == 0 {
            cx.warn("the scan is empty: it has no pieces");
            return Ok((scan.clone(),));
        }
        let visits = VISITS_PER_ELEMENT * scan.count();
        Ok((cx.progress().metered(visits, || pieces(&scan, &self.keep, self.gap))?,))
    }
}

/// The number of times that loops visit each face, point or cell; for progress.
const VISITS_PER_ELEMENT: usize = 5;

/// A connected piece of a scan.
struct Piece {
    size: f64,
    /// The distance of the piece from the point given by [`Keep::Nearest`], in mm.
    distance: f64,
}

/// Returns the pieces of a scan that `keep` selects. Connected points or cells are at most `gap` mm apart.
///
/// # Errors
/// If there is no piece of the given rank.
pub fn pieces(scan: &Scan, keep: &Keep, gap: f64) -> Result<Scan, Error> {
    let positions = scan.positions();
    let mut sets = UnionFind::new(positions.len());
    match scan {
        Scan::RangeImage(range) => connect_cells(range, gap, &mut sets),
        Scan::Points(_) => connect_points(positions, gap, &mut sets),
        Scan::Mesh(mesh) => connect_corners(mesh, &mut sets),
    }
    let (piece_of, firsts) = sets.into_labels();
    let mut all =
        firsts.iter().map(|_| Piece { size: 0.0, distance: f64::INFINITY }).collect::<Vec<_>>();
    match scan {
        Scan::Mesh(mesh) => {
            for face in mesh.faces().iter() {
                all[piece_of[face[0] as usize] as usize].size += mesh.area_vector(face).norm();
            }
        }
        _ => {
            let there = positions.iter().zip(&piece_of).filter(|(position, _)| has_point(position));
            there.for_each(|(_, &piece)| all[piece as usize].size += 1.0);
        }
    }
    if let Keep::Nearest { to, .. } = keep {
        let to = Point3::from(*to);
        for (position, &piece) in
            positions.iter().zip(&piece_of).filter(|(position, _)| has_point(position))
        {
            let distance = &mut all[piece as usize].distance;
            *distance = distance.min((position - to).norm());
        }
    }
    // Leave out pieces of size 0: vertices without faces, and cells without a point.
    let mut order: Vec<_> = (0..all.len()).filter(|&piece| all[piece].size > 0.0).collect();
    order.sort_by(|&a, &b| all[b].size.total_cmp(&all[a].size));
    match *keep {
        Keep::Largest { count } => order.truncate(count as usize),
        Keep::Rank(rank) => {
            let Some(&piece) = (rank as usize).checked_sub(1).and_then(|index| order.get(index))
            else {
                let are = match order.len() {
                    1 => "is 1".to_owned(),
                    count => format!("are {count}"),
                };
                bail!("there is no piece of rank {rank}: there {are}");
            };
            order = vec![piece];
        }
        Keep::Share { least } => {
            let least = order.first().map_or(0.0, |&largest| least * all[largest].size);
            order.retain(|&piece| all[piece].size >= least);
        }
        Keep::Nearest { count, .. } => {
            order.sort_by(|&a, &b| all[a].distance.total_cmp(&all[b].distance));
            order.truncate(count as usize);
        }
    }
    let mut is_kept = vec![false; all.len()];
    order.into_iter().for_each(|piece| is_kept[piece] = true);
    let kept: Vec<_> = piece_of.iter().map(|&piece| is_kept[piece as usize]).collect();
    Ok(scan.select(&kept))
}

/// Connects neighboring cells in each row and column whose points are at most `gap` apart.
fn connect_cells(range: &RangeImage, gap: f64, sets: &mut UnionFind) {
    let (width, points) = (range.width(), range.points());
    for cell in 0..points.len() {
        let right = (cell % width + 1 < width).then_some(cell + 1);
        let below = Some(cell + width).filter(|&below| below < points.len());
        for other in right.into_iter().chain(below) {
            // If a cell has no point, the distance is NaN, and the comparison is false.
            if (points[cell] - points[other]).norm() <= gap {
                sets.union(cell as u32, other as u32);
            }
        }
    }
}

/// Connects points that are at most `gap` apart.
///
/// Points are sorted into cubes whose diagonal is `gap`, so all points in one cube are connected. Two cubes are connected if a point in one
/// cube and a point in the other cube are at most `gap` apart. Pairs of cubes that are already connected are skipped.
fn connect_points(points: &[Point3<f64>], gap: f64, sets: &mut UnionFind) {
    let side = gap / 3_f64.sqrt();
    let mut cubes: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    for (number, point) in (0..).zip(points).until_stopped() {
        let cube = [0, 1, 2].map(|axis| (point[axis] / side).floor() as i64);
        cubes.entry(cube).or_default().push(number);
    }
    // Visit only half of the neighboring cubes from this cube; the pairs with the other half are visited from those cubes.
    let around = (0..125).map(|k| [k / 25 - 2, k / 5 % 5 - 2, k % 5 - 2]);
    let around: Vec<_> = around.filter(|step| *step > [0, 0, 0]).collect();
    for (cube, here) in cubes.iter().until_stopped() {
        here.iter().for_each(|&other| sets.union(here[0], other));
        for step in &around {
            let Some(there) =
                cubes.get(&[0, 1, 2].map(|axis| cube[axis].saturating_add(step[axis])))
            else {
                continue;
            };
            if sets.find(here[0]) == sets.find(there[0]) {
                continue;
            }
            let is_connected = here.iter().map(|&a| points[a as usize]).any(|a| {
                there.iter().any(|&b| (a - points[b as usize]).norm_squared() <= gap * gap)
            });
            if is_connected {
                sets.union(here[0], there[0]);
            }
        }
    }
}

/// Puts all corners of each face into one set.
fn connect_corners(mesh: &Mesh, sets: &mut UnionFind) {
    for face in mesh.faces().iter() {
        face[1..].iter().for_each(|&vertex| sets.union(face[0], vertex));
    }
}
