//! Layers: what of a value can be drawn.
//!
//! Viewers draw layers, not types, so that a plugin's value is shown like one of the engine's. A layer shares memory with its value where
//! the value holds the same data.

use nalgebra::Point3;

use super::{Column, Image, Mesh, Points, Registration, Rgb};

/// The color of the background, and so of pixels of a drawn picture that show nothing.
pub const PLAIN: Rgb = [24, 26, 32];

/// One drawing of a value. A value gives several if they belong together, the most important one first.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// A picture, a pixel for each pixel or cell of the value.
    Picture(Picture),
    /// Faces: a mesh as it is, with its attributes as colors, normals, texture coordinates and numbers. Faces of more than three corners
    /// are drawn as the triangles of [`Mesh::face_triangles`].
    Triangles(Box<Mesh>),
    /// Places that nothing connects, with data on each.
    Points(Cloud),
    /// Chains of straight lines.
    Lines(Lines),
    /// Moves from place to place.
    Arrows(Arrows),
    /// What is to be noticed.
    Marks(Marks),
    /// Series of numbers, drawn over one axis.
    Plot(Vec<Series>),
}

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Its pixels.
    pub image: Image,
    /// Where its pixels lie on the capture's picture, if that is known: those of a range grid do.
    pub registration: Option<Registration>,
    /// Whether its colors were made up for the drawing, as those of labels are. Others are the value's own, and a file that keeps them
    /// shows as much.
    pub drawn: bool,
}

impl Picture {
    /// A picture whose colors are the value's own, as layers; none if there is none.
    pub(super) fn own<E>(image: Result<Image, E>) -> Vec<Layer> {
        image
            .into_iter()
            .map(|image| Layer::Picture(Self { image, registration: None, drawn: false }))
            .collect()
    }

    /// A picture whose colors were made up for the drawing, as layers; none if there is no picture.
    pub(super) fn drawn<E>(image: Result<Image, E>) -> Vec<Layer> {
        image
            .into_iter()
            .map(|image| Layer::Picture(Self { image, registration: None, drawn: true }))
            .collect()
    }
}

/// Which way the axes of a layer go. A mesh says it by its frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// x right, y up, z towards the viewer.
    #[default]
    Upright,
    /// The sensor's: x right, y down, z away.
    Sensor,
}

impl Axes {
    /// A place with these axes in other ones: half a turn about x leads from the sensor's to upright ones, and back.
    pub fn turned(self, place: Point3<f64>, to: Self) -> Point3<f64> {
        if self == to { place } else { Point3::new(place.x, -place.y, -place.z) }
    }
}

impl Layer {
    /// The axes of what lies in space; none of pictures and plots.
    pub fn axes(&self) -> Option<Axes> {
        match self {
            Self::Triangles(mesh) if mesh.frame().is_some() => Some(Axes::Sensor),
            Self::Triangles(_) => Some(Axes::Upright),
            Self::Points(cloud) => Some(cloud.axes),
            Self::Lines(lines) => Some(lines.axes),
            Self::Arrows(arrows) => Some(arrows.axes),
            Self::Marks(marks) => Some(marks.axes),
            Self::Picture(_) | Self::Plot(_) => None,
        }
    }
}

/// Places that nothing connects.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// The places, in mm, with data on each.
    pub points: Points,
    /// The axes.
    pub axes: Axes,
}

/// Chains of straight lines.
#[derive(Clone, Debug, PartialEq)]
pub struct Lines {
    /// The places, in mm.
    pub points: Column<Point3<f64>>,
    /// The points of each chain, by index; a closed one names its first point again.
    pub chains: Vec<Vec<u32>>,
    /// The axes.
    pub axes: Axes,
}

/// Moves from place to place: as many ends as starts.
#[derive(Clone, Debug, PartialEq)]
pub struct Arrows {
    /// Where they begin, in mm.
    pub from: Column<Point3<f64>>,
    /// Where they end.
    pub to: Column<Point3<f64>>,
    /// The axes.
    pub axes: Axes,
}

/// What is to be noticed, drawn in red, larger than all else.
#[derive(Clone, Debug, PartialEq)]
pub struct Marks {
    /// Each a place, both ends of a line, or the corners of a face, in mm.
    pub outlines: Vec<Vec<Point3<f64>>>,
    /// The axes.
    pub axes: Axes,
}

/// One series of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Where on the axis each number stands: as many as there are numbers, growing.
    pub at: Vec<f64>,
    /// The numbers; what is not finite is left out of the drawing.
    pub numbers: Vec<f64>,
}
