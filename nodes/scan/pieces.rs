//! Parts that hang together.

use std::collections::BTreeMap;

use maquette_base::topology::union_find::UnionFind;
use maquette_node::{Carry, Context, Error, Fate, In, Node};
use maquette_value::{Mesh, RangeImage};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::scan::{Scan, is_there};

/// Keeps some of the pieces that a scan falls apart into, such as the largest one.
///
/// Faces of a mesh hang together by their corners, whatever `gap` is. Neighboring cells of a range image hang together if their points are
/// not farther apart than `gap`, and so do any two points of a cloud.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Pieces {
    /// What falls apart: a mesh, points or a range image.
    pub mesh: In<Scan>,
    /// Which pieces stay.
    #[serde(default)]
    pub keep: Keep,
    /// How far neighbors of one piece may be apart, of points and range images.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "ten")]
    pub gap: f64,
}

/// Which pieces stay. The size of a piece is its area if it is one of a mesh, and the number of its points otherwise; of two of the same
/// size the one that comes first is the larger.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Keep {
    /// The largest ones.
    Largest {
        /// How many of them.
        #[schemars(range(min = 1))]
        #[serde(default = "one")]
        count: u32,
    },
    /// The one of this rank by size.
    Rank(
        /// 1 is the largest.
        #[schemars(range(min = 1))]
        u32,
    ),
    /// Those that are not small.
    Share {
        /// Their size at least, as a share of the largest one's.
        #[schemars(range(min = 0.0, max = 1.0))]
        least: f64,
    },
    /// Those that come nearest to a place.
    Nearest {
        /// The place.
        #[schemars(extend("unit" = "mm"))]
        to: [f64; 3],
        /// How many of them.
        #[schemars(range(min = 1))]
        #[serde(default = "one")]
        count: u32,
    },
}

impl Default for Keep {
    fn default() -> Self {
        Self::Largest { count: 1 }
    }
}

fn one() -> u32 {
    1
}

fn ten() -> f64 {
    10.0
}

/// Why there is no such piece.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PiecesError {
    /// The rank is too high.
    #[error("there is no piece of rank {rank}: there {are}")]
    Rank {
        /// The rank.
        rank: u32,
        /// How many there are, in words.
        are: String,
    },
}

impl Node for Pieces {
    type Outputs = (Scan,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const CARRIES: &'static [Carry] =
        &[Carry::all("mesh", "mesh", Fate::Kept).and_cells(Fate::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        if scan.count() == 0 {
            cx.warn("there is nothing that could fall apart");
            return Ok((scan.clone(),));
        }
        Ok((pieces(&scan, &self.keep, self.gap)?,))
    }
}

/// A piece.
struct Piece {
    size: f64,
    /// How far away it is from the place that counts.
    distance: f64,
}

/// Those pieces of a scan that `keep` says; neighbors of one piece are at most `gap` mm apart.
///
/// # Errors
/// There is no piece of the rank.
pub fn pieces(scan: &Scan, keep: &Keep, gap: f64) -> Result<Scan, PiecesError> {
    let places = scan.places();
    let mut sets = UnionFind::new(places.len());
    match scan {
        Scan::RangeImage(range) => join_cells(range, gap, &mut sets),
        Scan::Points(_) => join_points(places, gap, &mut sets),
        Scan::Mesh(mesh) => join_corners(mesh, &mut sets),
    }
    let (of_places, firsts) = sets.numbered();
    let mut all =
        firsts.iter().map(|_| Piece { size: 0.0, distance: f64::INFINITY }).collect::<Vec<_>>();
    match scan {
        Scan::Mesh(mesh) => {
            for face in mesh.faces().iter() {
                all[of_places[face[0] as usize] as usize].size += mesh.area_vector(face).norm();
            }
        }
        _ => {
            let there = places.iter().zip(&of_places).filter(|(place, _)| is_there(place));
            there.for_each(|(_, &piece)| all[piece as usize].size += 1.0);
        }
    }
    if let Keep::Nearest { to, .. } = keep {
        let to = Point3::from(*to);
        for (place, &piece) in places.iter().zip(&of_places).filter(|(place, _)| is_there(place)) {
            let distance = &mut all[piece as usize].distance;
            *distance = distance.min((place - to).norm());
        }
    }
    // Vertices without a face and cells without a point are no pieces.
    let mut order: Vec<_> = (0..all.len()).filter(|&piece| all[piece].size > 0.0).collect();
    order.sort_by(|&a, &b| all[b].size.total_cmp(&all[a].size));
    match *keep {
        Keep::Largest { count } => order.truncate(count as usize),
        Keep::Rank(rank) => {
            let Some(&piece) = (rank as usize).checked_sub(1).and_then(|place| order.get(place))
            else {
                let are = match order.len() {
                    1 => "is 1".into(),
                    count => format!("are {count}"),
                };
                return Err(PiecesError::Rank { rank, are });
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
    let kept: Vec<_> = of_places.iter().map(|&piece| is_kept[piece as usize]).collect();
    Ok(scan.only(&kept))
}

/// Joins cells that share a side.
fn join_cells(range: &RangeImage, gap: f64, sets: &mut UnionFind) {
    let (width, points) = (range.width(), range.points());
    for cell in 0..points.len() {
        let right = (cell % width + 1 < width).then_some(cell + 1);
        let below = Some(cell + width).filter(|&below| below < points.len());
        for other in right.into_iter().chain(below) {
            // A distance to nowhere is not a number.
            if (points[cell] - points[other]).norm() <= gap {
                sets.join(cell as u32, other as u32);
            }
        }
    }
}

/// Joins points that are near to each other.
///
/// Points are sorted into cubes whose diagonal is the gap, so that those of one cube hang together; two cubes do if any two of their points
/// do, which needs no look if they hang together already.
fn join_points(points: &[Point3<f64>], gap: f64, sets: &mut UnionFind) {
    let side = gap / 3_f64.sqrt();
    let mut cubes: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
    for (number, point) in (0..).zip(points) {
        let cube = [0, 1, 2].map(|axis| (point[axis] / side).floor() as i64);
        cubes.entry(cube).or_default().push(number);
    }
    // Half of the neighbors: the others find this cube.
    let around = (0..125).map(|k| [k / 25 - 2, k / 5 % 5 - 2, k % 5 - 2]);
    let around: Vec<_> = around.filter(|step| *step > [0, 0, 0]).collect();
    for (cube, here) in &cubes {
        here.iter().for_each(|&other| sets.join(here[0], other));
        for step in &around {
            let Some(there) =
                cubes.get(&[0, 1, 2].map(|axis| cube[axis].saturating_add(step[axis])))
            else {
                continue;
            };
            if sets.first(here[0]) == sets.first(there[0]) {
                continue;
            }
            fn is_near(&a: &u32, &b: &u32, gap: f64, points: &[Point3<f64>]) -> bool {
                (points[a as usize] - points[b as usize]).norm_squared() <= gap * gap
            }
            if here.iter().any(|a| there.iter().any(|b| is_near(a, b, gap, points))) {
                sets.join(here[0], there[0]);
            }
        }
    }
}

/// Joins the corners of each face.
fn join_corners(mesh: &Mesh, sets: &mut UnionFind) {
    for face in mesh.faces().iter() {
        face[1..].iter().for_each(|&vertex| sets.join(face[0], vertex));
    }
}
