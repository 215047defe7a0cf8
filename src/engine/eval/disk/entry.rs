//! The binary format of an entry: the stored result of a node.

use std::collections::HashMap;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

use maquette_node::ValueSize;
use maquette_value::{AnyValue, Columns, EncodedValue, Hash, ValueType, fs};
use serde::{Deserialize, Serialize};

use super::super::cache::{Outcome, Values};

/// The first bytes of every entry: the name and the version of the format.
const MAGIC: &[u8; 8] = b"maqent03";

/// The header of an entry: the result without its values. It is stored as JSON so that people can read it.
#[derive(Serialize, Deserialize)]
struct Header {
    key: String,
    /// The type of the node that computed the result.
    #[serde(default)]
    node: String,
    outputs: Vec<OutputHeader>,
    /// The large columns of all outputs. Each is given by its hash and its number of items.
    columns: Vec<(Hash, u64)>,
    warnings: Vec<String>,
    shapes: Vec<String>,
    #[serde(default)]
    sizes: Vec<ValueSize>,
    bytes: usize,
    seconds: f64,
}

#[derive(Serialize, Deserialize)]
struct OutputHeader {
    #[serde(rename = "type")]
    kind: String,
    hash: String,
    length: usize,
}

/// An entry that was read from disk.
pub(super) struct Entry {
    header: Header,
    outputs: Vec<(&'static ValueType, Hash, Range<usize>)>,
    bytes: Vec<u8>,
}

/// Returns the bytes of an entry that stores the result `outcome`. `kept` contains the encoded values of the result.
pub(super) fn write(key: Hash, node: &str, outcome: &Outcome, kept: &[EncodedValue]) -> Vec<u8> {
    let outputs = outcome.outputs.iter().zip(kept).map(|((kind, hash), kept)| OutputHeader {
        kind: (*kind).to_owned(),
        hash: hash.to_string(),
        length: kept.bytes.len(),
    });
    let columns = kept.iter().flat_map(|kept| &kept.columns);
    let header = Header {
        key: key.to_string(),
        node: node.to_owned(),
        outputs: outputs.collect(),
        columns: columns.map(|column| (column.hash(), column.items() as u64)).collect(),
        warnings: outcome.warnings.to_vec(),
        shapes: outcome.descriptions.to_vec(),
        sizes: outcome.sizes.to_vec(),
        bytes: outcome.bytes,
        seconds: outcome.seconds,
    };
    let header = serde_json::to_vec(&header).unwrap_or_default();
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(&(header.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&header);
    kept.iter().for_each(|kept| bytes.extend_from_slice(&kept.bytes));
    bytes
}

/// Parses the header of an entry. Also returns the offset at which the data begins. Returns `None` if the bytes are not an entry of this
/// format version.
fn header(bytes: &[u8]) -> Option<(Header, usize)> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (length, rest) = rest.split_first_chunk()?;
    let (header, _) = rest.split_at_checked(u64::from_le_bytes(*length).try_into().ok()?)?;
    let start = MAGIC.len() + length.len() + header.len();
    Some((serde_json::from_slice(header).ok()?, start))
}

/// Returns the type of the node whose result an entry file stores, and the hashes of the columns that the entry uses. Reads only the header
/// of the file. Returns `None` if the header cannot be read.
pub(super) fn summary(path: &Path) -> Option<(String, Vec<Hash>)> {
    let mut file = fs::open_no_follow(path).ok()?;
    let mut start = [0; MAGIC.len() + size_of::<u64>()];
    file.read_exact(&mut start).ok()?;
    let (_, length) = start.split_last_chunk()?;
    let mut bytes = start.to_vec();
    file.take(u64::from_le_bytes(*length)).read_to_end(&mut bytes).ok()?;
    let (header, _) = header(&bytes)?;
    Some((header.node, header.columns.into_iter().map(|(column, _)| column).collect()))
}

/// Returns the hash and the number of items of each column that the entry `key` uses. Returns `Some(None)` if the bytes are an entry with
/// another key or an incomplete one, and `None` if they have another format version.
pub(super) fn columns(bytes: &[u8], key: Hash) -> Option<Option<Vec<(Hash, u64)>>> {
    let (header, start) = header(bytes)?;
    let lengths = header.outputs.iter().map(|output| output.length);
    let end = lengths.into_iter().try_fold(start, usize::checked_add);
    let fits = header.key == key.to_string() && end == Some(bytes.len());
    Some(fits.then_some(header.columns))
}

impl Entry {
    /// Parses the entry with this key. Returns `None` if the bytes are a different entry or contain values of an unknown type.
    pub(super) fn parse(
        bytes: Vec<u8>,
        key: Hash,
        types: &HashMap<&'static str, &'static ValueType>,
    ) -> Option<Self> {
        let (header, mut start) = header(&bytes)?;
        if header.key != key.to_string() {
            return None;
        }
        let mut outputs = Vec::new();
        for output in &header.outputs {
            let end = start.checked_add(output.length).filter(|&end| end <= bytes.len())?;
            let kind = *types.get(&output.kind[..])?;
            outputs.push((kind, Hash::parse(&output.hash)?, start..end));
            start = end;
        }
        Some(Self { header, outputs, bytes })
    }

    /// Returns the hash and the number of items of each column that the entry uses.
    pub(super) fn columns(&self) -> &[(Hash, u64)] {
        &self.header.columns
    }

    /// Returns the time that computing the result took, in seconds.
    pub(super) fn seconds(&self) -> f64 {
        self.header.seconds
    }

    /// Returns the memory that the values need, in bytes.
    pub(super) fn size(&self) -> usize {
        self.header.bytes
    }

    pub(super) fn outcome(self) -> Outcome {
        let outputs = self.outputs.iter().map(|(kind, hash, _)| (kind.name, *hash)).collect();
        let Header { warnings, shapes, sizes, bytes, seconds, .. } = self.header;
        Outcome::without_values(outputs, warnings, bytes, seconds).with_descriptions(shapes, sizes)
    }

    pub(super) fn values(&self, columns: &dyn Columns) -> Option<Values> {
        let values: Option<Vec<AnyValue>> = self
            .outputs
            .iter()
            .map(|(kind, hash, range)| kind.decode(&self.bytes[range.clone()], columns, *hash).ok())
            .collect();
        values.map(Values::from)
    }
}
