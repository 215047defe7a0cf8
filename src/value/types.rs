//! The list of the engine's value types.

use super::{
    ControlNet, Curve, Direction, Field, Handles, Image, KnotVector, Labels, Mask, Mesh, Points,
    RangeImage, Region, Surface, Trace, ValueType, value_type,
};

/// The value types of the engine itself, without those of packs.
pub const TYPES: &[&ValueType] = &[
    value_type::<Mesh>(),
    value_type::<Surface>(),
    value_type::<RangeImage>(),
    value_type::<ControlNet>(),
    value_type::<Curve>(),
    value_type::<Points>(),
    value_type::<Region>(),
    value_type::<Image>(),
    value_type::<Mask>(),
    value_type::<Labels>(),
    value_type::<Field>(),
    value_type::<Trace>(),
    value_type::<KnotVector>(),
    value_type::<Direction>(),
    value_type::<Handles>(),
];
