//! What nodes remember between evaluations; it never travels on links.

use std::any::Any;
use std::sync::Arc;

use super::{AnyValue, DecodeError, Encoder, Hash, Parts, PartsError, Summary, ValueType};

/// What `Context::memo` asks by, and what it remembers: plans, trees, factors. It is no
/// value of a graph: it stays in memory, and cannot be shown.
/// Reading a plan back from disk would take as long as making it.
pub trait Memo: Clone + Send + Sync + 'static {
    /// A name that no other type of a program's memos has.
    const NAME: &'static str;

    /// Writes all that tells it from others: equal content, equal hash. What is a function of something may write that instead.
    fn encode(&self, to: &mut Encoder);

    /// How much memory it holds, in bytes.
    fn size(&self) -> usize;
}

/// The hash of a memo's type and content.
pub fn hash_of_memo<T: Memo>(memo: &T) -> Hash {
    Encoder::hash(T::NAME, |to| memo.encode(to))
}

struct TypeOf<T>(std::marker::PhantomData<T>);

/// In the cache of results a memo is a value of which only the size is asked.
impl<T: Memo> TypeOf<T> {
    const TYPE: ValueType = ValueType {
        name: T::NAME,
        describe: |_| Summary::default(),
        probe: |_, _| Summary::default(),
        size: |memo| memo.downcast_ref::<T>().map_or(0, Memo::size),
        keep: |_| super::Kept { bytes: Vec::new(), columns: Vec::new(), is_intact: true },
        decode: |_, _, _| Err(DecodeError),
        parts: |_| Parts::default(),
        from_parts: |_| Err(PartsError::Never { kind: T::NAME }),
        show: |_| Vec::new(),
        as_mesh: |_| None,
        elements: Vec::new,
        cut: |_, _, _, _| None,
        hostile: Vec::new,
        properties: Vec::new,
        offence: |_, _| None,
    };
}

impl AnyValue {
    /// A memo as the cache keeps it.
    pub fn of_memo<T: Memo>(memo: T) -> Self {
        let hash = hash_of_memo(&memo);
        Self { kind: &TypeOf::<T>::TYPE, hash, value: Arc::new(memo) }
    }

    /// The memo that the cache kept, if it is a `T`.
    pub fn memo<T: Any>(&self) -> Option<&T> {
        self.value.downcast_ref()
    }
}
