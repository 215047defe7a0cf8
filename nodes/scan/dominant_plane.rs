//! The plane on which an object stands.

use std::collections::{BTreeMap, BTreeSet};

use maquette::value::{Faces, Mesh};
use maquette::{Carry, Context, Error, Fate, In, Node};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::hull::Hull;
use super::plane::Plane;
use super::scan::{Scan, is_there};

/// Finds the plane with the most points, such as a table or a wall, and what stands on it.
///
/// Its upper side is the one that the sensor saw; of points and of meshes that no capture gave, the one that has more above it. What stands
/// on it is what lies above it by more than `distance`, up to `height`, and not beside it: straight over the convex hull of the largest part
/// of the plane that hangs together. Of a mesh a face stands on it if all of its corners do.
///
/// Planes through three points each are tried, the same ones each time: Fischler and Bolles, "Random sample consensus" (1981), judged as in
/// Torr and Zisserman, "MLESAC" (2000), by the squares of distances up to `distance`. The best one is then fitted to all points near to it.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct DominantPlane {
    /// The scan: a range image, points or a mesh.
    pub mesh: In<Scan>,
    /// How far off the plane a point of it may be, because of noise.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "five")]
    pub distance: f64,
    /// Which plane: 1 is the one with the most points, 2 the one with the most of the others.
    #[schemars(range(min = 1, max = 8))]
    #[serde(default = "one")]
    pub rank: u32,
    /// What is higher than this above the plane does not stand on it.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default = "thousand")]
    pub height: f64,
    /// How far from the rim of the plane things may begin: what is nearer to it is left out, such as a wall behind a table.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub inset: f64,
}

fn five() -> f64 {
    5.0
}

fn one() -> u32 {
    1
}

fn thousand() -> f64 {
    1000.0
}

/// Why there is no plane.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum DominantPlaneError {
    /// There are too few points, or all lie on a line.
    #[error("there is no plane of rank {rank}: {points} points are left, which lie on no plane")]
    None {
        /// The rank.
        rank: u32,
        /// How many points there are beside those on planes before it.
        points: usize,
    },
}

impl Node for DominantPlane {
    type Outputs = (Scan, Mesh);
    const OUTPUTS: [&'static str; 2] = ["above", "plane"];

    const CARRIES: &'static [Carry] = &[
        Carry::all("mesh", "above", Fate::Kept).and_cells(Fate::Kept),
        Carry::all("mesh", "plane", Fate::Dropped).and_cells(Fate::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        let found = dominant_plane(&scan, self.distance, self.rank)?;
        let share = found.on.iter().filter(|on| **on).count() as f64
            / scan.places().iter().filter(|place| is_there(place)).count() as f64;
        if share < 0.05 {
            cx.warn(format!(
                "only {:.1} % of the {} lie on the plane",
                100.0 * share,
                scan.elements()
            ));
        }
        let above = scan.only(&found.above(&scan, self.distance, self.height, self.inset));
        if above.count() == 0 {
            cx.warn("nothing stands on the plane");
        }
        Ok((above, found.mesh(&scan)))
    }
}

/// A plane in a scan.
pub struct Found {
    /// The plane, its upper side towards the sensor.
    pub plane: Plane,
    /// Whether each place of the scan is on it.
    pub on: Vec<bool>,
    /// The largest part of it that hangs together, in its own axes.
    hull: Hull,
}

/// So many planes are tried.
const TRIES: usize = 2000;
/// By so many points they are judged.
const JUDGES: usize = 4000;

/// The plane of this rank in a scan, by points up to `distance` mm off it.
///
/// # Errors
/// There is none.
pub fn dominant_plane(scan: &Scan, distance: f64, rank: u32) -> Result<Found, DominantPlaneError> {
    let places = scan.places();
    let mut left = Vec::from_iter((0..places.len()).filter(|&place| is_there(&places[place])));
    let mut found = None;
    for rank in 1..=rank {
        if let Some(plane) = found {
            left.retain(|&place| !is_on(&plane, &places[place], distance));
        }
        let points = Vec::from_iter(left.iter().map(|&place| places[place]));
        let none = DominantPlaneError::None { rank, points: points.len() };
        found = Some(best(&points, distance).ok_or(none)?);
    }
    let mut plane = found.expect("there is a first rank");
    if is_upside_down(&plane, scan, distance) {
        plane = plane.turned();
    }
    let mut on = vec![false; places.len()];
    left.iter().for_each(|&place| on[place] = is_on(&plane, &places[place], distance));
    let flat = places.iter().zip(&on).filter(|(_, on)| **on).map(|(place, _)| flat(&plane, place));
    let hull = Hull::of(largest_part(&Vec::from_iter(flat), distance));
    Ok(Found { plane, on, hull })
}

fn is_on(plane: &Plane, place: &Point3<f64>, distance: f64) -> bool {
    plane.height(place).abs() <= distance
}

/// A place in the plane's own axes.
fn flat(plane: &Plane, place: &Point3<f64>) -> [f64; 2] {
    plane.axes().map(|axis| axis.dot(&place.coords))
}

/// Whether its upper side is turned away from the sensor, or from most of what is not on it.
fn is_upside_down(plane: &Plane, scan: &Scan, distance: f64) -> bool {
    if scan.is_seen_from_origin() {
        return plane.height(&Point3::origin()) < 0.0;
    }
    let heights = scan.places().iter().map(|place| plane.height(place));
    let (above, below) = heights.fold((0, 0), |(above, below), height| {
        (above + usize::from(height > distance), below + usize::from(height < -distance))
    });
    above < below
}

/// The plane with the most points.
fn best(points: &[Point3<f64>], distance: f64) -> Option<Plane> {
    let step = points.len().div_ceil(JUDGES).max(1);
    let judges = Vec::from_iter(points.iter().step_by(step));
    let mut random = Random(1);
    let tried = (0..TRIES).filter_map(|_| {
        let [a, b, c] = [(); 3].map(|()| points.get(random.below(points.len())));
        let (a, b, c) = (a?, b?, c?);
        let plane = Plane::through(*a, (b - a).cross(&(c - a)))?;
        let miss = |point: &&Point3<f64>| {
            let height = plane.height(point) / distance;
            f64::min(height * height, 1.0)
        };
        Some((judges.iter().map(miss).sum::<f64>(), plane))
    });
    let (_, mut plane) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // What is near to the fitted plane is not quite what was near before.
    for _ in 0..5 {
        let near = points.iter().filter(|point| is_on(&plane, point, distance)).copied();
        plane = Plane::nearest(&Vec::from_iter(near))?;
    }
    Some(plane)
}

/// Numbers that look random and are the same each time: Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014).
struct Random(u64);

impl Random {
    /// A number below `count`; 0 if that is 0.
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((u128::from(mixed ^ (mixed >> 31)) * count as u128) >> 64) as usize
    }
}

/// Those points of a plane that hang together with the most others, by squares that are a hundredth as long as all, but no less than four
/// times as long as `distance`.
fn largest_part(points: &[[f64; 2]], distance: f64) -> Vec<[f64; 2]> {
    let ends = |axis: usize| {
        let along = points.iter().map(|point| point[axis]);
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), x| {
            (least.min(x), most.max(x))
        })
    };
    let [(left, right), (bottom, top)] = [ends(0), ends(1)];
    let side = f64::max(4.0 * distance, 0.01 * f64::max(right - left, top - bottom));
    let square =
        |point: &[f64; 2]| [((point[0] - left) / side) as i64, ((point[1] - bottom) / side) as i64];
    let mut squares: BTreeMap<[i64; 2], usize> = BTreeMap::new();
    for point in points {
        *squares.entry(square(point)).or_default() += 1;
    }
    let mut seen = BTreeSet::new();
    let mut largest = (0, BTreeSet::new());
    for &first in squares.keys() {
        let (mut part, mut open, mut count) = (BTreeSet::new(), vec![first], 0);
        while let Some(at) = open.pop() {
            let Some(points) = squares.get(&at).filter(|_| seen.insert(at)) else { continue };
            count += points;
            part.insert(at);
            open.extend((0..9).map(|k| [at[0] + k % 3 - 1, at[1] + k / 3 - 1]));
        }
        if count > largest.0 {
            largest = (count, part);
        }
    }
    points.iter().filter(|point| largest.1.contains(&square(point))).copied().collect()
}

impl Found {
    /// Whether each place of the scan stands on it: more than `distance` above it, up to `height`, and not nearer to its rim than `inset`.
    pub fn above(&self, scan: &Scan, distance: f64, height: f64, inset: f64) -> Vec<bool> {
        let is_above = |place: &Point3<f64>| {
            let at = self.plane.height(place);
            distance < at && at <= height && self.hull.contains(flat(&self.plane, place), inset)
        };
        scan.places().iter().map(is_above).collect()
    }

    /// A rectangle on it around its largest part, its face looking up, in the axes of the scan.
    pub fn mesh(&self, scan: &Scan) -> Mesh {
        let [first, second] = self.plane.axes();
        let foot = self.plane.normal.into_inner() * self.plane.offset;
        let corner = |at: [f64; 2]| Point3::from(foot + first * at[0] + second * at[1]);
        let corners = self.hull.rectangle().map(corner).to_vec();
        let faces = Faces::uniform(4, vec![0, 1, 2, 3]).expect("a face of four corners");
        let mesh = Mesh::new(corners, faces).expect("four corners");
        let frame = match scan {
            Scan::RangeImage(range) => range.capture_frame().ok(),
            Scan::Mesh(mesh) => mesh.frame().copied(),
            Scan::Points(_) => None,
        };
        mesh.with_frame(frame)
    }
}

#[cfg(test)]
mod tests {
    use maquette::value::Points;

    use super::*;

    /// A table of 400 x 200 mm on which a box stands, a wall beside it, and its floor below.
    fn room() -> Scan {
        let mut points = Vec::new();
        let mut random = Random(7);
        let mut noise = || random.below(1000) as f64 / 500.0 - 1.0;
        for k in 0..20_000 {
            let (x, y) = (f64::from(k % 200) * 2.0, f64::from(k / 200) * 2.0);
            points.push(Point3::new(x, y, noise()));
        }
        for k in 0..2_000 {
            let (x, y) = (f64::from(k % 50), f64::from(k / 50));
            points.push(Point3::new(150.0 + x, 80.0 + y, 50.0 + noise()));
            points.push(Point3::new(-40.0 + noise(), 4.0 * y, 4.0 * x));
            points.push(Point3::new(8.0 * x, 300.0 + 4.0 * y, -600.0 + noise()));
        }
        Scan::Points(Points::new(points).unwrap())
    }

    #[test]
    fn what_stands_on_a_table_is_neither_the_wall_nor_the_floor() {
        let scan = room();
        let found = dominant_plane(&scan, 5.0, 1).unwrap();
        assert!((found.plane.normal.z - 1.0).abs() < 1e-6, "{:?}", found.plane);
        assert!(found.plane.offset.abs() < 0.05);
        let above = found.above(&scan, 5.0, 1000.0, 0.0);
        assert_eq!(above.iter().filter(|above| **above).count(), 2_000);
        let mesh = found.mesh(&scan);
        assert!((mesh.area_vector(mesh.faces().face(0)).z - 398.0 * 198.0).abs() < 400.0);
    }

    #[test]
    fn the_next_planes_have_the_most_of_the_other_points() {
        let normal = |rank| dominant_plane(&room(), 5.0, rank).unwrap().plane.normal;
        let others = [normal(2), normal(3), normal(4)];
        assert_eq!(others.iter().filter(|normal| normal.x.abs() > 0.99).count(), 1);
        assert_eq!(others.iter().filter(|normal| normal.z.abs() > 0.99).count(), 2);
    }

    #[test]
    fn points_on_a_line_and_no_points_have_no_plane() {
        let line = (0..100).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect::<Vec<_>>();
        for points in [line, Vec::new()] {
            let count = points.len();
            let scan = Scan::Points(Points::new(points).unwrap());
            let error = dominant_plane(&scan, 5.0, 1).err();
            assert_eq!(error, Some(DominantPlaneError::None { rank: 1, points: count }));
        }
    }
}
