//! Predicted sizes of values. They are known before anything is computed, from the headers of files and from the laws of nodes.

use maquette_value::{
    AnyValue, ElementKind, Image, Mesh, Points, RangeImage, Value, ValueType, value_type,
};
use serde::{Deserialize, Serialize};

use crate::budget::Estimate;
use crate::file::FilePath;
use crate::port::In;

/// The source of a predicted size, the most reliable one first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Certainty {
    /// The size is stated by a file or known from an earlier result.
    Exact,
    /// The size follows from other sizes and the parameters of a node.
    Predicted,
    /// The size is a guess, such as that a result is as large as the largest input.
    Guess,
}

/// The size of a value. Counts are floating-point numbers, so that predictions do not overflow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValueSize {
    /// The number of points, vertices, cells or pixels.
    pub points: f64,
    /// The number of faces; 0 if there are none.
    pub faces: f64,
    /// The sum of the numbers of corners of all faces.
    pub corners: f64,
    /// Memory in bytes.
    pub bytes: f64,
    /// The source of these numbers.
    pub certainty: Certainty,
}

/// Memory in bytes of a position.
const POSITION: f64 = 24.0;

/// Memory in bytes of a corner of a face.
const CORNER: f64 = 4.0;

impl ValueSize {
    /// Returns the exact size of `count` items of `bytes_each` bytes, such as points or pixels.
    pub fn items(count: f64, bytes_each: f64) -> Self {
        let bytes = count * bytes_each;
        Self { points: count, faces: 0.0, corners: 0.0, bytes, certainty: Certainty::Exact }
    }

    /// Returns the exact size of `count` points with `attributes` bytes of attributes each.
    pub fn points(count: f64, attributes: f64) -> Self {
        Self::items(count, POSITION + attributes)
    }

    /// Returns the exact size of a mesh without attributes.
    pub fn mesh(vertices: f64, faces: f64, corners: f64) -> Self {
        let bytes = POSITION * vertices + CORNER * corners;
        Self { points: vertices, faces, corners, bytes, certainty: Certainty::Exact }
    }

    /// Multiplies all numbers by `factor`.
    #[must_use]
    pub fn scale(self, factor: f64) -> Self {
        let [points, faces, corners, bytes] =
            [self.points, self.faces, self.corners, self.bytes].map(|number| number * factor);
        Self { points, faces, corners, bytes, ..self }
    }

    /// Adds memory that is not in proportion to the counts, such as a texture.
    #[must_use]
    pub fn with_more_bytes(self, bytes: f64) -> Self {
        Self { bytes: self.bytes + bytes, ..self }
    }

    /// States that the size is at most as reliable as `certainty`.
    #[must_use]
    pub fn at_most(self, certainty: Certainty) -> Self {
        Self { certainty: self.certainty.max(certainty), ..self }
    }

    /// Returns the sum of two sizes, as reliable as the less reliable one.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            points: self.points + other.points,
            faces: self.faces + other.faces,
            corners: self.corners + other.corners,
            bytes: self.bytes + other.bytes,
            certainty: self.certainty.max(other.certainty),
        }
    }

    /// Returns the size of a value.
    #[doc(hidden)]
    pub fn of_value(value: &AnyValue) -> Self {
        let counts = if let Some(mesh) = value.get::<Mesh>() {
            let faces = mesh.faces();
            Self::mesh(
                mesh.positions().len() as f64,
                faces.len() as f64,
                faces.corners().len() as f64,
            )
        } else if let Some(points) = value.get::<Points>() {
            Self::points(points.positions().len() as f64, 0.0)
        } else if let Some(range) = value.get::<RangeImage>() {
            Self::points(range.points().len() as f64, 0.0)
        } else if let Some(image) = value.get::<Image>() {
            Self::items(image.pixels().len() as f64, 3.0)
        } else {
            count_columns(value)
        };
        Self { bytes: value.size() as f64, ..counts }
    }
}

/// Counts the elements of a value of any type by its columns.
fn count_columns(value: &AnyValue) -> ValueSize {
    let parts = value.parts();
    let columns = parts.columns.iter().filter(|column| {
        !column.is_hidden && !matches!(column.element_kind, ElementKind::Whole | ElementKind::Texel)
    });
    let count = columns.map(|column| column.count()).max().unwrap_or(0);
    ValueSize::items(count as f64, 0.0)
}

/// The sizes of the inputs and files of a node, before they are computed or read.
pub struct Sizes<'a> {
    #[doc(hidden)]
    pub inputs: &'a dyn Fn(usize) -> Option<ValueSize>,
    #[doc(hidden)]
    pub files: &'a dyn Fn(&FilePath, &ValueType) -> Option<ValueSize>,
}

impl Sizes<'_> {
    /// Returns the size of the value that is linked to a port. `None` if it is unknown.
    pub fn get<T>(&self, port: &In<T>) -> Option<ValueSize> {
        (self.inputs)(port.slot)
    }

    /// Returns the size of the value in the file whose path is in the field `path`, as the header of the file states it. `None` if the file
    /// does not state it or cannot be read.
    pub fn file<T: Value>(&self, path: &FilePath) -> Option<ValueSize> {
        (self.files)(path, value_type::<T>())
    }
}

/// The sizes of the results of a node and its memory, before it runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecast {
    /// The size of each output, in order. `None` for an output whose size is unknown.
    pub outputs: Vec<Option<ValueSize>>,
    /// An upper bound of the memory of the node, as [`Node::estimate`](crate::Node::estimate) returns it. `None` if it is unknown.
    pub memory: Option<Estimate>,
}

impl Forecast {
    /// Creates the forecast of a node with these outputs, which needs little more memory than its results.
    pub fn new<const N: usize>(outputs: [Option<ValueSize>; N]) -> Self {
        Self { outputs: outputs.into(), memory: None }
    }

    /// Creates the forecast of a node whose only output follows from the sizes of its inputs by a law.
    pub fn by_law(output: ValueSize) -> Self {
        Self::new([Some(output.at_most(Certainty::Predicted))])
    }

    /// Adds the memory in bytes that the node needs. `help` is the help text of the error, such as `choose fewer \`levels\``.
    #[must_use]
    pub fn with_memory(self, bytes: f64, help: &'static str) -> Self {
        Self { memory: Some(Estimate { bytes, help }), ..self }
    }
}

/// The start of a file, from which a reader tells the size of the value in it.
pub struct FileHead<'a> {
    /// The extension of the file, in lower case and without the dot.
    pub extension: &'a str,
    /// The length of the file in bytes.
    pub length: u64,
    /// The first bytes of the file, at most [`FileHead::START`].
    pub start: &'a [u8],
    #[doc(hidden)]
    pub read_at: &'a dyn Fn(u64, usize) -> Option<Vec<u8>>,
}

impl FileHead<'_> {
    /// The number of bytes in [`start`](Self::start), if the file has as many.
    pub const START: usize = 1 << 16;

    /// Returns at most `count` bytes from the position `offset`. Fewer if the file ends there, and `None` if it cannot be read.
    pub fn read_at(&self, offset: u64, count: usize) -> Option<Vec<u8>> {
        (self.read_at)(offset, count)
    }
}
