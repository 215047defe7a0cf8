//! Memos: intermediate results that nodes cache between evaluations. A memo is never the value of a link.

use std::any::Any;
use std::sync::Arc;

use super::{AnyValue, DecodeError, Encoder, Hash, Parts, PartsError, Summary, ValueType};

/// An intermediate result that `Context::memo` caches, such as a plan, a tree or the factors of a matrix, with the key to look it up. A
/// memo is not a value of a graph: it is kept only in memory, and cannot be shown. Reading it back from disk would take as long as
/// computing it.
pub trait Memo: Clone + Send + Sync + 'static {
    /// A name that is unique among the program's memo types.
    const NAME: &'static str;

    /// Writes everything that distinguishes this memo from others, so that equal memos have equal hashes and different ones do not. If the
    /// memo is a function of some input, the input may be written instead.
    fn encode(&self, to: &mut Encoder);

    /// The memory that the memo holds, in bytes.
    fn size(&self) -> usize;
}

/// The hash of a memo's type and content.
pub fn hash_of_memo<T: Memo>(memo: &T) -> Hash {
    Encoder::hash(T::NAME, |to| memo.encode(to))
}

struct TypeOf<T>(std::marker::PhantomData<T>);

/// The value type of a memo. It lets the cache of results store a memo like any other value; of its functions, the cache calls only `size`.
impl<T: Memo> TypeOf<T> {
    const TYPE: ValueType = ValueType {
        name: T::NAME,
        describe: |_| Summary::default(),
        probe: |_, _| Summary::default(),
        size: |memo| memo.downcast_ref::<T>().map_or(0, Memo::size),
        encode: |_| super::EncodedValue { bytes: Vec::new(), columns: Vec::new(), is_intact: true },
        decode: |_, _, _| Err(DecodeError),
        parts: |_| Parts::default(),
        from_parts: |_| Err(PartsError::Never { kind: T::NAME }),
        show: |_| Vec::new(),
        as_mesh: |_| None,
        elements: Vec::new,
        cut: |_, _, _, _| None,
        edge_cases: Vec::new,
        properties: Vec::new,
        violation: |_, _| None,
    };
}

impl AnyValue {
    /// Wraps a memo for the cache.
    pub fn from_memo<T: Memo>(memo: T) -> Self {
        let hash = hash_of_memo(&memo);
        Self { kind: &TypeOf::<T>::TYPE, hash, value: Arc::new(memo) }
    }

    /// Returns the memo as a `T`, or `None` if it has another type.
    pub fn memo<T: Any>(&self) -> Option<&T> {
        self.value.downcast_ref()
    }
}
