//! From the space of meshes to the picture.
//!
//! *View space* has x right, y up and z towards the viewer, its origin in the middle of all meshes, and lengths such that
//! these reach from -1 to 1 along their longest side.

use maquette_value::{Mesh, bounds};
use nalgebra::{Matrix3, Point3, Vector3};

use super::{Aim, Projection, SAMPLES, View};

/// Parts of a sample that a vertex's place is rounded to.
pub(super) const PARTS: i32 = 16;

/// The tangent of half the lens's angle along the picture's shorter side: 13 degrees, that of a portrait lens.
const LENS: f64 = 0.230_868_191_125_563_1;

/// The share of the picture that the meshes fill.
const FILLED: f64 = 0.92;

/// How near to the viewer anything may be, in view space.
const NEAREST: f64 = 0.1;

/// How much larger than what just fits all of it anything is drawn.
const LARGEST: f64 = 1e3;

/// Farther from the picture's origin than this (in parts of samples) no vertex is drawn, so that products of two distances
/// and sums of nine of them stay in 64 bits.
const FARTHEST: f64 = (1 << 27) as f64;

/// Where a vertex is in the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// Column and row, in parts of samples.
    pub(super) at: [i32; 2],
    /// How near it is; straight in the picture between two vertices of a face.
    pub(super) near: f32,
}

/// A view onto meshes that share their axes.
pub(super) struct Camera {
    view_from_mesh: Matrix3<f64>,
    center: Point3<f64>,
    radius: f64,
    /// The middle of what is seen, in view space.
    aim: Vector3<f64>,
    /// From the viewer to the aim; none without perspective.
    distance: Option<f64>,
    /// Parts of samples per length of view space (per tangent with perspective).
    scale: f64,
    /// The middle of the picture, in parts of samples.
    middle: [f64; 2],
}

impl Camera {
    /// The axes are those of the first mesh.
    pub(super) fn new(meshes: &[&Mesh], view: &View) -> Self {
        let (low, high) = bounds(points_of(meshes)).unwrap_or_default();
        let half = high.coords / 2.0 - low.coords / 2.0;
        let parts = f64::from(PARTS) * SAMPLES as f64;
        let mut camera = Self {
            view_from_mesh: rotation(meshes.first().copied(), view),
            center: Point3::from(low.coords / 2.0 + high.coords / 2.0),
            radius: if half.amax() > 0.0 { half.amax() } else { 1.0 },
            aim: Vector3::zeros(),
            distance: None,
            scale: 1.0,
            middle: view.size.map(|size| size as f64 / 2.0 * parts),
        };
        let zoom = if view.zoom.is_nan() { 1.0 } else { view.zoom.clamp(1e-3, LARGEST) };
        camera.frame(meshes, view.projection, zoom);
        if let Some(aim) = &view.aim {
            camera.turn_to(aim, meshes, zoom);
        }
        camera
    }

    /// Aims at the middle of what is seen, and goes so far away that all of it fits.
    fn frame(&mut self, meshes: &[&Mesh], projection: Projection, zoom: f64) {
        let mut points = points_of(meshes).map(|point| self.view(*point));
        let first = points.next().unwrap_or_default();
        let (low, high) =
            points.fold((first, first), |(low, high), point| (low.inf(&point), high.sup(&point)));
        self.aim = (low + high) / 2.0;
        let shorter = self.shorter();
        let reaches = points_of(meshes).map(|point| self.reach(self.view(*point)));
        match projection {
            Projection::Orthographic => {
                let widest = reaches.fold(0.0, |widest, (reach, _)| f64::max(widest, reach));
                self.scale = shorter * zoom / widest.max(1e-6);
            }
            Projection::Perspective => {
                // The nearest vertex stays clear of the viewer even where the mesh is a mere line towards it.
                self.distance = Some(
                    reaches
                        .map(|(reach, z): (f64, f64)| z + (reach / LENS).max(NEAREST))
                        .fold(NEAREST, f64::max),
                );
                self.scale = shorter * zoom / LENS;
            }
        }
    }

    /// Aims elsewhere. A place is drawn as large as it was; a box just fits, by a longer lens instead of a nearer viewer, so that
    /// nothing gets behind the viewer.
    fn turn_to(&mut self, aim: &Aim, meshes: &[&Mesh], zoom: f64) {
        let [low, high] = match *aim {
            Aim::Place(place) => [place; 2],
            Aim::Box(low, high) => [low, high],
        };
        let corners: [_; 8] = std::array::from_fn(|k| {
            let end = |axis: usize| if k >> axis & 1 == 0 { low[axis] } else { high[axis] };
            self.view(Point3::new(end(0), end(1), end(2)))
        });
        self.aim = self.view(Point3::from(low.coords / 2.0 + high.coords / 2.0));
        if let Some(before) = self.distance {
            let seen = points_of(meshes).map(|point| self.view(*point)).chain(corners);
            let away = seen.map(|view| view.z - self.aim.z + NEAREST).fold(before, f64::max);
            self.distance = Some(away);
            self.scale *= away / before;
        }
        fn near(z: f64, self_distance: &Option<f64>) -> f64 {
            self_distance.map_or(1.0, |distance| 1.0 / (distance - z))
        }
        let reaches = corners.map(|view| self.reach(view));
        let widest = reaches
            .into_iter()
            .map(|(reach, z)| reach * near(z, &self.distance))
            .fold(0.0, f64::max);
        if widest > 0.0 {
            let largest = LARGEST * self.scale / zoom;
            self.scale = (self.shorter() * zoom / widest).min(largest);
        }
    }

    /// Half the picture's shorter side, in parts of samples.
    fn shorter(&self) -> f64 {
        self.middle[0].min(self.middle[1])
    }

    /// How far a point of view space is from the aim, as a share of that half of the picture which is to be filled, measured by half
    /// its shorter side; and how much nearer it is than the aim.
    fn reach(&self, view: Vector3<f64>) -> (f64, f64) {
        let [right, top] = self.middle.map(|middle| FILLED * middle / self.shorter());
        let [x, y, z]: [f64; 3] = (view - self.aim).into();
        ((x.abs() / right).max(y.abs() / top), z)
    }

    /// A point in view space.
    pub(super) fn view(&self, point: Point3<f64>) -> Vector3<f64> {
        self.view_from_mesh * ((point - self.center) / self.radius)
    }

    /// A direction of the mesh's space in view space.
    pub(super) fn turn(&self, direction: Vector3<f64>) -> Vector3<f64> {
        self.view_from_mesh * direction
    }

    /// Where a point of view space is in the picture.
    pub(super) fn spot(&self, view: Vector3<f64>) -> Spot {
        let from_aim = view - self.aim;
        let near = self.distance.map_or(1.0, |distance| 1.0 / (distance - from_aim.z));
        let [x, y] = [from_aim.x, -from_aim.y].map(|length| length * near * self.scale);
        fn place(x: f64) -> i32 {
            x.clamp(-FARTHEST, FARTHEST).round() as i32
        }
        let near = if self.distance.is_some() { near } else { from_aim.z };
        Spot { at: [place(self.middle[0] + x), place(self.middle[1] + y)], near: near as f32 }
    }

    /// How far a point weighs that is `near`, when corners are mixed: with perspective the nearer half of an edge takes more
    /// than half of its length in the picture.
    pub(super) fn weighs_by_nearness(&self) -> bool {
        self.distance.is_some()
    }
}

fn points_of<'a>(meshes: &'a [&Mesh]) -> impl Iterator<Item = &'a Point3<f64>> {
    meshes.iter().flat_map(|mesh| mesh.positions().iter())
}

/// From the mesh's axes to the viewer's.
fn rotation(mesh: Option<&Mesh>, view: &View) -> Matrix3<f64> {
    let turn =
        |degrees: f64| libm::sincos(if degrees.is_finite() { degrees.to_radians() } else { 0.0 });
    let ((sy, cy), (sp, cp)) = (turn(view.yaw), turn(view.pitch));
    let yaw = Matrix3::new(cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy);
    let pitch = Matrix3::new(1.0, 0.0, 0.0, 0.0, cp, -sp, 0.0, sp, cp);
    let upright = if mesh.is_some_and(|mesh| mesh.frame().is_some()) { -1.0 } else { 1.0 };
    pitch * yaw * Matrix3::from_diagonal(&Vector3::new(1.0, upright, upright))
}
