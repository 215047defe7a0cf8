//! The view that one capture has of a surface.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use maquette_base::light::light_of;
use maquette_node::{CancelledError, Error, Progress};
use maquette_value::parallel::*;
use maquette_value::{Image, Mesh, TriangleTree};
use nalgebra::{Matrix4, Point3, Vector3};

use super::baking::Baking;
use super::camera::Camera;
use super::sample::Sample;
use super::spot::Spot;

/// A capture that was moved into the coordinates of the baked mesh.
pub(super) struct View<'a> {
    number: usize,
    mesh: Mesh,
    tree: TriangleTree,
    picture: &'a Image,
    camera: Camera,
    /// 1 or -1, the sign that makes the camera's direction point towards the camera.
    side: f64,
    /// The corners of the bounding box around the capture.
    around: [Point3<f64>; 8],
    /// The distance of each vertex from the border of the capture, up to `feather`, in mm.
    inside: Vec<f64>,
    feather: f64,
    pub(super) tolerance: f64,
}

/// Default lengths, in multiples of the spacing of a capture's points. `TOLERANCE` is the maximum distance between the baked mesh and the
/// capture; `FEATHER` is the width of the capture's border in which weights are reduced.
const TOLERANCE: f64 = 3.0;
const FEATHER: f64 = 5.0;

/// Two cosines of the viewing angle: at the first cosine or less, a capture has no weight; at the second or more, it has full weight.
const GRAZING_COSINES: [f64; 2] = [0.1, 0.35];

/// Width in pixels of the border of the picture in which weights are reduced.
const MARGIN: f64 = 4.0;

/// Number of points that are processed between two checks for cancellation.
const BLOCK: usize = 1 << 16;

impl<'a> View<'a> {
    pub(super) fn new(
        number: usize,
        capture: &'a Mesh,
        motion: &Matrix4<f64>,
        how: &Baking,
    ) -> Result<Self, Error> {
        fn lacks(what: &str, number: usize) -> Error {
            Error::new(format!(
                "capture {} has no {what}: add its picture with `Texture`",
                number + 1
            ))
        }
        let picture = capture
            .texture()
            .filter(|it| !it.pixels().is_empty())
            .ok_or_else(|| lacks("picture", number))?;
        if capture.faces().is_empty() {
            return Err(lacks("faces", number));
        }
        let mesh = match *motion == Matrix4::identity() {
            true => capture.clone(),
            false => capture.with_positions(
                capture.positions().iter().map(|at| motion.transform_point(at)).collect(),
            )?,
        };
        let size = [picture.width(), picture.height()];
        let known =
            capture.frame().filter(|frame| frame.picture == size).and_then(|frame| frame.camera);
        let camera = match known.and_then(|pinhole| Camera::from_pinhole(&pinhole, motion)) {
            Some(camera) => camera,
            None => Camera::from_texture_coordinates(&mesh, size).map_err(|why| {
                Error::new(format!(
                    "the camera of capture {} is unknown and cannot be computed from its texture coordinates ({why}): give a camera file, or \
                     leave the capture where it was taken",
                    number + 1
                ))
            })?,
        };
        let side = if mesh
            .faces()
            .iter()
            .map(|face| {
                mesh.area_vector(face)
                    .dot(&camera.direction_to_camera(mesh.positions()[face[0] as usize]))
            })
            .sum::<f64>()
            < 0.0
        {
            -1.0
        } else {
            1.0
        };
        let edges = mesh.edges();
        let distance = edges
            .vertices
            .iter()
            .map(|ends| {
                let [a, b] = ends.map(|it| mesh.positions()[it as usize]);
                (b - a).norm()
            })
            .sum::<f64>()
            / edges.vertices.len() as f64;
        fn given_or(given: f64, times: f64, distance: f64) -> f64 {
            if given > 0.0 { given } else { times * distance }
        }
        let (tolerance, feather) = (
            given_or(how.tolerance, TOLERANCE, distance),
            given_or(how.feather, FEATHER, distance),
        );
        let inside = from_border(&mesh, feather);
        let tree = TriangleTree::new(&mesh);
        let (low, high) = mesh.bounds().unwrap_or_default();
        let around = std::array::from_fn(|k| {
            fn side(axis: usize, k: usize, low: Point3<f64>, high: Point3<f64>) -> f64 {
                if k >> axis & 1 == 0 { low[axis] } else { high[axis] }
            }
            Point3::new(side(0, k, low, high), side(1, k, low, high), side(2, k, low, high))
        });
        Ok(Self { number, mesh, tree, picture, camera, side, around, inside, feather, tolerance })
    }

    /// Adds the samples of this capture at all points that the capture sees.
    pub(super) fn sample(
        &self,
        spots: &[Spot],
        samples: &mut Vec<Sample>,
        progress: &Progress<'_>,
    ) -> Result<(), CancelledError> {
        for (block, spots) in spots.chunks(BLOCK).enumerate() {
            progress.check()?;
            let found =
                spots.par_iter().enumerate().with_min_len(256).filter_map(|(number, spot)| {
                    let (weight, sure, light) = self.look(spot)?;
                    let texel = (block * BLOCK + number) as u32;
                    Some(Sample { texel, capture: self.number as u32, weight, sure, light })
                });
            samples.extend(found.collect::<Vec<_>>());
        }
        Ok(())
    }

    fn look(&self, spot: &Spot) -> Option<(f32, f32, [f32; 3])> {
        let towards = self.camera.direction_to_camera(spot.place) * self.side;
        let cos = towards.dot(&spot.normal);
        if cos <= GRAZING_COSINES[0] {
            return None;
        }
        let pixel = self.camera.pixel(spot.place)?;
        let size = [self.picture.width(), self.picture.height()];
        // Weights are also reduced near the border of the picture.
        let margin =
            [0, 1].map(|axis| pixel[axis].min(size[axis] as f64 - 1.0 - pixel[axis]) + 0.5);
        let margin = margin[0].min(margin[1]);
        if margin <= 0.0 {
            return None;
        }
        let (off, inside) = self.meet(spot.place, towards)?;
        let near = (1.0 - off * off) * (1.0 - off * off);
        let fade = smooth(inside / self.feather) * smooth(margin / MARGIN);
        let sure = near
            * fade
            * smooth((cos - GRAZING_COSINES[0]) / (GRAZING_COSINES[1] - GRAZING_COSINES[0]));
        let density = self.density(spot.place, towards, pixel)?;
        let weight = (sure * cos * cos * cos * density * density) as f32;
        // An infinite weight, which results from a distance of 0, counts as not seen.
        let is_seen = 0.0 < weight && weight.is_finite();
        is_seen.then(|| (weight, sure as f32, light_at(self.picture, pixel).map(|x| x as f32)))
    }

    /// Intersects the ray from the camera to a point with the captured surface. Returns the distance of the intersection from the point,
    /// perpendicular to the surface and as a fraction of the tolerance. Also returns the distance of the intersection from the capture's
    /// border. Returns `None` if the first distance is beyond the tolerance, or another surface is in front.
    fn meet(&self, place: Point3<f64>, towards: Vector3<f64>) -> Option<(f64, f64)> {
        let ahead = self
            .around
            .map(|corner| towards.dot(&(corner - place)))
            .into_iter()
            .fold(0.0, f64::max);
        let begin = ahead + self.tolerance;
        let hit = self.tree.first_hit(place + towards * begin, -towards)?;
        let corners =
            hit.corners.map(|corner| self.mesh.faces().corners()[corner as usize] as usize);
        let [a, b, c] = corners.map(|it| self.mesh.positions()[it]);
        let double = (b - a).cross(&(c - a));
        let off = (hit.along - begin).abs() * towards.dot(&double) / double.norm() / self.tolerance;
        if !(0.0..1.0).contains(&off) {
            return None;
        }
        let at = hit.position(&self.mesh);
        fn share(from: Point3<f64>, to: Point3<f64>, at: Point3<f64>, double: Vector3<f64>) -> f64 {
            (from - at).cross(&(to - at)).dot(&double) / double.norm_squared()
        }
        let shares = [share(b, c, at, double), share(c, a, at, double), share(a, b, at, double)];
        Some((off, corners.iter().zip(shares).map(|(&it, share)| self.inside[it] * share).sum()))
    }

    /// Returns the number of the picture's pixels per mm at a point, measured perpendicular to the line of sight; `None` if it cannot be
    /// computed.
    fn density(&self, place: Point3<f64>, towards: Vector3<f64>, pixel: [f64; 2]) -> Option<f64> {
        let aside = Vector3::ith(towards.iamin(), 1.0).cross(&towards).try_normalize(0.0)?;
        let step = 0.01 * self.tolerance;
        let other = self.camera.pixel(place + aside * step)?;
        let [x, y] = [0, 1].map(|k| other[k] - pixel[k]);
        Some((x * x + y * y).sqrt() / step)
    }

    /// Updates `nearest`, the distance from each point to the nearest capture, by the distances to this capture.
    pub(super) fn approach(&self, places: &[Point3<f64>], nearest: &mut [f64]) {
        for (least, found) in nearest.iter_mut().zip(self.tree.nearest_to_all(places)) {
            *least = least.min(found.map_or(f64::INFINITY, |it| it.distance_sq.sqrt()));
        }
    }
}

/// Returns a smooth step function of `x`, which rises from 0 at 0 to 1 at 1.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Returns the light at a pixel (column, row), interpolated between four pixels.
fn light_at(picture: &Image, [column, row]: [f64; 2]) -> [f64; 3] {
    let most = [picture.width() - 1, picture.height() - 1];
    let [(left, x), (top, y)] = [(column, most[0]), (row, most[1])].map(|(at, most)| {
        let at = at.clamp(0.0, most as f64);
        (at as usize, at.fract())
    });
    let (right, below) = ((left + 1).min(most[0]), (top + 1).min(most[1]));
    let [a, b, c, d] = [[left, top], [right, top], [left, below], [right, below]]
        .map(|at| light_of(picture.pixel(at)));
    [0, 1, 2].map(|k| (a[k] * (1.0 - x) + b[k] * x) * (1.0 - y) + (c[k] * (1.0 - x) + d[k] * x) * y)
}

/// Returns the distance of each vertex from the border along edges, up to `most`: Dijkstra, "A note on two problems in connexion with
/// graphs" (1959).
fn from_border(mesh: &Mesh, most: f64) -> Vec<f64> {
    let edges = mesh.edges();
    let mut distances = vec![most; mesh.positions().len()];
    let mut heap = BinaryHeap::new();
    let border = edges.vertices.iter().zip(&edges.faces).filter(|it| *it.1 == 1);
    for &vertex in border.flat_map(|it| it.0) {
        if std::mem::replace(&mut distances[vertex as usize], 0.0) > 0.0 {
            heap.push((Reverse(0), vertex));
        }
    }
    let around = maquette_base::topology::lists::Lists::group(distances.len(), || {
        edges.vertices.iter().flat_map(|&[a, b]| [(a, b), (b, a)])
    });
    // The bits of nonnegative floating-point numbers have the order of the numbers.
    while let Some((Reverse(bits), vertex)) = heap.pop() {
        let distance = f64::from_bits(bits);
        if distances[vertex as usize] < distance {
            continue;
        }
        for &other in around.list(vertex as usize) {
            let [a, b] = [vertex, other].map(|it| mesh.positions()[it as usize]);
            let longer = distance + (b - a).norm();
            if longer < distances[other as usize] {
                distances[other as usize] = longer;
                heap.push((Reverse(longer.to_bits()), other));
            }
        }
    }
    distances
}
