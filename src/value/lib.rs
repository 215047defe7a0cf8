//! What travels on a link: immutable values, typed, hashed once.
//!
//! [`Value`] is what a noun of the graph implements; on a link it is an [`AnyValue`], which knows its type and the hash of its
//! content. Large parts of a value are [`Column`]s, shared between values and hashed apart, so that a node that moves
//! vertices neither copies nor hashes the faces again.
//!
//! Begin reading in `value.rs`, then `column.rs` and `mesh.rs`: each type has one file, with the invariant that its constructor
//! checks. Beside the types stands what every kernel works with: loops on all threads ([`parallel`]), vector instructions
//! ([`simd`]), large lists ([`memory`]), reproducible random numbers, and reading of plain files.
//!
//! This crate knows no graph, no node and no file format.

pub mod memory;
pub mod parallel;
pub mod plain;
pub mod polygon;
pub mod random;
pub mod simd;

mod attributes;
mod boxes;
mod column;
mod control_net;
mod counts;
mod curve;
mod direction;
mod elements;
mod encoding;
mod field;
mod frame;
mod handles;
mod hash;
mod hostile;
mod image;
mod knots;
mod labels;
mod layer;
mod mask;
mod material;
mod memo;
mod mesh;
mod parts;
mod points;
mod property;
mod range;
mod region;
mod summary;
mod surface;
mod topology;
mod trace;
mod types;
mod value;

pub use attributes::{Attribute, AttributeError, Attributes};
pub use boxes::{Bounds, BoxTree};
pub use column::Column;
pub use control_net::{Chart, ControlNet, ControlNetError};
pub use counts::counted;
pub use curve::{Curve, CurveError, CurveFoot};
pub use direction::{Direction, DirectionError};
pub use elements::{Elements, NoElements};
pub use encoding::{Bytes, Columns, DecodeError, Decoder, Encoder, Kept, hash_of};
pub use field::Field;
pub use frame::{CaptureFrame, Pinhole, Registration};
pub use handles::{Handle, HandleSpace, Handles, HandlesError};
pub use hash::Hash;
pub(crate) use hash::SEVERAL_THREADS;
pub use image::{
    Color, ColorError, Image, Lab, Rgb, SizeError, linear_from_srgb, srgb_from_linear,
};
pub use knots::{KnotChange, KnotVector, KnotVectorError};
pub use labels::{LabelRun, LabelStatistics, Labels, LabelsError};
pub use layer::{Arrows, Axes, Cloud, Layer, Lines, Marks, PLAIN, Picture, Series};
pub use mask::Mask;
pub use material::{Map, MapKind, Material, Transparency, UvTransform, Wrap};
pub use memo::{Memo, hash_of_memo};
pub use mesh::{
    Behind, Edges, Faces, MATERIAL, Mesh, MeshError, Moved, NearestPlace, RayHit, TriangleTree,
    bounds, to_triangle,
};
pub use parts::{Fact, FactValue, Items, Meaning, On, Part, Parts, PartsError, Range, ranges};
pub use points::{Points, PointsError, first_not_finite};
pub use property::{Offence, Offender, Property};
pub use range::{RangeError, RangeImage};
pub use region::{Contour, Region, RegionError};
pub use summary::Summary;
pub use surface::{Along, Derivatives, Foot, IsoCurve, Surface, SurfaceError};
pub use topology::{Extent, Topology, border, border_loops};
pub use trace::{Trace, TraceError, TraceStep};
pub use types::TYPES;
pub use value::{AnyValue, Value, ValueType, value_type};
