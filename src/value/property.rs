//! Properties of values that their type does not imply: a mesh may be closed, labels may be non-empty.

use std::fmt;

use nalgebra::Point3;

use super::{Axes, Layer, Marks};

/// A property of values of the type `T`. A port can require it, and an output can promise it.
#[derive(Clone, Copy)]
pub struct Property<T: 'static> {
    /// The property's name in graph files, in CamelCase: `Closed`.
    pub name: &'static str,
    /// A description of the property in one sentence.
    pub doc: &'static str,
    /// Checks a value. Returns the violation, or `None` if the value has the property.
    pub test: fn(&T) -> Option<Violation>,
}

impl<T> Property<T> {
    /// Builds a property from its name, description and check.
    pub const fn new(
        name: &'static str,
        doc: &'static str,
        test: fn(&T) -> Option<Violation>,
    ) -> Self {
        Self { name, doc, test }
    }
}

/// The elements of a value that violate a property.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// The text of the message after the name of the value: `has 3 edges with one face (edge 0-2, edge 0-3, edge 2-3)`.
    pub what: String,
    /// The number of violating elements. 0 if the property is violated because something is missing.
    pub count: usize,
    /// The first violating elements, at most `MAX_LISTED`. Empty if the value has no positions in space.
    pub elements: Vec<ViolatingElement>,
}

/// An element that violates a property.
#[derive(Clone, Debug, PartialEq)]
pub struct ViolatingElement {
    /// The element's name: `edge 0-2`.
    pub name: String,
    /// The outline of the element, in mm: a vertex, the two ends of an edge, or the corners of a face.
    pub outline: Vec<Point3<f64>>,
}

impl ViolatingElement {
    /// The mean of the points of the outline.
    pub fn center(&self) -> Point3<f64> {
        let sum: nalgebra::Vector3<f64> = self.outline.iter().map(|point| point.coords).sum();
        Point3::from(sum / self.outline.len().max(1) as f64)
    }
}

/// The maximum number of elements that a message names.
const MAX_NAMED: usize = 5;

/// The maximum number of elements that are listed, and are marked in pictures.
const MAX_LISTED: usize = 5000;

impl Violation {
    /// Returns the violation by an empty value: `has no faces` if `what` is `faces`.
    pub fn lack_of(what: &str) -> Self {
        Self { what: format!("has no {what}"), count: 0, elements: Vec::new() }
    }

    /// Returns the violation by the given elements, with their names and outlines. `what` describes the elements. `None` if there are no
    /// elements.
    pub fn from_elements<E: Copy>(
        elements: &[E],
        what: &str,
        name: impl Fn(E) -> String,
        outline: impl Fn(E) -> Vec<Point3<f64>>,
    ) -> Option<Self> {
        let count = elements.len();
        let listed = elements.iter().take(MAX_LISTED);
        let elements = listed
            .map(|&it| ViolatingElement { name: name(it), outline: outline(it) })
            .collect::<Vec<_>>();
        let [x, y, z] = elements.first()?.center().coords.map(round_coordinate).into();
        let names =
            elements.iter().take(MAX_NAMED).map(|it| &it.name[..]).collect::<Vec<_>>().join(", ");
        let more = if MAX_NAMED < count { ", .." } else { "" };
        let what = format!("has {count} {what} ({names}{more}; the first is at ({x}, {y}, {z}))");
        Some(Self { what, count, elements })
    }

    /// Adds a layer that marks the elements to the layers of the value.
    pub fn mark(&self, layers: &mut Vec<Layer>) {
        let axes: Axes = layers.iter().find_map(Layer::axes).unwrap_or_default();
        let outlines: Vec<_> = self.elements.iter().map(|it| it.outline.clone()).collect();
        if !outlines.is_empty() {
            layers.push(Layer::Marks(Marks { outlines, axes }));
        }
    }
}

/// Rounds to a thousandth of a millimeter.
fn round_coordinate(x: f64) -> f64 {
    (x * 1000.0).round() / 1000.0 + 0.0
}

impl<T> fmt::Debug for Property<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}
