//! What may hold of a value beyond its type: a mesh may be closed, labels may name something.

use std::fmt;

use nalgebra::Point3;

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
    /// How many they are and which, behind the value's name: `has 3 edges with one face (vertices 0-2, 0-3, 2-3)`.
    pub what: String,
    /// Where they are, in mm: the middles of some of them. Empty where the value lies nowhere in space.
    pub places: Vec<Point3<f64>>,
}

/// How many offending elements are named.
const NAMED: usize = 5;

/// How many places are told.
const TOLD: usize = 1000;

impl Offence {
    /// That of a value that has nothing in it, where something is wanted: `has no faces`.
    pub fn nothing(what: &str) -> Self {
        Self { what: format!("has no {what}"), places: Vec::new() }
    }

    /// That of some elements, `what` they are, by their names and places; none if there are none.
    pub fn of<E: Copy>(
        elements: &[E],
        what: &str,
        name: impl Fn(E) -> String,
        place: impl Fn(E) -> Point3<f64>,
    ) -> Option<Self> {
        let first = place(*elements.first()?);
        let count = elements.len();
        let names = Vec::from_iter(elements.iter().take(NAMED).map(|element| name(*element)));
        let names = names.join(", ");
        let more = if NAMED < count { ", .." } else { "" };
        let first = [first.x, first.y, first.z].map(rounded);
        let [x, y, z] = first;
        let what = format!("has {count} {what} ({names}{more}; the first is at ({x}, {y}, {z}))");
        Some(Self { what, places: elements.iter().take(TOLD).map(|it| place(*it)).collect() })
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
