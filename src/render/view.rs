//! Views: the position of the camera, and the choice of the representation in which a value is drawn.

use nalgebra::Point3;

use super::flat::Backdrop;

/// The camera, and the size of the picture. The whole scene is framed automatically, unless the view aims at a part of the scene.
///
/// Seen from the front, a mesh with a [`CaptureFrame`](maquette_value::CaptureFrame) looks as its sensor saw it. A mesh without a frame has
/// x to the right, y up, and z towards the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The width and height of the picture in pixels.
    pub size: [usize; 2],
    /// The angle by which the camera moves around the mesh to the right, in degrees.
    pub yaw: f64,
    /// The angle by which the camera rises above the mesh, in degrees.
    pub pitch: f64,
    /// The magnification relative to a scene that just fits into the picture, 0.001 to 1000.
    pub zoom: f64,
    /// The projection: perspective or orthographic.
    pub projection: Projection,
    /// The part of the scene that is shown in the middle of the picture. If omitted, the whole scene is shown.
    pub aim: Option<Aim>,
}

/// The part of the scene that is shown in the middle of a picture, in mm, in the axes of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// A point, which is shown in the middle. The scale does not change.
    Point(Point3<f64>),
    /// The minimum and the maximum corner of a box, which just fits into the picture.
    Box(Point3<f64>, Point3<f64>),
}

impl Aim {
    /// Aims at the bounding box of those points that are finite. `None` if no point is finite.
    pub fn at_points(points: impl IntoIterator<Item = Point3<f64>>) -> Option<Self> {
        let points: Vec<_> =
            points.into_iter().filter(|point| point.coords.iter().all(|x| x.is_finite())).collect();
        maquette_value::bounds(points.iter()).map(|(low, high)| Self::Box(low, high))
    }
}

/// The projection: perspective or orthographic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// Perspective through a lens with an angle of view of 26 degrees.
    #[default]
    Perspective,
    /// No perspective, so that parallel lines remain parallel.
    Orthographic,
}

impl View {
    /// A view from the front, 800 x 600 pixels, in perspective.
    pub fn front() -> Self {
        Self {
            size: [800, 600],
            yaw: 0.0,
            pitch: 0.0,
            zoom: 1.0,
            projection: Projection::Perspective,
            aim: None,
        }
    }
}

/// The camera and the representation with which a value is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look<'a> {
    /// The camera for a value in space.
    pub view: View,
    /// The representation in which the value is drawn.
    pub representation: Representation,
    /// The backdrop: the picture on which a flat picture is drawn.
    pub backdrop: Option<Backdrop<'a>>,
}

/// The representation in which a value is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Representation {
    /// The value's flat picture, in its own resolution. If the value has none, the value in space.
    #[default]
    Native,
    /// As `Native`, except that a flat picture is scaled to the size of the view.
    Fitted,
    /// The value is drawn in space, as the camera sees it.
    Space,
}

impl Look<'_> {
    /// A view of the flat picture of a value. If the value has none, a view of the value from the front.
    pub fn front() -> Self {
        Self { view: View::front(), representation: Representation::Native, backdrop: None }
    }
}
