//! The times of earlier runs of nodes, from which a preflight predicts the time of a run. They are kept in the disk cache, for all graphs.

use std::collections::BTreeMap;

use maquette_graph::GraphNode;
use serde::{Deserialize, Serialize};

/// The name of the note in the disk cache.
pub(super) const NOTE: &str = "@timings";

/// The last time of each node type, for each order of magnitude of the work. The work is the number of bytes that a node reads and makes.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Timings(BTreeMap<String, BTreeMap<u32, Timing>>);

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Timing {
    work: f64,
    seconds: f64,
}

/// Returns the order of magnitude of the work, in powers of 4.
fn magnitude(work: f64) -> u32 {
    (work.max(1.0) as u64).ilog2() / 2
}

impl Timings {
    /// Reads the times that earlier processes have stored in a note. There are none if it cannot be read.
    pub(super) fn read(note: Option<Vec<u8>>) -> Self {
        note.and_then(|note| serde_json::from_slice(&note).ok()).unwrap_or_default()
    }

    pub(super) fn insert(&mut self, kind: &str, work: f64, seconds: f64) {
        let timings = self.0.entry(kind.to_owned()).or_default();
        timings.insert(magnitude(work), Timing { work, seconds });
    }

    /// Predicts the time in seconds that a node of this type takes for this work: in proportion to the time for the most similar work.
    /// `None` if no such node has run on this machine.
    pub(super) fn predict(&self, kind: &str, work: f64) -> Option<f64> {
        let magnitude = magnitude(work);
        let timings = self.0.get(kind)?.iter();
        let (_, nearest) = timings.min_by_key(|(other, _)| other.abs_diff(magnitude))?;
        Some(nearest.seconds * work.max(1.0) / nearest.work.max(1.0))
    }
}

/// Returns the number of bytes of the files that a node reads.
pub(super) fn bytes_of_files(node: &GraphNode) -> f64 {
    let sizes = node.files.iter().filter_map(|file| std::fs::metadata(&file.path).ok());
    sizes.map(|metadata| metadata.len() as f64).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_in_proportion_to_those_of_similar_work() {
        let mut timings = Timings::default();
        timings.insert("Smooth", 1e6, 1.0);
        timings.insert("Smooth", 1e9, 2000.0);
        assert_eq!(timings.predict("Smooth", 2e6), Some(2.0));
        assert_eq!(timings.predict("Smooth", 1e10), Some(20_000.0));
        assert_eq!(timings.predict("Simplify", 1e6), None);
        timings.insert("Smooth", 1e6, 0.5);
        assert_eq!(timings.predict("Smooth", 1e6), Some(0.5));
    }

    #[test]
    fn work_of_any_size_has_a_magnitude() {
        let sizes = [0.0, 1.0, 5.0, 1e30, f64::INFINITY, f64::NAN].map(magnitude);
        assert_eq!(sizes, [0, 0, 1, 31, 31, 0]);
    }
}
