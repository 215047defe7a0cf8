//! A list of plain items, shared between values and hashed once.

use std::fmt;
use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use bytemuck::NoUninit;

use super::{Hash, SEVERAL_THREADS};

/// A list of plain items: cloning it copies nothing, and its hash is computed when first asked for.
#[derive(Clone)]
pub struct Column<T>(Arc<Shared<T>>);

struct Shared<T> {
    items: Vec<T>,
    hash: OnceLock<Hash>,
}

impl<T: NoUninit + Send + Sync> Column<T> {
    /// The hash of the items' bytes and their number.
    pub(crate) fn hash(&self) -> Hash {
        *self.0.hash.get_or_init(|| {
            let bytes: &[u8] = bytemuck::cast_slice(&self.0.items);
            let mut hasher = blake3::Hasher::new();
            hasher.update(&(self.0.items.len() as u64).to_le_bytes());
            if bytes.len() < SEVERAL_THREADS {
                hasher.update(bytes);
            } else {
                hasher.update_rayon(bytes);
            }
            Hash(*hasher.finalize().as_bytes())
        })
    }

    /// How much memory the items hold, in bytes: what follows from their number, because nothing is set aside for more of them.
    pub fn size(&self) -> usize {
        size_of_val(&self.0.items[..])
    }
}

impl<T> Column<T> {
    /// A column of which the hash is known.
    pub(super) fn of_hash(items: Vec<T>, hash: Hash) -> Self {
        Self(Arc::new(Shared { items, hash: hash.into() }))
    }
}

impl<T> From<Vec<T>> for Column<T> {
    fn from(mut items: Vec<T>) -> Self {
        // There will be no more of them; what was set aside would be held as long as the value.
        items.shrink_to_fit();
        Self(Arc::new(Shared { items, hash: OnceLock::new() }))
    }
}

impl<T> FromIterator<T> for Column<T> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        Vec::from_iter(items).into()
    }
}

impl<T> Default for Column<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T> Deref for Column<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.0.items
    }
}

impl<T: PartialEq> PartialEq for Column<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.0.items == other.0.items
    }
}

impl<T: fmt::Debug> fmt::Debug for Column<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.items.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_items_have_equal_hashes_and_different_ones_do_not() {
        let a = Column::from(vec![1.0f64, 2.0]);
        assert_eq!(a.hash(), Column::from(vec![1.0f64, 2.0]).hash());
        assert_ne!(a.hash(), Column::from(vec![1.0f64, 3.0]).hash());
        assert_ne!(Column::<u8>::from(vec![]).hash(), Column::from(vec![0u8]).hash());
    }

    #[test]
    fn a_large_column_hashes_the_same_with_several_threads() {
        let items: Vec<u32> = (0..200_000).collect();
        let several = Column::from(items.clone()).hash();
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(several, one.install(|| Column::from(items).hash()));
    }
}
