//! What may hold of a value beyond its type: a mesh may be closed, labels may name something.

use std::fmt;

use nalgebra::Point3;

use super::{Axes, Layer, Marks};

/// Something that may hold of a value of the type `T`: a port may want it, and an output promise it.
#[derive(Clone, Copy)]
pub struct Property<T: 'static> {
    /// The word in graph files, in CamelCase: `Closed`.
    pub name: &'static str,
    /// What it means, in a sentence.
    pub doc: &'static str,
    /// What stands against it; none if it holds.
    pub test: fn(&T) -> Option<Offence>,
}

impl<T> Property<T> {
    /// The property of this name.
    pub const fn new(
        name: &'static str,
        doc: &'static str,
        test: fn(&T) -> Option<Offence>,
    ) -> Self {
        Self { name, doc, test }
    }
}

/// The elements of a value for which a property does not hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Offence {
    /// How many they are and which, behind the value's name: `has 3 edges with one face (edge 0-2, edge 0-3, edge 2-3)`.
    pub what: String,
    /// How many they are; 0 if something is missing.
    pub count: usize,
    /// The first of them, some thousands at most. Empty where the value lies nowhere in space.
    pub elements: Vec<Offender>,
}

/// An element for which a property does not hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Offender {
    /// Which it is: `edge 0-2`.
    pub name: String,
    /// A vertex, both ends of an edge, or the corners of a face, in mm.
    pub outline: Vec<Point3<f64>>,
}

impl Offender {
    /// Its middle.
    pub fn place(&self) -> Point3<f64> {
        let sum: nalgebra::Vector3<f64> = self.outline.iter().map(|point| point.coords).sum();
        Point3::from(sum / self.outline.len().max(1) as f64)
    }
}

/// How many offending elements are named.
const NAMED: usize = 5;

/// How many are told as data, and so marked in pictures.
const TOLD: usize = 5000;

impl Offence {
    /// That of a value that has nothing in it, where something is wanted: `has no faces`.
    pub fn nothing(what: &str) -> Self {
        Self { what: format!("has no {what}"), count: 0, elements: Vec::new() }
    }

    /// That of some elements, `what` they are, by their names and outlines; none if there are none.
    pub fn of<E: Copy>(
        elements: &[E],
        what: &str,
        name: impl Fn(E) -> String,
        outline: impl Fn(E) -> Vec<Point3<f64>>,
    ) -> Option<Self> {
        let count = elements.len();
        let told = elements.iter().take(TOLD);
        let elements =
            told.map(|&it| Offender { name: name(it), outline: outline(it) }).collect::<Vec<_>>();
        let [x, y, z] = elements.first()?.place().coords.map(rounded).into();
        let names =
            elements.iter().take(NAMED).map(|it| &it.name[..]).collect::<Vec<_>>().join(", ");
        let more = if NAMED < count { ", .." } else { "" };
        let what = format!("has {count} {what} ({names}{more}; the first is at ({x}, {y}, {z}))");
        Some(Self { what, count, elements })
    }

    /// Marks the elements on what is seen of the value.
    pub fn mark(&self, layers: &mut Vec<Layer>) {
        let axes: Axes = layers.iter().find_map(Layer::axes).unwrap_or_default();
        let outlines: Vec<_> = self.elements.iter().map(|it| it.outline.clone()).collect();
        if !outlines.is_empty() {
            layers.push(Layer::Marks(Marks { outlines, axes }));
        }
    }
}

/// To a thousandth of a millimeter: enough to find a place.
fn rounded(x: f64) -> f64 {
    (x * 1000.0).round() / 1000.0 + 0.0
}

impl<T> fmt::Debug for Property<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}
