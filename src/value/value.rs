//! What a type of values says of itself, and a value whose type is known at run time.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

use crate::elements::{Cut, ElementType, Elements};
use crate::encoding::{Columns, DecodeError, Decoder, Encoder, Kept, hash_of};
use crate::hash::Hash;
use crate::layer::Layer;
use crate::mesh::Mesh;
use crate::parts::{Parts, PartsError};
use crate::property::{Offence, Property};
use crate::summary::Summary;
use crate::{elements, encoding};

/// A noun of the graph: what a port takes and an output gives. It says everything about itself: its file is all there is to a type.
pub trait Value: Clone + Send + Sync + 'static {
    /// The word in graph files and messages, in CamelCase: `RangeImage`.
    const NAME: &'static str;

    /// Writes the whole content, in one fixed order: equal content, equal hash, and nothing else.
    fn encode(&self, to: &mut Encoder);

    /// Reads the content back, part by part as [`Value::encode`] wrote it; its bytes are known to be unchanged.
    ///
    /// A type that leaves this out is never answered from the disk cache.
    ///
    /// # Errors
    /// If the content is not what `encode` writes.
    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let _ = from;
        Err(DecodeError)
    }

    /// How much memory the value holds, in bytes.
    /// That includes memory that is reserved for more items. Memory that two values share counts for both.
    fn size(&self) -> usize;

    /// What a reader wants to know first: counts, bounds, topology; one labelled fact a row.
    fn describe(&self) -> Summary;

    /// What is at the picture's pixel `at` (column, row); empty where the value has no pixels.
    fn probe(&self, at: [usize; 2]) -> Summary {
        let _ = at;
        Summary::default()
    }

    /// Everything that it is made of, as named columns of numbers and facts, without copies where it holds numbers side by side. Tests
    /// compare these; a value without any is compared by what [`describe`](Value::describe) says.
    fn parts(&self) -> Parts<'_>;

    /// The value that is made of these parts, as [`parts`](Value::parts) names them; columns that a value need not have may be left out,
    /// and numbers may be of any width.
    ///
    /// # Errors
    /// If a part is missing, of the wrong shape, or holds what its type does not allow; in any case if the type leaves this out.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let _ = parts;
        Err(PartsError::Never { kind: Self::NAME })
    }

    /// How it can be looked at; nothing if facts alone tell of it.
    fn show(&self) -> Vec<Layer> {
        Vec::new()
    }

    /// The faces that it shows, as one mesh; nothing if it shows none. These are the first of [`show`](Value::show), unless a type that
    /// has none, or has them as they are, says so without drawing the rest.
    fn as_mesh(&self) -> Option<Mesh> {
        self.show().into_iter().find_map(|layer| match layer {
            Layer::Triangles(mesh) => Some(*mesh),
            _ => None,
        })
    }

    /// What a `ForEach` can go over in it; nothing unless the type says so.
    fn elements() -> Vec<Elements<Self>> {
        Vec::new()
    }

    /// Values that the type allows and that are hard to treat: empty, tiny, degenerate, enormous. They are what
    /// `maquette::conformance` tries nodes on, and tell which tolerances a test may give.
    fn hostile() -> Vec<Self> {
        Vec::new()
    }

    /// What may hold of a value of this type, so that ports can want it and outputs promise it.
    fn properties() -> &'static [Property<Self>] {
        &[]
    }
}

/// What the engine knows of a type of values. Made by [`value_type`]; a pack lists the types that it brings.
#[derive(Clone, Copy)]
pub struct ValueType {
    /// The word in graph files.
    pub name: &'static str,
    pub(super) describe: fn(&(dyn Any + Send + Sync)) -> Summary,
    pub(super) probe: fn(&(dyn Any + Send + Sync), [usize; 2]) -> Summary,
    pub(super) size: fn(&(dyn Any + Send + Sync)) -> usize,
    pub(super) keep: fn(&(dyn Any + Send + Sync)) -> Kept,
    pub(super) decode: fn(&[u8], &dyn Columns, Hash) -> Result<AnyValue, DecodeError>,
    pub(super) parts: fn(&(dyn Any + Send + Sync)) -> Parts<'_>,
    pub(super) from_parts: fn(&Parts<'_>) -> Result<AnyValue, PartsError>,
    pub(super) show: fn(&(dyn Any + Send + Sync)) -> Vec<Layer>,
    pub(super) as_mesh: fn(&(dyn Any + Send + Sync)) -> Option<Mesh>,
    pub(super) elements: fn() -> Vec<ElementType>,
    pub(super) cut: fn(&(dyn Any + Send + Sync), &str, usize, &[AnyValue]) -> Cut,
    pub(super) hostile: fn() -> Vec<AnyValue>,
    pub(super) properties: fn() -> Vec<(&'static str, &'static str)>,
    pub(super) offence: fn(&(dyn Any + Send + Sync), &str) -> Option<Offence>,
}

impl fmt::Debug for ValueType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl ValueType {
    /// Where its code is.
    pub fn code(&self) -> usize {
        self.decode as usize
    }

    /// The value of this type that has this hash, from its kept content.
    pub fn decode(
        &self,
        bytes: &[u8],
        columns: &dyn Columns,
        hash: Hash,
    ) -> Result<AnyValue, DecodeError> {
        (self.decode)(bytes, columns, hash)
    }

    /// The value of this type that is made of these parts: see [`Value::from_parts`].
    ///
    /// # Errors
    /// If they make none.
    pub fn from_parts(&self, parts: &Parts<'_>) -> Result<AnyValue, PartsError> {
        (self.from_parts)(parts)
    }

    /// What a `ForEach` can go over in such a value.
    pub fn elements(&self) -> Vec<ElementType> {
        (self.elements)()
    }

    /// Values of this type that are hard to treat: see [`Value::hostile`].
    pub fn hostile(&self) -> Vec<AnyValue> {
        (self.hostile)()
    }

    /// The names of the properties that its values may have, and what they mean: see [`Value::properties`].
    pub fn properties(&self) -> Vec<(&'static str, &'static str)> {
        (self.properties)()
    }

    /// The property of this name, if its values may have it.
    pub fn property(&self, name: &str) -> Option<&'static str> {
        self.properties().into_iter().map(|(known, _)| known).find(|known| *known == name)
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
        keep: |value| encoding::keep(downcast::<T>(value)),
        decode: |bytes, columns, hash| {
            let value: T = encoding::decode(bytes, columns, hash)?;
            Ok(AnyValue { kind: value_type::<T>(), hash, value: Arc::new(value) })
        },
        parts: |value| downcast::<T>(value).parts(),
        from_parts: |parts| T::from_parts(parts).map(AnyValue::new),
        show: |value| downcast::<T>(value).show(),
        as_mesh: |value| downcast::<T>(value).as_mesh(),
        elements: ElementType::all_of::<T>,
        cut: |value, word, most, before| elements::cut(downcast::<T>(value), word, most, before),
        hostile: || T::hostile().into_iter().map(AnyValue::new).collect(),
        properties: || T::properties().iter().map(|it| (it.name, it.doc)).collect(),
        offence: |value, name| {
            let property = T::properties().iter().find(|property| property.name == name)?;
            (property.test)(downcast::<T>(value))
        },
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
    pub(super) kind: &'static ValueType,
    pub(super) hash: Hash,
    pub(super) value: Arc<dyn Any + Send + Sync>,
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

    /// Its content as the disk cache keeps it.
    pub fn keep(&self) -> Kept {
        (self.kind.keep)(&*self.value)
    }

    /// Whether its content gives the same value again when it is read back.
    pub fn can_be_read_back(&self) -> bool {
        let kept = self.keep();
        self.kind.decode(&kept.bytes, &kept, self.hash).is_ok()
    }

    /// What a reader wants to know first.
    pub fn describe(&self) -> Summary {
        (self.kind.describe)(&*self.value)
    }

    /// What is at the picture's pixel `at` (column, row).
    pub fn probe(&self, at: [usize; 2]) -> Summary {
        (self.kind.probe)(&*self.value, at)
    }

    /// What it is made of.
    pub fn parts(&self) -> Parts<'_> {
        (self.kind.parts)(&*self.value)
    }

    /// How it can be looked at.
    pub fn show(&self) -> Vec<Layer> {
        (self.kind.show)(&*self.value)
    }

    /// The faces that it shows, as one mesh; nothing if it shows none.
    pub fn as_mesh(&self) -> Option<Mesh> {
        (self.kind.as_mesh)(&*self.value)
    }

    /// What stands against a property of its type, by name; none if it holds.
    pub fn offence(&self, property: &str) -> Option<Offence> {
        (self.kind.offence)(&*self.value, property)
    }
}

impl AnyValue {
    /// Its elements that a word means, for a `ForEach`, if there are no more than `most`; none if its type has no such elements. Those
    /// of another value, `before`, may be taken over.
    pub fn cut(&self, word: &str, most: usize, before: &[Self]) -> Cut {
        (self.kind.cut)(&*self.value, word, most, before)
    }
}

impl fmt::Debug for AnyValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}({})", self.kind.name, self.hash.short())
    }
}
