//! Layers: the drawable representations of a value.
//!
//! Viewers draw layers, not types of values, so that the values of a plugin are shown like those of the engine. A layer shares memory with
//! its value where both hold the same data.

use nalgebra::Point3;

use super::{Column, Image, Mesh, Points, Registration, Rgb};

/// The background color. Drawn pictures also use it for pixels that show nothing.
pub const BACKGROUND: Rgb = [24, 26, 32];

/// A layer: one drawing of a value. If a value has several layers that belong together, the most important one comes first.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// A picture with one pixel for each pixel or cell of the value.
    Picture(Picture),
    /// Faces: a mesh with its attributes (colors, normals, texture coordinates, numbers). A face of more than three corners is drawn as the
    /// triangles of [`Mesh::face_triangles`].
    Triangles(Box<Mesh>),
    /// Unconnected points with attributes.
    Points(Cloud),
    /// Polylines in space.
    Lines(Lines),
    /// Arrows from point to point.
    Arrows(Arrows),
    /// Marks that highlight elements.
    Marks(Marks),
    /// Series of numbers, plotted over a common axis.
    Plot(Vec<Series>),
}

/// A picture layer: pixels, with their relation to the capture's picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// The pixels of the layer.
    pub image: Image,
    /// The map from the layer's pixels to the capture's picture, if known. The layer of a range image has such a map.
    pub registration: Option<Registration>,
    /// True if the colors were chosen for the drawing, as for labels. False if they are the value's own colors; then an image file of the
    /// value has the same colors.
    pub has_false_colors: bool,
}

impl Picture {
    /// A layer with a picture in the value's own colors; no layer if `image` is an error.
    pub(super) fn from_true_colors<E>(image: Result<Image, E>) -> Vec<Layer> {
        image
            .into_iter()
            .map(|image| {
                Layer::Picture(Self { image, registration: None, has_false_colors: false })
            })
            .collect()
    }

    /// A layer with a picture whose colors were chosen for the drawing; no layer if `image` is an error.
    pub(super) fn from_false_colors<E>(image: Result<Image, E>) -> Vec<Layer> {
        image
            .into_iter()
            .map(|image| Layer::Picture(Self { image, registration: None, has_false_colors: true }))
            .collect()
    }
}

/// The directions of a layer's axes. The axes of a mesh follow from its frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// x right, y up, z towards the viewer.
    #[default]
    Upright,
    /// The sensor's axes: x right, y down, z away.
    Sensor,
}

impl Axes {
    /// Converts a point from the axes `self` to the axes `to`. The sensor's axes and the upright axes differ by half a rotation about x.
    pub fn convert(self, point: Point3<f64>, to: Self) -> Point3<f64> {
        if self == to { point } else { Point3::new(point.x, -point.y, -point.z) }
    }
}

impl Layer {
    /// The axes of a spatial layer. `None` for pictures and plots.
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

/// Unconnected points with attributes.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// The points, in mm, with their attributes.
    pub points: Points,
    /// The axes in which the points are given.
    pub axes: Axes,
}

/// Polylines in space, which share one list of points.
#[derive(Clone, Debug, PartialEq)]
pub struct Lines {
    /// The points of all polylines, in mm.
    pub points: Column<Point3<f64>>,
    /// For each polyline, the indices of its points. A closed polyline repeats its first index.
    pub chains: Vec<Vec<u32>>,
    /// The axes in which the points are given.
    pub axes: Axes,
}

/// Arrows from point to point. The lists of starts and ends have the same length.
#[derive(Clone, Debug, PartialEq)]
pub struct Arrows {
    /// The start of each arrow, in mm.
    pub from: Column<Point3<f64>>,
    /// The end of each arrow, in mm.
    pub to: Column<Point3<f64>>,
    /// The axes in which the starts and ends are given.
    pub axes: Axes,
}

/// Marks that highlight elements, drawn in red and larger than everything else.
#[derive(Clone, Debug, PartialEq)]
pub struct Marks {
    /// The outline of each mark, in mm: a point, the two ends of a line, or the corners of a face.
    pub outlines: Vec<Vec<Point3<f64>>>,
    /// The axes in which the outlines are given.
    pub axes: Axes,
}

/// A list of numbers that a plot shows over its axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The name of the series, which viewers show next to the plot.
    pub name: String,
    /// The position on the axis of each number, in ascending order.
    pub at: Vec<f64>,
    /// The numbers; those that are not finite are not drawn.
    pub numbers: Vec<f64>,
}
