//! A step of a graph, its ports and its outputs.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use maquette_syntax::LINK;
use maquette_syntax::error::Error;
use maquette_value::{AnyValue, Value, ValueType, value_type};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::carry::Carry;
use crate::context::Context;
use crate::file::FilePath;
use crate::limit::Estimate;
use crate::previous::Previous;
use crate::terms::{Promise, Want};

/// One step of a graph, and its whole description.
///
/// A field of type [`In<T>`], `Option<In<T>>` or `Vec<In<T>>` is a port, a field of type [`FilePath`] a file to read, every
/// other field a parameter. The doc comments of the type and its fields are the user's manual; `#[schemars(range(..))]` says which
/// numbers a parameter takes, and `#[schemars(extend("unit" = "mm"))]` the unit that manual and messages print beside them.
pub trait Node: Serialize + DeserializeOwned + JsonSchema + Send + Sync + 'static {
    /// What it gives: a tuple of values.
    type Outputs: Outputs;

    /// The names of its outputs, the first being the one that a link without a name means.
    const OUTPUTS: <Self::Outputs as Outputs>::Names;

    /// What it wants of the values that come in, beyond their types.
    const WANTS: &'static [Want<Self>] = &[];

    /// What it promises of the values that it gives, beyond their types: only what holds for all values that it accepts.
    const PROMISES: &'static [Promise<Self>] = &[];

    /// What becomes of the attributes of meshes, points and range images, for each port that takes and each output that gives some.
    const CARRIES: &'static [Carry] = &[];

    /// Files that it reads if they are there, beside those that its fields name.
    fn files(&self) -> Vec<FilePath> {
        Vec::new()
    }

    /// How much memory [`eval`](Self::eval) will need at most, told before it runs; none if nobody can say. A node whose result may
    /// be much larger than its inputs says it, so that it is refused with numbers instead of the program being killed.
    ///
    /// It sees the same context, so that it knows how large the inputs are, and must be quick: it counts, and allocates nothing
    /// large. Of two runs on equal inputs it says the same.
    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let _ = cx;
        None
    }

    /// Computes the outputs: a pure function of the parameters, the inputs and the files, the same bytes for any number of
    /// threads.
    ///
    /// # Errors
    /// Whatever is wrong with the inputs; the message says what, not where.
    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error>;

    /// What [`eval`](Self::eval) gives, made of what it gave for other inputs: the very bytes, and the same warnings. For nodes that have
    /// little to do where little has changed; none where nothing is gained, so that `eval` is asked. A node that gives something for
    /// little to do where little has changed; none where nothing is gained, so that `eval` is asked. A node that gives something for
    /// unchanged inputs is held to this by `maquette::conformance`.
    ///
    /// # Errors
    /// Those of `eval`.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let _ = (cx, previous);
        Ok(None)
    }
}

/// A type that a port takes or an output gives: a [`Value`], or a [`union`](crate::union!) of some.
pub trait PortType: Sized + 'static {
    /// The name of the value or of the union.
    const NAME: &'static str;

    /// What [`Context::get`] gives: `&T` for a value, the union itself for a union.
    type Ref<'a>;

    /// The values that fit.
    fn types() -> Vec<&'static ValueType>;

    /// The value as this type, if it fits.
    fn get(value: &AnyValue) -> Option<Self::Ref<'_>>;

    /// The value for a link.
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

/// Declares a union of values, for a port that takes one of several types:
/// `union! { /// Doc. pub enum Solid { Mesh(Mesh), Surface(Surface) } }`.
///
/// An output of the same union has the type that came in.
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

/// The outputs of a node: a tuple of one to four values.
pub trait Outputs: Sized + 'static {
    /// One name per output: `[&'static str; N]`.
    type Names: AsRef<[&'static str]>;

    /// The type of each output: the name of a value or union, and the values it may be.
    fn types() -> Vec<(&'static str, Vec<&'static ValueType>)>;

    /// The values for links, in order.
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

/// A port: takes a link to a `T`.
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
        let types = Vec::from_iter(T::types().iter().map(|kind| kind.name));
        json_schema!({ "port": T::NAME, "types": types })
    }
}

pub(super) fn at_port<'a, T: PortType>(inputs: &'a [AnyValue], port: &In<T>) -> T::Ref<'a> {
    let value = &inputs[port.slot];
    T::get(value).unwrap_or_else(|| {
        panic!("a {value:?} came to a port for {}; the check lets no such graph run", T::NAME)
    })
}
