//! Views: the camera with which a value is drawn, and the representation (flat or in 3D space).

use nalgebra::Point3;

use super::flat::Backdrop;
use super::light::BackFaces;

/// The camera and the size of the picture. The whole scene fits into the picture, unless the view aims at a part of the scene.
///
/// From the front, a mesh with a [`CaptureFrame`](maquette_value::CaptureFrame) looks as its sensor saw it. For a mesh without a frame, x
/// is to the right, y up, and z towards the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The width and height of the picture in pixels.
    pub size: [usize; 2],
    /// The angle by which the camera moves around the mesh to the right, in degrees.
    pub yaw: f64,
    /// The angle by which the camera rises above the mesh, in degrees.
    pub pitch: f64,
    /// The magnification, from 0.001 to 1000. At 1 the scene just fits into the picture.
    pub zoom: f64,
    /// The projection: perspective or orthographic.
    pub projection: Projection,
    /// The part of the scene to show. If it is `None`, the whole scene is shown.
    pub aim: Option<Aim>,
    /// The color of the inner side of faces.
    pub back_faces: BackFaces,
}

/// The part of a scene that is shown in the middle of a picture. Positions are in mm, in the coordinate axes of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// A point that is shown in the middle. The scale is the same as for the whole scene.
    Point(Point3<f64>),
    /// A box, given by its minimum and maximum corner, which just fits into the picture.
    Box(Point3<f64>, Point3<f64>),
}

impl Aim {
    /// Aims at the bounding box of the finite points. Returns `None` if no point is finite.
    pub fn at_points(points: impl IntoIterator<Item = Point3<f64>>) -> Option<Self> {
        let points: Vec<_> =
            points.into_iter().filter(|point| point.coords.iter().all(|x| x.is_finite())).collect();
        maquette_value::bounds(points.iter()).map(|(low, high)| Self::Box(low, high))
    }
}

/// The projection from 3D space to the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// Perspective through a lens with an angle of view of 26 degrees.
    #[default]
    Perspective,
    /// Without perspective: parallel lines stay parallel.
    Orthographic,
}

impl View {
    /// Returns a view from the front, with perspective and 800 x 600 pixels.
    pub fn front() -> Self {
        Self {
            size: [800, 600],
            yaw: 0.0,
            pitch: 0.0,
            zoom: 1.0,
            projection: Projection::Perspective,
            aim: None,
            back_faces: BackFaces::Marked,
        }
    }
}

/// The camera, representation and backdrop with which a value is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look<'a> {
    /// The camera, which is used for a value in 3D space.
    pub view: View,
    /// The way in which the value is drawn.
    pub representation: Representation,
    /// The picture on which a flat picture is drawn; `None` for no backdrop.
    pub backdrop: Option<Backdrop<'a>>,
}

/// The way in which a value is drawn: flat or in 3D space.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Representation {
    /// Draws the flat picture of the value in its own resolution. A value without a flat picture is drawn in 3D space.
    #[default]
    Native,
    /// Draws like `Native`, but scales a flat picture to the size of the view.
    Fitted,
    /// Draws the value in 3D space, as the camera sees it.
    Space,
}

impl Look<'_> {
    /// Returns a look that draws the flat picture of a value. A value without a flat picture is drawn in 3D space, seen from the front.
    pub fn front() -> Self {
        Self { view: View::front(), representation: Representation::Native, backdrop: None }
    }
}
