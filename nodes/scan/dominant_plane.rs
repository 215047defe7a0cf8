//! Detection of the plane under an object.

use std::collections::{BTreeMap, BTreeSet};

use maquette_node::{Carry, Context, Error, In, Node, Transfer, bail};
use maquette_value::parallel::*;
use maquette_value::rng::Random;
use maquette_value::{Faces, Mesh};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::hull::Hull;
use super::plane::Plane;
use super::scan::{Scan, has_point};

/// Finds the plane with the most points (for a mesh: the most area), such as a table or a wall, and the objects on it.
///
/// The upper side of the plane faces the sensor. For points and for meshes without a capture it is the side with more points. The objects
/// on the plane are the points that are more than `distance` and at most `height` above it, and over the convex hull of the largest
/// connected part of the plane. A face of a mesh is kept if all of its corners are.
///
/// Candidates are planes through three points, chosen by a deterministic generator: Fischler and Bolles, "Random sample consensus" (1981).
/// Their score is the sum of the squared distances, each truncated at `distance`, as in Torr and Zisserman, "MLESAC" (2000). The best one
/// is then fitted to all points near it.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct DominantPlane {
    /// Scan: a range image, points or a mesh.
    pub mesh: In<Scan>,
    /// Maximum distance of a point of the plane from the plane, because of noise.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "default_distance")]
    pub distance: f64,
    /// Rank of the plane: 1 has the most points (for a mesh: the most area), 2 the most of the remaining ones.
    #[schemars(range(min = 1, max = 8))]
    #[serde(default = "default_rank")]
    pub rank: u32,
    /// Maximum height of objects above the plane.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default = "default_height")]
    pub height: f64,
    /// Minimum distance of objects from the rim of the plane, such as to exclude a wall at the edge of a table.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub inset: f64,
}

fn default_distance() -> f64 {
    5.0
}

fn default_rank() -> u32 {
    1
}

fn default_height() -> f64 {
    1000.0
}

impl Node for DominantPlane {
    type Outputs = (Scan, Mesh);
    const OUTPUTS: [&'static str; 2] = ["above", "plane"];

    const CARRIES: &'static [Carry] = &[
        Carry::uniform("mesh", "above", Transfer::Kept).and_cells(Transfer::Kept),
        Carry::uniform("mesh", "plane", Transfer::Dropped).and_cells(Transfer::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let scan = cx.get(&self.mesh);
        let visits = VISITS_PER_POSITION * scan.positions().len();
        let (distance, rank) = (self.distance, self.rank);
        let found = cx.progress().metered(visits, || dominant_plane(&scan, distance, rank))?;
        if found.fraction < 0.05 {
            let what = match &scan {
                Scan::Mesh(_) => "area is",
                other => &format!("{} are", other.elements()),
            };
            cx.warn(format!("only {:.1} % of the {what} on the plane", 100.0 * found.fraction));
        }
        let above =
            scan.select(&found.is_above_each(&scan, self.distance, self.height, self.inset));
        if above.count() == 0 {
            cx.warn("there is nothing on the plane");
        }
        Ok((above, found.to_rectangle(&scan)))
    }
}

/// A plane in a scan.
pub struct PlaneInScan {
    /// The plane. Its upper side faces the sensor.
    pub plane: Plane,
    /// The fraction of the points, or for a mesh of the area, that is on the plane, from 0 to 1.
    pub fraction: f64,
    /// The convex hull of the largest connected part of the plane, in the coordinates of [`Plane::axes`].
    hull: Hull,
}

/// The number of times that loops visit each position; for progress.
const VISITS_PER_POSITION: usize = 12;

/// The number of candidate planes that are tried.
const PLANE_CANDIDATES: usize = 2000;
/// The maximum number of points whose distances are used to score a candidate plane.
const SCORING_POINTS: usize = 4000;
/// The minimum number of sample points into which a mesh with faces is converted.
const MIN_MESH_SAMPLES: usize = 20_000;

/// Finds the plane of rank `rank` in a scan. A point belongs to the plane if it is at most `distance` mm away from it.
///
/// # Errors
/// Returns an error if the scan has fewer than `rank` planes.
pub fn dominant_plane(scan: &Scan, distance: f64, rank: u32) -> Result<PlaneInScan, Error> {
    let points = sample_points(scan);
    let mut left = points.clone();
    let mut found = None;
    for rank in 1..=rank {
        if let Some(plane) = found {
            left.retain(|point| !is_on(&plane, point, distance));
        }
        found = find_plane(&left, distance);
        if found.is_none() {
            bail!(
                "there is no plane of rank {rank}: the remaining {} points are too few or on a line; choose a smaller `rank` or `distance`",
                left.len()
            );
        }
    }
    let mut plane = found.expect("there is a first rank");
    if is_upside_down(&plane, scan, &points, distance) {
        plane = plane.flip();
    }
    let on = left.iter().until_stopped().filter(|point| is_on(&plane, point, distance));
    let on: Vec<_> = on.map(|point| coordinates_on_plane(&plane, point)).collect();
    let part = Part::largest(&on, distance);
    let positions = scan.positions().iter().until_stopped();
    let positions = positions.filter(|position| is_on(&plane, position, distance));
    // The sample points on large faces do not reach the border of the plane, so the vertices are added.
    let rim = positions.map(|position| coordinates_on_plane(&plane, position));
    let hull = on.iter().copied().chain(rim).filter(|at| part.contains(at)).collect();
    let share = on.len() as f64 / points.len() as f64;
    Ok(PlaneInScan { plane, fraction: share, hull: Hull::new(hull) })
}

/// Returns the points of a scan. For a mesh with faces, returns sample points that are distributed evenly over the area of the mesh.
fn sample_points(scan: &Scan) -> Vec<Point3<f64>> {
    let Scan::Mesh(mesh) = scan else { return valid_positions(scan) };
    // The triangles, each with the sum of its area and the areas of all previous triangles.
    let mut total = 0.0;
    let triangles = mesh.faces().iter().flat_map(|face| {
        (2..face.len())
            .map(|k| [face[0], face[k - 1], face[k]].map(|v| mesh.positions()[v as usize]))
    });
    let triangles = triangles.map(|[a, b, c]| {
        total += 0.5 * (b - a).cross(&(c - a)).norm();
        (total, [a, b, c])
    });
    let triangles = triangles.collect::<Vec<_>>();
    if total <= 0.0 || !total.is_finite() {
        return valid_positions(scan);
    }
    let count = MIN_MESH_SAMPLES.max(mesh.positions().len());
    let mut random = Random(2);
    let mut at = 0;
    (0..count)
        .until_stopped()
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

/// Returns the positions of a scan, without those of cells that have no point.
fn valid_positions(scan: &Scan) -> Vec<Point3<f64>> {
    scan.positions().iter().filter(|position| has_point(position)).copied().collect()
}

fn is_on(plane: &Plane, position: &Point3<f64>, distance: f64) -> bool {
    plane.height(position).abs() <= distance
}

/// Returns the two coordinates of a point along the axes of the plane, [`Plane::axes`].
fn coordinates_on_plane(plane: &Plane, position: &Point3<f64>) -> [f64; 2] {
    plane.axes().map(|axis| axis.dot(&position.coords))
}

/// Returns true if the upper side of the plane faces away from the sensor. If the sensor is unknown, returns true if the upper side faces
/// away from most of the points that are not on the plane.
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

/// Finds the plane with the most of the given points at most `distance` mm away. Returns `None` if no three points determine a plane.
fn find_plane(points: &[Point3<f64>], distance: f64) -> Option<Plane> {
    let step = points.len().div_ceil(SCORING_POINTS).max(1);
    let judges: Vec<_> = points.iter().step_by(step).collect();
    if points.is_empty() {
        return None;
    }
    let mut random = Random(1);
    let tried = (0..PLANE_CANDIDATES).filter_map(|_| {
        let [a, b, c] = [(); 3].map(|()| points[random.next_below(points.len())]);
        let plane = Plane::from_point_and_normal(a, (b - a).cross(&(c - a)))?;
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
    // Repeat the fit, because each fit changes the set of points near the plane.
    for _ in 0..5 {
        let points = points.iter().until_stopped();
        let near = points.filter(|point| is_on(&plane, point, distance)).copied();
        plane = Plane::fit(&near.collect::<Vec<_>>())?;
    }
    Some(plane)
}

/// The connected part of a plane that has the most points, stored as a set of grid squares.
struct Part {
    corner: [f64; 2],
    side: f64,
    squares: BTreeSet<[i64; 2]>,
}

impl Part {
    /// Finds the largest connected part of a plane, given the coordinates of its points in the plane. The side of a grid square is a
    /// hundredth of the extent of all points, but at least four times `distance`.
    fn largest(points: &[[f64; 2]], distance: f64) -> Self {
        fn ends(axis: usize, points: &[[f64; 2]]) -> (f64, f64) {
            let along = points.iter().map(|point| point[axis]);
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), x| (min.min(x), max.max(x)))
        }
        let [(left, right), (bottom, top)] = [ends(0, points), ends(1, points)];
        let side = f64::max(4.0 * distance, 0.01 * f64::max(right - left, top - bottom));
        let mut part = Self { corner: [left, bottom], side, squares: BTreeSet::new() };
        let mut counts: BTreeMap<[i64; 2], usize> = BTreeMap::new();
        for point in points.iter().until_stopped() {
            *counts.entry(part.square(point)).or_default() += 1;
        }
        let (mut seen, mut most) = (BTreeSet::new(), 0);
        for &first in counts.keys() {
            let (mut squares, mut open, mut count) = (BTreeSet::new(), vec![first], 0);
            while let Some(at) = open.pop() {
                let Some(points) = counts.get(&at).filter(|_| seen.insert(at)) else { continue };
                count += points;
                squares.insert(at);
                open.extend(square_and_neighbors(at));
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

    /// Returns true if the grid square that contains a point, or one of the eight squares around it, belongs to the part.
    fn contains(&self, at: &[f64; 2]) -> bool {
        square_and_neighbors(self.square(at)).any(|square| self.squares.contains(&square))
    }
}

/// Returns the indices of a grid square and of its eight neighbors.
fn square_and_neighbors([x, y]: [i64; 2]) -> impl Iterator<Item = [i64; 2]> {
    (0..9).map(move |k| [x + k % 3 - 1, y + k / 3 - 1])
}

impl PlaneInScan {
    /// Returns for each position of the scan true if it is above the plane: more than `distance` and at most `height` above it, over the
    /// hull of the plane, and at least `inset` away from the border of the hull.
    pub fn is_above_each(&self, scan: &Scan, distance: f64, height: f64, inset: f64) -> Vec<bool> {
        scan.positions()
            .par_iter()
            .map(|position| {
                let at = self.plane.height(position);
                distance < at
                    && at <= height
                    && self.hull.contains(coordinates_on_plane(&self.plane, position), inset)
            })
            .collect()
    }

    /// Returns the bounding rectangle of the largest connected part as a mesh, in the axes of the scan. Its normal points to the upper side
    /// of the plane.
    pub fn to_rectangle(&self, scan: &Scan) -> Mesh {
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

    /// Creates the points of a table of 400 x 200 mm with a box on it, a wall beside it, and a floor below it.
    fn room() -> Scan {
        let mut points = Vec::new();
        let mut random = Random(7);
        fn noise(random: &mut Random) -> f64 {
            random.next_below(1000) as f64 / 500.0 - 1.0
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
    fn the_objects_on_a_table_are_neither_the_wall_nor_the_floor() {
        let scan = room();
        let found = dominant_plane(&scan, 5.0, 1).unwrap();
        assert!((found.plane.normal.z - 1.0).abs() < 1e-6, "{:?}", found.plane);
        assert!(found.plane.offset.abs() < 0.05);
        let above = found.is_above_each(&scan, 5.0, 1000.0, 0.0);
        assert_eq!(above.iter().filter(|above| **above).count(), 2_000);
        let mesh = found.to_rectangle(&scan);
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

    /// Creates a triangle mesh of a square with the edge `size` and `steps` cells along each side. `corner` is its lowest corner.
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
        let (mut positions, mut faces) = (Vec::new(), Vec::new());
        for (own, corners) in parts {
            let before = positions.len() as u32;
            positions.extend_from_slice(own);
            faces.extend(corners.iter().map(|face| face.map(|vertex| vertex + before)));
        }
        Scan::Mesh(Mesh::new(positions, Faces::triangles(faces)).unwrap())
    }

    #[test]
    fn a_table_of_two_triangles_counts_by_its_area() {
        let scan = mesh(&[sheet(400.0, [0.0; 3], 1), sheet(40.0, [1.0, 1.0, 30.0], 50)]);
        let found = dominant_plane(&scan, 1.0, 1).unwrap();
        assert!(found.plane.offset.abs() < 1e-6 && found.plane.normal.z > 0.99);
        assert!(found.fraction > 0.98, "{}", found.fraction);
        // The small sheet is above a corner of the table, so all of its 51 x 51 vertices count as above the table.
        let above = found.is_above_each(&scan, 1.0, 100.0, 0.0);
        assert_eq!(above.iter().filter(|above| **above).count(), 51 * 51);
        let board = found.to_rectangle(&scan);
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
        assert!((found.fraction - 1.0 / 6.0).abs() < 0.01);
    }

    #[test]
    fn points_on_a_line_and_no_points_have_no_plane() {
        let line = (0..100).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect::<Vec<_>>();
        for points in [line, Vec::new()] {
            let count = points.len();
            let scan = Scan::Points(Points::new(points).unwrap());
            let error = dominant_plane(&scan, 5.0, 1).err().unwrap();
            let message = format!(
                "there is no plane of rank 1: the remaining {count} points are too few or on a line; choose a smaller `rank` or `distance`"
            );
            assert_eq!(error.to_string(), message);
        }
    }
}
