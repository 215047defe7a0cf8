//! The projection from the coordinates of a mesh to the picture.
//!
//! *View space* has x to the right, y up and z towards the viewer. Its origin is in the middle of all meshes. It is scaled so that the
//! meshes reach from -1 to 1 along their longest side.

use maquette_value::{Mesh, bounds};
use nalgebra::{Matrix3, Point3, Vector3};

use super::{Aim, Projection, SAMPLES, View};

/// The number of steps into which a sample is divided. Projected vertices are rounded to these steps (the "parts of samples").
pub(super) const PARTS: i32 = 16;

/// The tangent of 13 degrees, half the angle of view along the shorter side of the picture. Portrait lenses have a similar angle.
const LENS: f64 = 0.230_868_191_125_563_1;

/// The fraction of the picture that the meshes fill, along the side of the picture that limits their size.
const FILLED_FRACTION: f64 = 0.92;

/// The minimum distance from the viewer to the scene, in units of view space.
const MIN_DISTANCE: f64 = 0.1;

/// The maximum magnification. A scene that just fits into the picture has a magnification of 1.
const MAX_ZOOM: f64 = 1e3;

/// The maximum absolute value of a projected coordinate, in parts of samples. Products of two such coordinates, and sums of nine such
/// products, fit in 64 bits.
const MAX_OFFSET: f64 = (1 << 27) as f64;

/// The projected position of a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct ProjectedVertex {
    /// The column and row of the projected vertex, in parts of samples.
    pub(super) position: [i32; 2],
    /// The nearness to the viewer: it is larger for nearer vertices, and linear in the picture between two vertices of a face.
    pub(super) near: f32,
}

/// The camera for a picture of several meshes with the same coordinate axes.
pub(super) struct Camera {
    view_from_mesh: Matrix3<f64>,
    center: Point3<f64>,
    radius: f64,
    /// The point in view space that is shown in the middle of the picture.
    aim: Vector3<f64>,
    /// The distance from the viewer to `aim`; `None` without perspective.
    distance: Option<f64>,
    /// The scale of the projection, in parts of samples. Without perspective it is per unit of view space; with perspective, per unit of
    /// the tangent of the angle from the viewing direction.
    scale: f64,
    /// The middle of the picture, in parts of samples.
    middle: [f64; 2],
}

impl Camera {
    /// Creates the camera for a view. The camera has the coordinate axes of the first mesh.
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
        let zoom = if view.zoom.is_nan() { 1.0 } else { view.zoom.clamp(1e-3, MAX_ZOOM) };
        camera.frame(meshes, view.projection, zoom);
        if let Some(aim) = &view.aim {
            camera.aim_at(aim, meshes, zoom);
        }
        camera
    }

    /// Aims at the middle of the scene, from a distance at which the whole scene fits into the picture.
    fn frame(&mut self, meshes: &[&Mesh], projection: Projection, zoom: f64) {
        let mut points = points_of(meshes).map(|point| self.view(*point));
        let first = points.next().unwrap_or_default();
        let (low, high) =
            points.fold((first, first), |(low, high), point| (low.inf(&point), high.sup(&point)));
        self.aim = (low + high) / 2.0;
        let shorter = self.half_shorter_side();
        let reaches = points_of(meshes).map(|point| self.reach(self.view(*point)));
        match projection {
            Projection::Orthographic => {
                let widest = reaches.fold(0.0, |widest, (reach, _)| f64::max(widest, reach));
                self.scale = shorter * zoom / widest.max(1e-6);
            }
            Projection::Perspective => {
                // Keep a minimum distance between the nearest vertex and the viewer, even if the mesh is only a line towards the viewer.
                self.distance = Some(
                    reaches
                        .map(|(reach, z): (f64, f64)| z + (reach / LENS).max(MIN_DISTANCE))
                        .fold(MIN_DISTANCE, f64::max),
                );
                self.scale = shorter * zoom / LENS;
            }
        }
    }

    /// Aims at a point or a box. For a point, the scale does not change. For a box, the scale changes so that the box just fits into the
    /// picture; the camera does not move nearer, so nothing gets behind the viewer.
    fn aim_at(&mut self, aim: &Aim, meshes: &[&Mesh], zoom: f64) {
        let [low, high] = match *aim {
            Aim::Point(point) => [point; 2],
            Aim::Box(low, high) => [low, high],
        };
        let corners: [_; 8] = std::array::from_fn(|k| {
            self.view(Point3::from(
                [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { low[axis] } else { high[axis] }),
            ))
        });
        self.aim = self.view(Point3::from(low.coords / 2.0 + high.coords / 2.0));
        if let Some(before) = self.distance {
            let seen = points_of(meshes).map(|point| self.view(*point)).chain(corners);
            let away = seen.map(|view| view.z - self.aim.z + MIN_DISTANCE).fold(before, f64::max);
            self.distance = Some(away);
            self.scale *= away / before;
        }
        let reaches = corners.map(|view| self.reach(view));
        let widest =
            reaches.into_iter().map(|(reach, z)| reach * self.magnification(z)).fold(0.0, f64::max);
        if widest > 0.0 {
            let largest = MAX_ZOOM * self.scale / zoom;
            self.scale = (self.half_shorter_side() * zoom / widest).min(largest);
        }
    }

    /// Returns the factor by which the projection multiplies lengths, in addition to `scale`, at the depth `z` relative to the target. The
    /// factor is 1 without perspective, and otherwise 1 divided by the distance from the viewer.
    fn magnification(&self, z: f64) -> f64 {
        self.distance.map_or(1.0, |distance| 1.0 / (distance - z))
    }

    /// Returns half of the shorter side of the picture, in parts of samples.
    fn half_shorter_side(&self) -> f64 {
        self.middle[0].min(self.middle[1])
    }

    /// Returns the distance of a point from the target in the plane of the picture, and the z of the point relative to the target. Returned
    /// is the larger one of the horizontal and the vertical distance, after both are divided by `FILLED_FRACTION`, and the one along the
    /// longer side of the picture also by the aspect ratio.
    fn reach(&self, view: Vector3<f64>) -> (f64, f64) {
        let [right, top] =
            self.middle.map(|middle| FILLED_FRACTION * middle / self.half_shorter_side());
        let [x, y, z]: [f64; 3] = (view - self.aim).into();
        ((x.abs() / right).max(y.abs() / top), z)
    }

    /// Transforms a point to view space.
    pub(super) fn view(&self, point: Point3<f64>) -> Vector3<f64> {
        self.view_from_mesh * ((point - self.center) / self.radius)
    }

    /// Transforms a direction to view space.
    pub(super) fn rotate(&self, direction: Vector3<f64>) -> Vector3<f64> {
        self.view_from_mesh * direction
    }

    /// Projects a point in view space to the picture.
    pub(super) fn project(&self, view: Vector3<f64>) -> ProjectedVertex {
        let from_aim = view - self.aim;
        let magnification = self.magnification(from_aim.z);
        let [x, y] = [from_aim.x, -from_aim.y].map(|length| length * magnification * self.scale);
        let near = if self.distance.is_some() { magnification } else { from_aim.z };
        let position = [self.middle[0] + x, self.middle[1] + y]
            .map(|x| x.clamp(-MAX_OFFSET, MAX_OFFSET).round() as i32);
        ProjectedVertex { position, near: near as f32 }
    }

    /// Returns true if interpolation between vertices must be weighted by their nearness. With perspective, the nearer half of an edge
    /// takes up more than half of the edge's length in the picture.
    pub(super) fn is_perspective(&self) -> bool {
        self.distance.is_some()
    }
}

fn points_of<'a>(meshes: &'a [&Mesh]) -> impl Iterator<Item = &'a Point3<f64>> {
    meshes.iter().flat_map(|mesh| mesh.positions().iter())
}

/// Returns the rotation from the axes of the mesh to the axes of view space.
fn rotation(mesh: Option<&Mesh>, view: &View) -> Matrix3<f64> {
    let ((sy, cy), (sp, cp)) = (sin_cos_degrees(view.yaw), sin_cos_degrees(view.pitch));
    let yaw = Matrix3::new(cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy);
    let pitch = Matrix3::new(1.0, 0.0, 0.0, 0.0, cp, -sp, 0.0, sp, cp);
    let upright = if mesh.is_some_and(|mesh| mesh.frame().is_some()) { -1.0 } else { 1.0 };
    pitch * yaw * Matrix3::from_diagonal(&Vector3::new(1.0, upright, upright))
}

/// Returns the sine and the cosine of an angle in degrees. An infinite angle or NaN counts as 0.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    libm::sincos(if degrees.is_finite() { degrees.to_radians() } else { 0.0 })
}
