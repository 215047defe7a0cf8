//! Chunks of keys, for parallel sums whose terms are added in a fixed order.

use std::ops::Range;

use crate::parallel::*;

/// The minimum number of keys per chunk, and the maximum number of chunks.
const MIN_KEYS: usize = 4096;
const MAX_CHUNKS: usize = 64;

/// The minimum number of sources per block, and the maximum number of blocks.
const MIN_SOURCES: usize = 4096;
const MAX_BLOCKS: usize = 64;

/// For each chunk of consecutive keys, the sources that have a key in the chunk, ascending.
///
/// For example, the sources are the faces of a mesh, and the keys of a face are its vertices. To sum up something of the faces at each
/// vertex, the chunks are processed in parallel, each with its faces in order. Every sum then has the order of the faces, for any number of
/// threads, and a face is visited only by the few chunks that contain its vertices.
#[derive(Debug)]
pub struct KeyChunks {
    n_keys: usize,
    n_sources: usize,
    /// The number of keys per chunk, a power of two.
    chunk_len: usize,
    /// For each block of sources, a list of sources per chunk. Empty if there is at most one chunk, which has all sources.
    blocks: Vec<Vec<Vec<u32>>>,
}

impl KeyChunks {
    /// Distributes the sources `0..n_sources` to chunks of the keys `0..n_keys`. `keys` returns the keys of a source.
    pub fn new<I: IntoIterator<Item = u32>>(
        n_keys: usize,
        n_sources: usize,
        keys: impl Fn(usize) -> I + Sync,
    ) -> Self {
        let chunk_len = n_keys.div_ceil(MAX_CHUNKS).max(MIN_KEYS).next_power_of_two();
        let mut chunks = Self { n_keys, n_sources, chunk_len, blocks: Vec::new() };
        if chunks.count() <= 1 {
            return chunks;
        }
        let block_len = n_sources.div_ceil(MAX_BLOCKS).max(MIN_SOURCES);
        let (shift, count, keys) = (chunk_len.ilog2(), chunks.count(), &keys);
        chunks.blocks = (0..n_sources.div_ceil(block_len))
            .into_par_iter()
            .map(|block: usize| {
                let mut lists = vec![Vec::new(); count];
                for source in block * block_len..n_sources.min((block + 1) * block_len) {
                    for key in keys(source) {
                        let list: &mut Vec<u32> = &mut lists[key as usize >> shift];
                        if list.last() != Some(&(source as u32)) {
                            list.push(source as u32);
                        }
                    }
                }
                lists
            })
            .collect();
        chunks
    }

    /// The number of chunks.
    pub fn count(&self) -> usize {
        self.n_keys.div_ceil(self.chunk_len)
    }

    /// The number of keys per chunk, except that the last chunk may be shorter.
    pub fn chunk_len(&self) -> usize {
        self.chunk_len
    }

    /// The keys of a chunk.
    pub fn keys(&self, chunk: usize) -> Range<usize> {
        chunk * self.chunk_len..self.n_keys.min((chunk + 1) * self.chunk_len)
    }

    /// Calls `f` with each source that has a key in a chunk, ascending.
    pub fn for_each_source(&self, chunk: usize, mut f: impl FnMut(usize)) {
        if self.blocks.is_empty() {
            return (0..self.n_sources).for_each(f);
        }
        for block in &self.blocks {
            block[chunk].iter().for_each(|&source| f(source as usize));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Random;

    #[test]
    fn each_chunk_has_the_sources_of_its_keys_in_order() {
        let mut random = Random(5);
        for [n_keys, n_sources] in [[0, 0], [10, 0], [4096, 9], [4097, 9000], [300_000, 20_000]] {
            let keys: Vec<[u32; 3]> =
                (0..n_sources).map(|_| [0; 3].map(|_| random.next_below(n_keys) as u32)).collect();
            let chunks = KeyChunks::new(n_keys, n_sources, |source| keys[source]);
            for chunk in 0..chunks.count() {
                let own = chunks.keys(chunk);
                fn is_in(keys: &[u32; 3], own: &Range<usize>) -> bool {
                    keys.iter().any(|&key| own.contains(&(key as usize)))
                }
                let mut found = Vec::new();
                chunks.for_each_source(chunk, |source| found.push(source));
                found.retain(|&source| chunks.count() > 1 || is_in(&keys[source], &own));
                let expected = (0..n_sources).filter(|&source| is_in(&keys[source], &own));
                assert_eq!(found, expected.collect::<Vec<_>>());
            }
        }
    }
}
