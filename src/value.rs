//! What travels on a link: immutable, typed, hashed once.
//!
//! A noun of the graph implements [`Value`]; on a link it is an [`AnyValue`], which knows its type and the hash of its
//! content. Large parts of a value are [`Column`]s, shared between values and hashed apart, so that a node that moves
//! vertices neither copies nor hashes the faces again.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

mod attributes;
mod column;
mod control_net;
mod curve;
mod direction;
mod field;
mod frame;
mod image;
mod knots;
mod labels;
mod mask;
mod mesh;
mod points;
mod range;
mod region;
mod surface;

pub use attributes::{Attribute, AttributeError, Attributes};
pub use column::Column;
pub use control_net::{Chart, ControlNet, ControlNetError};
pub use curve::{Curve, CurveError};
pub use direction::{Direction, DirectionError};
pub use field::Field;
pub use frame::{CaptureFrame, Pinhole, Registration};
pub use image::{Color, ColorError, Image, Lab, Rgb, SizeError};
pub(crate) use image::{linear_from_srgb, srgb_from_linear};
pub use knots::{KnotChange, KnotVector, KnotVectorError};
pub use labels::{LabelRun, LabelStatistics, Labels, LabelsError};
pub use mask::Mask;
pub use mesh::{Edges, Faces, Mesh, MeshError};
pub use points::{Points, PointsError};
pub use range::{RangeError, RangeImage};
pub use region::{Contour, Region, RegionError};
pub use surface::{Along, Derivatives, Foot, IsoCurve, Surface, SurfaceError};

/// A noun of the graph: what a port takes and an output gives.
pub trait Value: Clone + Send + Sync + 'static {
    /// The word in graph files and messages, in CamelCase: `RangeImage`.
    const NAME: &'static str;

    /// Writes the whole content, in one fixed order: equal content, equal hash, and nothing else.
    fn encode(&self, to: &mut Encoder);

    /// How much memory the value holds, in bytes.
    fn size(&self) -> usize;

    /// What a reader wants to know first: counts, bounds, topology; one labelled fact a row.
    fn describe(&self) -> Summary;

    /// What is at the picture's pixel `at` (column, row); empty where the value has no pixels.
    fn probe(&self, at: [usize; 2]) -> Summary {
        let _ = at;
        Summary::default()
    }
}

/// Labelled facts in reading order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary(pub Vec<(String, serde_json::Value)>);

impl Summary {
    /// Adds one fact.
    #[must_use]
    pub fn with(mut self, label: &str, fact: impl Into<serde_json::Value>) -> Self {
        self.0.push((label.to_owned(), fact.into()));
        self
    }

    /// Adds how often numbers fall into each of 32 equal parts of their range: `{"from", "to", "counts"}`. Numbers that are not
    /// finite do not count; without any other there is no such fact.
    #[must_use]
    pub fn with_histogram(self, label: &str, numbers: impl Iterator<Item = f64> + Clone) -> Self {
        const PARTS: usize = 32;
        let finite = numbers.filter(|x| x.is_finite());
        let start = (f64::INFINITY, f64::NEG_INFINITY);
        let (from, to) = finite.clone().fold(start, |(lo, hi), x| (lo.min(x), hi.max(x)));
        if to < from {
            return self;
        }
        let mut counts = vec![0u64; PARTS];
        for x in finite {
            let part = (x - from) / (to - from) * PARTS as f64;
            // All numbers equal: NaN, which becomes part 0.
            counts[(part as usize).min(PARTS - 1)] += 1;
        }
        self.with(label, serde_json::json!({ "from": from, "to": to, "counts": counts }))
    }
}

/// The blake3 hash of a value's content.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Hash(pub(crate) [u8; 32]);

impl Hash {
    /// The hash of some bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The first 12 hexadecimal digits: enough to tell values apart by eye.
    pub fn short(&self) -> String {
        self.to_string()[..12].to_owned()
    }
}

impl fmt::Display for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.short())
    }
}

/// Takes the content of a value, part by part.
///
/// Each part is written with its length, so that no two different contents look alike.
pub struct Encoder {
    hasher: blake3::Hasher,
}

impl Encoder {
    fn new(type_name: &str) -> Self {
        let mut encoder = Self { hasher: blake3::Hasher::new() };
        encoder.text(type_name);
        encoder
    }

    /// Writes a few bytes of plain data: numbers, points, small arrays of them.
    pub fn plain<T: bytemuck::NoUninit>(&mut self, part: &T) -> &mut Self {
        self.bytes(bytemuck::bytes_of(part))
    }

    /// Writes sizes and counts, the same on machines of every word length.
    pub fn counts(&mut self, part: &[usize]) -> &mut Self {
        part.iter().for_each(|&count| {
            self.plain(&(count as u64));
        });
        self
    }

    /// Writes a text.
    pub fn text(&mut self, part: &str) -> &mut Self {
        self.bytes(part.as_bytes())
    }

    /// Writes a column by its hash, which is computed once and shared with every value that holds the column.
    pub fn column<T: bytemuck::NoUninit + Send + Sync>(&mut self, part: &Column<T>) -> &mut Self {
        self.bytes(&part.hash().0)
    }

    /// Writes another value that is part of this one.
    pub fn value<T: Value>(&mut self, part: &T) -> &mut Self {
        self.bytes(&hash_of(part).0)
    }

    /// Writes a part that may be absent.
    pub fn option<T>(&mut self, part: Option<&T>, write: impl FnOnce(&mut Self, &T)) -> &mut Self {
        self.plain(&u8::from(part.is_some()));
        if let Some(part) = part {
            write(self, part);
        }
        self
    }

    fn bytes(&mut self, part: &[u8]) -> &mut Self {
        self.hasher.update(&(part.len() as u64).to_le_bytes());
        self.hasher.update(part);
        self
    }
}

/// The hash of a value's type and content.
pub fn hash_of<T: Value>(value: &T) -> Hash {
    let mut encoder = Encoder::new(T::NAME);
    value.encode(&mut encoder);
    Hash(*encoder.hasher.finalize().as_bytes())
}

/// What the engine knows of a type of values. Made by [`value_type`]; a pack lists the types that it brings.
#[derive(Clone, Copy)]
pub struct ValueType {
    /// The word in graph files.
    pub name: &'static str,
    describe: fn(&(dyn Any + Send + Sync)) -> Summary,
    probe: fn(&(dyn Any + Send + Sync), [usize; 2]) -> Summary,
    size: fn(&(dyn Any + Send + Sync)) -> usize,
}

impl fmt::Debug for ValueType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for ValueType {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

struct TypeOf<T>(std::marker::PhantomData<T>);

impl<T: Value> TypeOf<T> {
    const TYPE: ValueType = ValueType {
        name: T::NAME,
        describe: |value| downcast::<T>(value).describe(),
        probe: |value, at| downcast::<T>(value).probe(at),
        size: |value| downcast::<T>(value).size(),
    };
}

fn downcast<T: Value>(value: &(dyn Any + Send + Sync)) -> &T {
    value.downcast_ref().unwrap_or_else(|| {
        panic!("two types of values are called {}; conformance::check finds this", T::NAME)
    })
}

/// The description of `T` for the engine.
pub const fn value_type<T: Value>() -> &'static ValueType {
    &TypeOf::<T>::TYPE
}

/// A value on a link: shared, of a known type, with the hash of its content.
#[derive(Clone)]
pub struct AnyValue {
    kind: &'static ValueType,
    hash: Hash,
    value: Arc<dyn Any + Send + Sync>,
}

impl AnyValue {
    /// Shares `value`; hashes it once, here.
    pub fn new<T: Value>(value: T) -> Self {
        Self { kind: value_type::<T>(), hash: hash_of(&value), value: Arc::new(value) }
    }

    /// Its type.
    pub fn kind(&self) -> &'static ValueType {
        self.kind
    }

    /// The hash of its type and content.
    pub fn hash(&self) -> Hash {
        self.hash
    }

    /// The value itself, if it is a `T`.
    pub fn get<T: Value>(&self) -> Option<&T> {
        self.value.downcast_ref()
    }

    /// How much memory it holds, in bytes.
    pub fn size(&self) -> usize {
        (self.kind.size)(&*self.value)
    }

    /// What a reader wants to know first.
    pub fn describe(&self) -> Summary {
        (self.kind.describe)(&*self.value)
    }

    /// What is at the picture's pixel `at` (column, row).
    pub fn probe(&self, at: [usize; 2]) -> Summary {
        (self.kind.probe)(&*self.value, at)
    }
}

impl fmt::Debug for AnyValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}({})", self.kind.name, self.hash.short())
    }
}
