//! The plane on which an object stands.

use std::collections::{BTreeMap, BTreeSet};

use maquette_node::{Carry, Context, Error, Fate, In, Node};
use maquette_value::random::Random;
use maquette_value::{Faces, Mesh};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::hull::Hull;
use super::plane::Plane;
use super::scan::{Scan, is_there};

/// Finds the plane with the most points, or of a mesh with the most area, such as a table or a wall, and what stands on it.
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
    /// Which plane: 1 is the one with the most points (of a mesh: with the most area), 2 the one with the most of the others.
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
        if found.share < 0.05 {
            let what = match &scan {
                Scan::Mesh(_) => "area lies",
                other => &format!("{} lie", other.elements()),
            };
            cx.warn(format!("only {:.1} % of the {what} on the plane", 100.0 * found.share));
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
    /// Which part of the points, or of a mesh's area, is on it, from 0 to 1.
    pub share: f64,
    /// The largest part of it that hangs together, in its own axes.
    hull: Hull,
}

/// So many planes are tried.
const TRIES: usize = 2000;
/// By so many points they are judged.
const JUDGES: usize = 4000;
/// At least so many points stand for the area of a mesh.
const SPREAD: usize = 20_000;

/// The plane of this rank in a scan, by points up to `distance` mm off it.
///
/// # Errors
/// There is none.
pub fn dominant_plane(scan: &Scan, distance: f64, rank: u32) -> Result<Found, DominantPlaneError> {
    let points = points_of(scan);
    let mut left = points.clone();
    let mut found = None;
    for rank in 1..=rank {
        if let Some(plane) = found {
            left.retain(|point| !is_on(&plane, point, distance));
        }
        let none = DominantPlaneError::None { rank, points: left.len() };
        found = Some(best(&left, distance).ok_or(none)?);
    }
    let mut plane = found.expect("there is a first rank");
    if is_upside_down(&plane, scan, &points, distance) {
        plane = plane.turned();
    }
    let on = left.iter().filter(|point| is_on(&plane, point, distance));
    let on: Vec<_> = on.map(|point| flat(&plane, point)).collect();
    let part = Part::largest(&on, distance);
    let places = scan.places().iter().filter(|place| is_on(&plane, place, distance));
    // Points inside of large faces do not reach to their rim.
    let rim = places.map(|place| flat(&plane, place));
    let hull = on.iter().copied().chain(rim).filter(|at| part.contains(at)).collect();
    let share = on.len() as f64 / points.len() as f64;
    Ok(Found { plane, share, hull: Hull::of(hull) })
}

/// The points of a scan; of a mesh with faces, points that are spread evenly over its area.
fn points_of(scan: &Scan) -> Vec<Point3<f64>> {
    let Scan::Mesh(mesh) = scan else { return there(scan) };
    // Faces as triangles, with the area up to the end of each.
    let mut total = 0.0;
    let triangles = mesh.faces().iter().flat_map(|face| {
        (2..face.len())
            .map(|k| [face[0], face[k - 1], face[k]].map(|v| mesh.positions()[v as usize]))
    });
    let triangles = triangles.map(|[a, b, c]| {
        total += 0.5 * (b - a).cross(&(c - a)).norm();
        (total, [a, b, c])
    });
    let triangles = Vec::from_iter(triangles);
    if total <= 0.0 || !total.is_finite() {
        return there(scan);
    }
    let count = SPREAD.max(mesh.positions().len());
    let mut random = Random(2);
    let mut at = 0;
    (0..count)
        .map(|k: usize| {
            let area = total * (k as f64 + 0.5) / count as f64;
            while triangles[at].0 < area && at + 1 < triangles.len() {
                at += 1;
            }
            let (_, [a, b, c]) = triangles[at];
            let [mut u, mut v] = [(); 2].map(|()| random.even());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            a + u * (b - a) + v * (c - a)
        })
        .collect()
}

/// The places of a scan that are somewhere.
fn there(scan: &Scan) -> Vec<Point3<f64>> {
    scan.places().iter().filter(|place| is_there(place)).copied().collect()
}

fn is_on(plane: &Plane, place: &Point3<f64>, distance: f64) -> bool {
    plane.height(place).abs() <= distance
}

/// A place in the plane's own axes.
fn flat(plane: &Plane, place: &Point3<f64>) -> [f64; 2] {
    plane.axes().map(|axis| axis.dot(&place.coords))
}

/// Whether its upper side is turned away from the sensor, or from most of what is not on it.
fn is_upside_down(plane: &Plane, scan: &Scan, points: &[Point3<f64>], distance: f64) -> bool {
    if scan.is_seen_from_origin() {
        return plane.height(&Point3::origin()) < 0.0;
    }
    let heights = points.iter().map(|point| plane.height(point));
    let (above, below) = heights.fold((0, 0), |(above, below), height| {
        (above + usize::from(height > distance), below + usize::from(height < -distance))
    });
    above < below
}

/// The plane with the most points.
fn best(points: &[Point3<f64>], distance: f64) -> Option<Plane> {
    let step = points.len().div_ceil(JUDGES).max(1);
    let judges: Vec<_> = points.iter().step_by(step).collect();
    if points.is_empty() {
        return None;
    }
    let mut random = Random(1);
    let tried = (0..TRIES).filter_map(|_| {
        let [a, b, c] = [(); 3].map(|()| points[random.below(points.len())]);
        let plane = Plane::through(a, (b - a).cross(&(c - a)))?;
        Some((
            judges
                .iter()
                .map(|point| {
                    let height = plane.height(point) / distance;
                    f64::min(height * height, 1.0)
                })
                .sum::<f64>(),
            plane,
        ))
    });
    let (_, mut plane) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // What is near to the fitted plane is not quite what was near before.
    for _ in 0..5 {
        let near = points.iter().filter(|point| is_on(&plane, point, distance)).copied();
        plane = Plane::nearest(&Vec::from_iter(near))?;
    }
    Some(plane)
}

/// The part of a plane on which the most points hang together, as squares.
struct Part {
    corner: [f64; 2],
    side: f64,
    squares: BTreeSet<[i64; 2]>,
}

impl Part {
    /// By squares that are a hundredth as long as all points, but no less than four times as long as `distance`.
    fn largest(points: &[[f64; 2]], distance: f64) -> Self {
        fn ends(axis: usize, points: &[[f64; 2]]) -> (f64, f64) {
            let along = points.iter().map(|point| point[axis]);
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), x| {
                (least.min(x), most.max(x))
            })
        }
        let [(left, right), (bottom, top)] = [ends(0, points), ends(1, points)];
        let side = f64::max(4.0 * distance, 0.01 * f64::max(right - left, top - bottom));
        let mut part = Self { corner: [left, bottom], side, squares: BTreeSet::new() };
        let mut counts: BTreeMap<[i64; 2], usize> = BTreeMap::new();
        for point in points {
            *counts.entry(part.square(point)).or_default() += 1;
        }
        let (mut seen, mut most) = (BTreeSet::new(), 0);
        for &first in counts.keys() {
            let (mut squares, mut open, mut count) = (BTreeSet::new(), vec![first], 0);
            while let Some(at) = open.pop() {
                let Some(points) = counts.get(&at).filter(|_| seen.insert(at)) else { continue };
                count += points;
                squares.insert(at);
                open.extend(around(at));
            }
            if count > most {
                (most, part.squares) = (count, squares);
            }
        }
        part
    }

    fn square(&self, at: &[f64; 2]) -> [i64; 2] {
        [0, 1].map(|axis| ((at[axis] - self.corner[axis]) / self.side).floor() as i64)
    }

    /// Whether a point hangs together with it.
    fn contains(&self, at: &[f64; 2]) -> bool {
        around(self.square(at)).any(|square| self.squares.contains(&square))
    }
}

/// A square and those that touch it.
fn around([x, y]: [i64; 2]) -> impl Iterator<Item = [i64; 2]> {
    (0..9).map(move |k| [x + k % 3 - 1, y + k / 3 - 1])
}

impl Found {
    /// Whether each place of the scan stands on it: more than `distance` above it, up to `height`, and not nearer to its rim than `inset`.
    pub fn above(&self, scan: &Scan, distance: f64, height: f64, inset: f64) -> Vec<bool> {
        scan.places()
            .iter()
            .map(|place| {
                let at = self.plane.height(place);
                distance < at && at <= height && self.hull.contains(flat(&self.plane, place), inset)
            })
            .collect()
    }

    /// A rectangle on it around its largest part, its face looking up, in the axes of the scan.
    pub fn mesh(&self, scan: &Scan) -> Mesh {
        let [first, second] = self.plane.axes();
        let foot = self.plane.normal.into_inner() * self.plane.offset;
        let corners = self
            .hull
            .rectangle()
            .map(|at: [f64; 2]| Point3::from(foot + first * at[0] + second * at[1]))
            .to_vec();
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
    use maquette_value::Points;
    use nalgebra::Vector3;

    use super::*;

    /// A table of 400 x 200 mm on which a box stands, a wall beside it, and its floor below.
    fn room() -> Scan {
        let mut points = Vec::new();
        let mut random = Random(7);
        fn noise(random: &mut Random) -> f64 {
            random.below(1000) as f64 / 500.0 - 1.0
        }
        for k in 0..20_000 {
            let (x, y) = (f64::from(k % 200) * 2.0, f64::from(k / 200) * 2.0);
            points.push(Point3::new(x, y, noise(&mut random)));
        }
        for k in 0..2_000 {
            let (x, y) = (f64::from(k % 50), f64::from(k / 50));
            points.push(Point3::new(150.0 + x, 80.0 + y, 50.0 + noise(&mut random)));
            points.push(Point3::new(-40.0 + noise(&mut random), 4.0 * y, 4.0 * x));
            points.push(Point3::new(8.0 * x, 300.0 + 4.0 * y, -600.0 + noise(&mut random)));
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
        fn normal(rank: u32) -> nalgebra::Unit<Vector3<f64>> {
            dominant_plane(&room(), 5.0, rank).unwrap().plane.normal
        }
        let others = [normal(2), normal(3), normal(4)];
        assert_eq!(others.iter().filter(|normal| normal.x.abs() > 0.99).count(), 1);
        assert_eq!(others.iter().filter(|normal| normal.z.abs() > 0.99).count(), 2);
    }

    type Triangles = (Vec<Point3<f64>>, Vec<[u32; 3]>);

    /// A triangle mesh of a square of this size, its lowest corner here, with so many steps along each side.
    fn sheet(size: f64, corner: [f64; 3], steps: u32) -> Triangles {
        let side = steps + 1;
        (
            (0..side * side)
                .map(|k: u32| {
                    let [x, y] =
                        [k % side, k / side].map(|k| size * f64::from(k) / f64::from(steps));
                    Point3::from(corner) + Vector3::new(x, y, 0.0)
                })
                .collect(),
            (0..steps * steps)
                .flat_map(|k: u32| {
                    let first = k % steps + side * (k / steps);
                    let [a, b, c, d] = [first, first + 1, first + side + 1, first + side];
                    [[a, b, c], [a, c, d]]
                })
                .collect(),
        )
    }

    fn mesh(parts: &[Triangles]) -> Scan {
        let (mut places, mut faces) = (Vec::new(), Vec::new());
        for (own, corners) in parts {
            let before = places.len() as u32;
            places.extend_from_slice(own);
            faces.extend(corners.iter().map(|face| face.map(|vertex| vertex + before)));
        }
        Scan::Mesh(Mesh::new(places, Faces::triangles(faces)).unwrap())
    }

    #[test]
    fn a_table_of_two_triangles_counts_by_its_area() {
        let scan = mesh(&[sheet(400.0, [0.0; 3], 1), sheet(40.0, [1.0, 1.0, 30.0], 50)]);
        let found = dominant_plane(&scan, 1.0, 1).unwrap();
        assert!(found.plane.offset.abs() < 1e-6 && found.plane.normal.z > 0.99);
        assert!(found.share > 0.98, "{}", found.share);
        // Straight above the whole of it, nearly to its rim.
        let above = found.above(&scan, 1.0, 100.0, 0.0);
        assert_eq!(above.iter().filter(|above| **above).count(), 51 * 51);
        let board = found.mesh(&scan);
        assert!((board.area_vector(board.faces().face(0)).z - 160_000.0).abs() < 1.0);
    }

    #[test]
    fn a_plane_through_edges_of_a_box_has_no_area() {
        let faces =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = Faces::uniform(4, faces.as_flattened().to_vec()).unwrap();
        let scan = Scan::Mesh(
            Mesh::new(
                (0..8)
                    .map(|k: u32| {
                        Point3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2))
                    })
                    .collect::<Vec<_>>(),
                faces,
            )
            .unwrap(),
        );
        let found = dominant_plane(&scan, 0.001, 1).unwrap();
        assert!(found.plane.normal.iter().any(|x| x.abs() > 1.0 - 1e-9), "{:?}", found.plane);
        assert!((found.share - 1.0 / 6.0).abs() < 0.01);
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
