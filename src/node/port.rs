//! The ports and outputs of a node.
//!
//! The `In<T>` of a port contains the index of the port's link. It is serialized as `{"$link": n}`. In the cache key of the node, the hash
//! of the linked value takes the place of this index. A link can be anywhere in the fields of a node.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use maquette_syntax::LINK;
use maquette_value::{AnyValue, Value, ValueType, value_type};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// The type of a port or an output: a [`Value`] type, or a [`union`](crate::union!) of several value types.
pub trait PortType: Sized + 'static {
    /// The name of the value type or of the union.
    const NAME: &'static str;

    /// The type that [`Context::get`](crate::Context::get) returns: `&T` for a value type `T`, and the union itself for a union.
    type Ref<'a>;

    /// Returns the value types that this type accepts.
    fn types() -> Vec<&'static ValueType>;

    /// Converts a value to this type. `None` if the type does not accept it.
    fn get(value: &AnyValue) -> Option<Self::Ref<'_>>;

    /// Converts an output of this type to a value that links can pass on.
    fn into_any(self) -> AnyValue;
}

impl<T: Value> PortType for T {
    const NAME: &'static str = T::NAME;

    type Ref<'a> = &'a T;

    fn types() -> Vec<&'static ValueType> {
        vec![value_type::<T>()]
    }

    fn get(value: &AnyValue) -> Option<&T> {
        value.get()
    }

    fn into_any(self) -> AnyValue {
        AnyValue::new(self)
    }
}

/// Declares a union of value types, for a port that takes values of several types:
/// `union! { /// Doc. pub enum Solid { Mesh(Mesh), Surface(Surface) } }`.
///
/// If a node has an output and an input of the same union, the type of the output is that of the input's value.
#[macro_export]
macro_rules! union {
    ($(#[$doc:meta])* $vis:vis enum $name:ident { $($variant:ident($value:ty)),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Debug)]
        $vis enum $name {
            $(#[doc = concat!("A `", stringify!($variant), "`.")] $variant($value)),+
        }

        impl $crate::PortType for $name {
            const NAME: &'static str = stringify!($name);

            type Ref<'a> = Self;

            fn types() -> Vec<&'static $crate::ValueType> {
                vec![$($crate::value_type::<$value>()),+]
            }

            fn get(value: &$crate::AnyValue) -> Option<Self> {
                $(if let Some(value) = value.get::<$value>() {
                    return Some(Self::$variant(value.clone()));
                })+
                None
            }

            fn into_any(self) -> $crate::AnyValue {
                match self {
                    $(Self::$variant(value) => $crate::AnyValue::new(value)),+
                }
            }
        }
    };
}

/// The outputs of a node, as a tuple of one to four values.
pub trait Outputs: Sized + 'static {
    /// The type of the array of output names: `[&'static str; N]` for `N` outputs.
    type Names: AsRef<[&'static str]>;

    /// For each output, returns the name of its value type or union, and the types that its values can have.
    fn types() -> Vec<(&'static str, Vec<&'static ValueType>)>;

    /// Converts the outputs, in order, to values that links can pass on.
    fn into_any(self) -> Vec<AnyValue>;
}

macro_rules! outputs {
    ($count:literal: $($type:ident $index:tt),+) => {
        impl<$($type: PortType),+> Outputs for ($($type,)+) {
            type Names = [&'static str; $count];

            fn types() -> Vec<(&'static str, Vec<&'static ValueType>)> {
                vec![$(($type::NAME, $type::types())),+]
            }

            fn into_any(self) -> Vec<AnyValue> {
                vec![$(self.$index.into_any()),+]
            }
        }
    };
}

outputs!(1: A 0);
outputs!(2: A 0, B 1);
outputs!(3: A 0, B 1, C 2);
outputs!(4: A 0, B 1, C 2, D 3);

/// A port of a node. It takes a link to a value of type `T`.
pub struct In<T> {
    pub(super) slot: usize,
    marker: PhantomData<fn() -> T>,
}

impl<T> Clone for In<T> {
    fn clone(&self) -> Self {
        Self { slot: self.slot, marker: PhantomData }
    }
}

impl<T> fmt::Debug for In<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "In({})", self.slot)
    }
}

impl<T> Serialize for In<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        BTreeMap::from([(LINK, self.slot)]).serialize(serializer)
    }
}

impl<'de, T> Deserialize<'de> for In<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Slot;
        impl<'de> de::Visitor<'de> for Slot {
            type Value = usize;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a link")
            }

            fn visit_u64<E: de::Error>(self, slot: u64) -> Result<usize, E> {
                usize::try_from(slot).map_err(E::custom)
            }
        }
        let slot = deserializer.deserialize_newtype_struct(LINK, Slot)?;
        Ok(Self { slot, marker: PhantomData })
    }
}

impl<T: PortType> JsonSchema for In<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("In<{}>", T::NAME).into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let types: Vec<_> = T::types().iter().map(|kind| kind.name).collect();
        json_schema!({ "port": T::NAME, "types": types })
    }
}

pub(super) fn value_at<'a, T: PortType>(inputs: &'a [AnyValue], port: &In<T>) -> T::Ref<'a> {
    let value = &inputs[port.slot];
    T::get(value).unwrap_or_else(|| {
        panic!("a {value:?} came to a port for {}; the check lets no such graph run", T::NAME)
    })
}
