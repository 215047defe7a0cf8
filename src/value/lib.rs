//! The values that travel along the links of a graph. They are immutable and typed, and each is hashed only once.
//!
//! [`Value`] is the trait of value types. On a link a value is an [`AnyValue`], which knows its type and the hash of its content. Large
//! parts of a value are [`Column`]s, which are shared between values and hashed separately. For example, a node that moves vertices passes
//! on the column of faces, which is neither copied nor hashed again.
//!
//! Begin reading in `value.rs`, then `column.rs` and `mesh.rs`. Each value type has one file, which also states the invariant that the
//! type's constructor checks. The other modules are tools for all kernels: parallel loops ([`parallel`]), vector instructions ([`simd`]),
//! large lists ([`memory`]), reproducible random numbers ([`rng`]), and reading of regular files ([`fs`]).
//!
//! This crate depends on no graph, no node and no file format.

pub mod fs;
pub mod memory;
pub mod parallel;
pub mod polygon;
pub mod rng;
pub mod simd;

mod attributes;
mod boxes;
mod column;
mod content;
mod control_net;
mod counts;
mod curve;
mod direction;
mod edge_cases;
mod elements;
mod encoding;
mod field;
mod frame;
mod handles;
mod hash;
mod image;
mod key_chunks;
mod knots;
mod labels;
mod layer;
mod mask;
mod material;
mod memo;
mod mesh;
mod parts;
mod point_blocks;
mod points;
mod property;
mod range;
mod region;
mod summary;
mod surface;
mod topology;
mod trace;
mod types;
mod union_find;
mod value;

pub use attributes::{Attribute, AttributeError, Attributes};
pub use boxes::{Bounds, BoxTree};
pub use column::Column;
pub use control_net::{Chart, ControlNet, ControlNetError};
pub use counts::value_counts;
pub use curve::{Curve, CurveError, CurveFoot};
pub use direction::{Direction, DirectionError};
pub use elements::{Elements, NoElements};
pub use encoding::{Bytes, Columns, DecodeError, Decoder, EncodedValue, Encoder, hash_of};
pub use field::Field;
pub use frame::{CaptureFrame, Pinhole, Registration};
pub use handles::{Handle, HandleSpace, Handles, HandlesError};
pub use hash::Hash;
pub(crate) use hash::SEVERAL_THREADS;
pub use image::{
    Color, ColorError, Image, Lab, Rgb, SizeError, linear_from_srgb, srgb_from_linear,
};
pub use key_chunks::KeyChunks;
pub use knots::{KnotChange, KnotVector, KnotVectorError};
pub use labels::{LabelRun, LabelStatistics, Labels, LabelsError};
pub use layer::{Arrows, Axes, BACKGROUND, Cloud, Layer, Lines, Marks, Picture, Series};
pub use mask::Mask;
pub use material::{Map, MapKind, Material, Transparency, UvTransform, Wrap};
pub use memo::{Memo, hash_of_memo};
pub use mesh::{
    Backing, DistinctPositions, Edges, Faces, MATERIAL_ATTRIBUTE, Mesh, MeshError, MovedRows,
    NearestPoint, RayHit, TriangleTree, bounds, closest_on_triangle,
};
pub use parts::{
    ElementKind, Fact, FactValue, Items, Meaning, Part, Parts, PartsError, Range, ranges,
};
pub use point_blocks::{BlocksDiffer, PointsDigest, PointsHasher};
pub use points::{Points, PointsError, first_not_finite};
pub use property::{Property, ViolatingElement, Violation};
pub use range::{RangeError, RangeImage, SeamGaps};
pub use region::{Contour, Region, RegionError};
pub use summary::Summary;
pub use surface::{Derivatives, Foot, IsoCurve, ParameterDirection, Surface, SurfaceError};
pub use topology::{Extent, Topology, border, border_loops};
pub use trace::{Trace, TraceError, TraceStep};
pub use types::TYPES;
pub use value::{AnyValue, Value, ValueType, value_type};
