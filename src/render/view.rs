//! From where a picture is taken, and what of a value is drawn.

use nalgebra::Point3;

use super::flat::Below;

/// From where a picture is taken. All that is seen is framed by itself, unless the view aims at a part of it.
///
/// Seen from the front, a mesh with a [`CaptureFrame`](maquette_value::CaptureFrame) looks as its sensor saw it; one without
/// has x to the right, y up, and z towards the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// How far the viewer walks around the mesh to the right, in degrees.
    pub yaw: f64,
    /// How far the viewer rises above it, in degrees.
    pub pitch: f64,
    /// How much larger than what just fits, 0.001 to 1000.
    pub zoom: f64,
    /// Whether far things look smaller.
    pub projection: Projection,
    /// What is in the middle; all there is without it.
    pub aim: Option<Aim>,
}

/// What is in the middle of a picture, in mm, in the axes of what is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// A place. It changes nothing else.
    Place(Point3<f64>),
    /// The least and the greatest corner of a box, which just fits into the picture.
    Box(Point3<f64>, Point3<f64>),
}

impl Aim {
    /// Aims at the box around some places, those that are not finite left out; none if there is no other.
    pub fn around(places: impl IntoIterator<Item = Point3<f64>>) -> Option<Self> {
        let places: Vec<_> =
            places.into_iter().filter(|place| place.coords.iter().all(|x| x.is_finite())).collect();
        maquette_value::bounds(places.iter()).map(|(low, high)| Self::Box(low, high))
    }
}

/// Whether far things look smaller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// They do: a lens of 26 degrees.
    #[default]
    Perspective,
    /// They do not.
    Orthographic,
}

impl View {
    /// From the front, 800 x 600 pixels, in perspective.
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

/// How a value is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look<'a> {
    /// From where what lies in space is seen.
    pub view: View,
    /// Which of the two is drawn.
    pub kind: Kind,
    /// What a flat picture lies on.
    pub below: Option<Below<'a>>,
}

/// What of a value is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// The picture that it shows, with the pixels that it has; without one, what lies in space.
    #[default]
    Own,
    /// The same, but a picture fits into the size of the view.
    Fitted,
    /// What lies in space.
    Space,
}

impl Look<'_> {
    /// At the picture of a value if it shows one, else from the front.
    pub fn own() -> Self {
        Self { view: View::front(), kind: Kind::Own, below: None }
    }
}
