//! Evaluates nodes block by block on the points of a large file, so that neither the file nor all of its points are in memory.
//!
//! If only nodes that take blocks need the points of a node, the node is *streamed*: its result is the hash of its points, without the
//! points, as if they had been dropped. A node that takes them reads the file again, and so does anything that needs all points later:
//! `compute` restores values that were dropped. Whatever is unusual (an error, a warning, an empty result) is left to the evaluation on all
//! points, so results and messages are the same.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use maquette_node::importers::BlockFile;
use maquette_node::{CancelledError, NotInBlocks, PointBlock};
use maquette_syntax::error::Error;
use maquette_value::fs::open;
use maquette_value::{AnyValue, Points, PointsHasher};

use super::cache::{Outcome, Values};
use super::compute::{Computed, FileChangedError};
use super::key::Parts;
use super::panics::catch_panic;
use super::run::Run;
use super::streamed::{read_blocks_of, streamed_slot};

/// Receives blocks of points.
type Sink<'a> = &'a mut dyn FnMut(AnyValue) -> Result<(), Error>;

impl Run<'_> {
    /// Returns true if the points of the node are streamed.
    pub(super) fn is_streamed(&self, index: usize) -> bool {
        self.streamed.get(index) == Some(&true)
    }

    /// Evaluates a node block by block. Returns `None` if it must be evaluated on all points.
    pub(super) fn compute_in_blocks(
        &self,
        index: usize,
        parts: &Parts,
    ) -> Option<Result<Computed, Error>> {
        let slot = streamed_slot(self.graph, &self.streamed, index);
        let source = slot.map(|slot| self.graph.nodes()[index].links[slot].node);
        let is_read_again = source.is_some_and(|source| {
            self.result_of(source).is_none_or(|done| !done.outcome.has_values())
        });
        if !self.is_streamed(index) && !is_read_again {
            return None;
        }
        let start = Instant::now();
        self.set_ran(index, true);
        self.observer.on_start(&self.graph.nodes()[index].name);
        let collected = match self.is_streamed(index) {
            true => self.hash_blocks(index, start),
            false => self.collect_blocks(index, start),
        };
        match collected {
            Ok(_) if self.parts(index).is_ok_and(|now| now.files != parts.files) => {
                Some(Err(FileChangedError.into()))
            }
            Ok((outcome, values)) => {
                Some(Ok(Computed { outcome: Arc::new(outcome), values, estimate: None, start }))
            }
            Err(error) => {
                let is_final = error.downcast::<CancelledError>().is_some()
                    || error.downcast::<FileChangedError>().is_some();
                is_final.then_some(Err(error))
            }
        }
    }

    /// Returns the hash of the points that a node computes, without the points.
    fn hash_blocks(
        &self,
        index: usize,
        start: Instant,
    ) -> Result<(Outcome, Option<Values>), Error> {
        let mut hasher = PointsHasher::default();
        self.push_blocks(index, index, &mut |block| Ok(hasher.push(points_of(&block)?)?))?;
        let digest = hasher.finish();
        if digest.count == 0 {
            return Err(NotInBlocks.into());
        }
        Ok((Outcome::of_points(&digest, start.elapsed().as_secs_f64()), None))
    }

    /// Computes the result of a node that takes streamed points.
    fn collect_blocks(
        &self,
        index: usize,
        start: Instant,
    ) -> Result<(Outcome, Option<Values>), Error> {
        let mut blocks = Vec::new();
        self.push_blocks(index, index, &mut |block| {
            blocks.push(points_of(&block)?.clone());
            Ok(())
        })?;
        let points = Points::concat(&blocks)?;
        if points.positions().is_empty() {
            return Err(NotInBlocks.into());
        }
        let values: Values = [AnyValue::new(points)].into();
        let outcome = Outcome::new(&values, Vec::new(), start.elapsed().as_secs_f64());
        Ok((outcome, Some(values)))
    }

    /// Evaluates a node on a block of the points that a streamed node computes.
    fn eval_block(&self, index: usize, block: &AnyValue) -> Result<AnyValue, Error> {
        let node = &self.graph.nodes()[index];
        let slot = streamed_slot(self.graph, &self.streamed, index).ok_or(NotInBlocks)?;
        let inputs = node.links.iter().enumerate().map(|(other, link)| match other == slot {
            true => Ok([block.clone()].into()),
            false => self.values(link.node),
        });
        let inputs = inputs.collect::<Result<Vec<Values>, Error>>()?;
        let none = BTreeMap::new();
        let (values, _) = self.call_node(index, &inputs, &none, None, |cx| node.node.eval(cx))?;
        <[AnyValue; 1]>::try_from(values).map(|[value]| value).map_err(|_| NotInBlocks.into())
    }

    /// Passes the results of a node for all blocks to `sink`. `reported` is the node for which the progress is reported.
    fn push_blocks(&self, index: usize, reported: usize, sink: Sink<'_>) -> Result<(), Error> {
        match streamed_slot(self.graph, &self.streamed, index) {
            None => self.read_file(index, reported, sink),
            Some(slot) => {
                let source = self.graph.nodes()[index].links[slot].node;
                self.push_blocks(source, reported, &mut |block| {
                    sink(self.eval_block(index, &block)?)
                })
            }
        }
    }

    /// Passes the results of a node that reads a file to `sink`, for each block of the file.
    ///
    /// # Errors
    /// `FileChangedError` if the file is not the one from which the key of the node was computed.
    fn read_file(&self, index: usize, reported: usize, sink: Sink<'_>) -> Result<(), Error> {
        let node = &self.graph.nodes()[index];
        let [file] = &node.files[..] else { return Err(NotInBlocks.into()) };
        let read = read_blocks_of(self.graph, file).ok_or(NotInBlocks)?;
        let hash = self.files.hash_in_pieces(file)?;
        let known = self.result_of(index).map(|done| done.parts.files[0]);
        if known.is_some_and(|known| known != Some(hash)) {
            return Err(FileChangedError.into());
        }
        let none = BTreeMap::new();
        let eval = |block: &PointBlock| {
            self.call_node(index, &[], &none, Some(block), |cx| node.node.eval(cx))
        };
        // The first call only determines the range of colors.
        let probe = PointBlock::default();
        let _ = eval(&probe);
        let color_range = probe.color_range.get().copied().flatten();
        let opened = open(&file.path)?;
        let size = opened.metadata()?.len();
        let position = AtomicU64::new(0);
        let mut content = CountedFile { file: opened, n_read: &position };
        let block_len = self.evaluator.blocks.block_len;
        let mut file_in_blocks = BlockFile { content: &mut content, size, color_range, block_len };
        let name = &self.graph.nodes()[reported].name;
        catch_panic(|| {
            read(&mut file_in_blocks, &mut |points| {
                let block = PointBlock { points: Some(points), color_range: OnceLock::new() };
                let (values, warnings) = eval(&block)?;
                let fraction = position.load(Ordering::Relaxed) as f64 / size as f64;
                self.observer.on_progress(name, fraction.min(1.0));
                match <[AnyValue; 1]>::try_from(values) {
                    Ok([value]) if warnings.is_empty() => sink(value),
                    _ => Err(NotInBlocks.into()),
                }
            })
        })?;
        match self.files.hash_in_pieces(file)? == hash {
            true => Ok(()),
            false => Err(FileChangedError.into()),
        }
    }
}

fn points_of(value: &AnyValue) -> Result<&Points, NotInBlocks> {
    value.get::<Points>().ok_or(NotInBlocks)
}

/// A file that counts the bytes that were read.
struct CountedFile<'a> {
    file: std::fs::File,
    n_read: &'a AtomicU64,
}

impl Read for CountedFile<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = self.file.read(into)?;
        self.n_read.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}

impl Seek for CountedFile<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}
