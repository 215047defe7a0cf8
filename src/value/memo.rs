//! Memos: intermediate results that nodes cache between evaluations. A memo is never the value of a link.

use super::{AnyValue, Encoder, Hash, Parts, Summary, Value};

/// An intermediate result that `Context::memo` caches, such as a plan, a tree or the factors of a matrix, with the key to look it up. A
/// memo is not a value of a graph: it is kept only in memory, and cannot be shown. Reading it back from disk would take as long as
/// computing it.
pub trait Memo: Clone + Send + Sync + 'static {
    /// A name that is unique among the program's memo types.
    const NAME: &'static str;

    /// Writes everything that distinguishes this memo from others, so that equal memos have equal hashes and different memos have different
    /// hashes. If the memo is a function of some input, the input may be written instead.
    fn encode(&self, to: &mut Encoder);

    /// The memory that the memo holds, in bytes.
    fn size(&self) -> usize;
}

/// The hash of a memo's type and content.
pub fn hash_of_memo<T: Memo>(memo: &T) -> Hash {
    Encoder::hash(T::NAME, |to| memo.encode(to))
}

/// A memo as a value, so that the cache of results can store it like any other value.
#[derive(Clone)]
struct MemoValue<T>(T);

impl<T: Memo> Value for MemoValue<T> {
    const NAME: &'static str = T::NAME;

    fn encode(&self, to: &mut Encoder) {
        self.0.encode(to);
    }

    fn size(&self) -> usize {
        self.0.size()
    }

    fn describe(&self) -> Summary {
        Summary::default()
    }

    fn parts(&self) -> Parts<'_> {
        Parts::default()
    }
}

impl AnyValue {
    /// Wraps a memo for the cache.
    pub fn from_memo<T: Memo>(memo: T) -> Self {
        Self::new(MemoValue(memo))
    }

    /// Returns the memo as a `T`, or `None` if it has another type.
    pub fn memo<T: Memo>(&self) -> Option<&T> {
        self.get::<MemoValue<T>>().map(|memo| &memo.0)
    }
}
