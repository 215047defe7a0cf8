//! The trait that value types implement, and a value whose type is known only at run time.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

use crate::elements::{Cut, ElementType, Elements};
use crate::encoding::{self, Columns, DecodeError, Decoder, EncodedValue, Encoder, hash_of};
use crate::hash::Hash;
use crate::layer::Layer;
use crate::mesh::Mesh;
use crate::parts::{Parts, PartsError};
use crate::property::{Property, Violation};
use crate::summary::Summary;

/// A type of values. A port takes values of a type, and an output produces them. An implementation of this trait defines the type
/// completely; no other file lists the properties of types.
pub trait Value: Clone + Send + Sync + 'static {
    /// The type's name in graph files and messages, in CamelCase: `RangeImage`.
    const NAME: &'static str;

    /// Writes the whole content in a fixed order, so that equal contents have equal hashes and different contents have different hashes.
    fn encode(&self, to: &mut Encoder);

    /// Reads the content back, part by part, as [`Value::encode`] wrote it. The caller has verified the bytes.
    ///
    /// Values of a type without this method are never read from the disk cache.
    ///
    /// # Errors
    /// If the content is not what `encode` writes.
    fn decode(from: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        let _ = from;
        Err(DecodeError)
    }

    /// The memory that the value holds, in bytes, including capacity that is reserved for more items. Memory that two values share counts
    /// for both.
    fn size(&self) -> usize;

    /// A summary for readers: counts, bounds, topology; one labelled fact per row.
    fn describe(&self) -> Summary;

    /// Facts about the pixel at the position `at` (column, row) of the value's picture. Empty if the value has no pixels.
    fn probe(&self, at: [usize; 2]) -> Summary {
        let _ = at;
        Summary::default()
    }

    /// The complete content of the value as facts and named columns of numbers. The columns are borrowed where the value holds numbers
    /// contiguously. Tests compare parts; a value without parts is compared by [`describe`](Value::describe).
    fn parts(&self) -> Parts<'_>;

    /// Builds a value from parts with the names that [`parts`](Value::parts) uses. Optional columns may be missing, and numbers may be
    /// stored in any number type.
    ///
    /// # Errors
    /// If a part is missing, has the wrong shape, or holds numbers that the type does not allow. If the type does not implement this
    /// method, every call fails.
    fn from_parts(parts: &Parts<'_>) -> Result<Self, PartsError> {
        let _ = parts;
        Err(PartsError::Never { kind: Self::NAME })
    }

    /// The layers that viewers draw. Empty if the value is shown as facts only.
    fn show(&self) -> Vec<Layer> {
        Vec::new()
    }

    /// The faces that the value shows, as one mesh. `None` if it shows no faces. The default is the first mesh in [`show`](Value::show). A
    /// type whose values have no faces, or have the mesh at hand, should override the method, so that the other layers are not built.
    fn as_mesh(&self) -> Option<Mesh> {
        self.show().into_iter().find_map(|layer| match layer {
            Layer::Triangles(mesh) => Some(*mesh),
            _ => None,
        })
    }

    /// The kinds of elements that a `ForEach` can iterate over. By default there are none.
    fn elements() -> Vec<Elements<Self>> {
        Vec::new()
    }

    /// Valid values that are hard to process: empty, tiny, degenerate, enormous. `maquette::conformance` runs nodes on these values. The
    /// meanings of the numbers in their parts also determine which kinds of tolerances a test of this type may state.
    fn edge_cases() -> Vec<Self> {
        Vec::new()
    }

    /// Properties of values of this type, which ports can require and outputs can promise.
    fn properties() -> &'static [Property<Self>] {
        &[]
    }
}

/// A value type as the engine sees it: its name and its functions. [`value_type`] creates it. A pack lists the types that it adds.
#[derive(Clone, Copy)]
pub struct ValueType {
    /// The type's name in graph files.
    pub name: &'static str,
    decode: fn(&[u8], &dyn Columns, Hash) -> Result<AnyValue, DecodeError>,
    from_parts: fn(&Parts<'_>) -> Result<AnyValue, PartsError>,
    elements: fn() -> Vec<ElementType>,
    edge_cases: fn() -> Vec<AnyValue>,
    properties: fn() -> Vec<(&'static str, &'static str)>,
}

impl fmt::Debug for ValueType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl ValueType {
    /// The address of the type's decoding function. Within this process it identifies the code of the type.
    pub fn code(&self) -> usize {
        self.decode as usize
    }

    /// Decodes the value with this hash from its stored content.
    pub fn decode(
        &self,
        bytes: &[u8],
        columns: &dyn Columns,
        hash: Hash,
    ) -> Result<AnyValue, DecodeError> {
        (self.decode)(bytes, columns, hash)
    }

    /// Builds a value from parts: see [`Value::from_parts`].
    ///
    /// # Errors
    /// If the parts do not make a value of this type.
    pub fn from_parts(&self, parts: &Parts<'_>) -> Result<AnyValue, PartsError> {
        (self.from_parts)(parts)
    }

    /// The kinds of elements that a `ForEach` can iterate over in values of this type.
    pub fn elements(&self) -> Vec<ElementType> {
        (self.elements)()
    }

    /// Valid values of this type that are hard to process: see [`Value::edge_cases`].
    pub fn edge_cases(&self) -> Vec<AnyValue> {
        (self.edge_cases)()
    }

    /// The names and descriptions of the properties that values of this type may have: see [`Value::properties`].
    pub fn properties(&self) -> Vec<(&'static str, &'static str)> {
        (self.properties)()
    }

    /// The property with this name, if values of this type may have it.
    pub fn property(&self, name: &str) -> Option<&'static str> {
        self.properties().into_iter().map(|(known, _)| known).find(|known| *known == name)
    }
}

impl PartialEq for ValueType {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

/// Returns the description of the type `T` for the engine.
pub const fn value_type<T: Value>() -> &'static ValueType {
    const {
        &ValueType {
            name: T::NAME,
            decode: |bytes, columns, hash| {
                let value = encoding::decode::<T>(bytes, columns, hash)?;
                Ok(AnyValue { hash, value: Arc::new(value) })
            },
            from_parts: |parts| T::from_parts(parts).map(AnyValue::new),
            elements: || T::elements().iter().map(ElementType::from).collect(),
            edge_cases: || T::edge_cases().into_iter().map(AnyValue::new).collect(),
            properties: || T::properties().iter().map(|it| (it.name, it.doc)).collect(),
        }
    }
}

/// A value on a link. It is shared, and knows its type and the hash of its content.
#[derive(Clone)]
pub struct AnyValue {
    hash: Hash,
    value: Arc<dyn DynValue>,
}

/// The methods of [`Value`], for a value whose type is known only at run time.
trait DynValue: Any + Send + Sync {
    fn kind(&self) -> &'static ValueType;
    fn encode(&self) -> EncodedValue;
    fn size(&self) -> usize;
    fn describe(&self) -> Summary;
    fn probe(&self, at: [usize; 2]) -> Summary;
    fn parts(&self) -> Parts<'_>;
    fn show(&self) -> Vec<Layer>;
    fn as_mesh(&self) -> Option<Mesh>;
    fn violation(&self, property: &str) -> Option<Violation>;
    fn cut(&self, word: &str, max_count: usize, before: &[AnyValue]) -> Cut;
}

impl<T: Value> DynValue for T {
    fn kind(&self) -> &'static ValueType {
        value_type::<T>()
    }

    fn encode(&self) -> EncodedValue {
        encoding::encode(self)
    }

    fn size(&self) -> usize {
        Value::size(self)
    }

    fn describe(&self) -> Summary {
        Value::describe(self)
    }

    fn probe(&self, at: [usize; 2]) -> Summary {
        Value::probe(self, at)
    }

    fn parts(&self) -> Parts<'_> {
        Value::parts(self)
    }

    fn show(&self) -> Vec<Layer> {
        Value::show(self)
    }

    fn as_mesh(&self) -> Option<Mesh> {
        Value::as_mesh(self)
    }

    fn violation(&self, property: &str) -> Option<Violation> {
        T::properties().iter().find(|it| it.name == property).and_then(|it| (it.test)(self))
    }

    fn cut(&self, word: &str, max_count: usize, before: &[AnyValue]) -> Cut {
        let way = T::elements().into_iter().find(|way| way.word == word)?;
        Some((way.cut)(self, max_count, before))
    }
}

impl AnyValue {
    /// Wraps `value` and computes its hash.
    pub fn new<T: Value>(value: T) -> Self {
        Self { hash: hash_of(&value), value: Arc::new(value) }
    }

    /// The value's type.
    pub fn kind(&self) -> &'static ValueType {
        self.value.kind()
    }

    /// The hash of the value's type and content.
    pub fn hash(&self) -> Hash {
        self.hash
    }

    /// The value as a `T`, or `None` if it has another type.
    pub fn get<T: Value>(&self) -> Option<&T> {
        let value: &dyn Any = &*self.value;
        value.downcast_ref()
    }

    /// The memory that the value holds, in bytes.
    pub fn size(&self) -> usize {
        self.value.size()
    }

    /// The content as the disk cache stores it.
    pub fn encode(&self) -> EncodedValue {
        self.value.encode()
    }

    /// Returns true if decoding the encoded content gives an equal value.
    pub fn can_be_read_back(&self) -> bool {
        let kept = self.encode();
        self.kind().decode(&kept.bytes, &kept, self.hash).is_ok()
    }

    /// A summary for readers: see [`Value::describe`].
    pub fn describe(&self) -> Summary {
        self.value.describe()
    }

    /// Facts about the pixel at the position `at` (column, row): see [`Value::probe`].
    pub fn probe(&self, at: [usize; 2]) -> Summary {
        self.value.probe(at)
    }

    /// The value's facts and columns: see [`Value::parts`].
    pub fn parts(&self) -> Parts<'_> {
        self.value.parts()
    }

    /// The layers that viewers draw: see [`Value::show`].
    pub fn show(&self) -> Vec<Layer> {
        self.value.show()
    }

    /// The faces that the value shows, as one mesh. `None` if it shows no faces.
    pub fn as_mesh(&self) -> Option<Mesh> {
        self.value.as_mesh()
    }

    /// Checks the property of this name. Returns its violation, or `None` if the value has the property.
    pub fn violation(&self, property: &str) -> Option<Violation> {
        self.value.violation(property)
    }

    /// Splits the value into the elements that `word` names, for a `ForEach`, if there are at most `max_count`. `None` if the type has no
    /// such elements. If an element of an older value, `before`, is equal to a new one, it may be reused.
    pub fn cut(&self, word: &str, max_count: usize, before: &[Self]) -> Cut {
        self.value.cut(word, max_count, before)
    }
}

impl fmt::Debug for AnyValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}({})", self.kind().name, self.hash.short())
    }
}
