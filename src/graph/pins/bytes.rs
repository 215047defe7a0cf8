//! The file format of pinned values: a header of one line of JSON, then the values, then their large columns.

use std::collections::HashMap;
use std::ops::Range;

use maquette_value::{AnyValue, Columns, Hash, ValueType};
use serde::{Deserialize, Serialize};

const MAGIC: &[u8] = b"maqpin01";

#[derive(Serialize, Deserialize)]
struct Header {
    /// For each value, its number of bytes, not including its columns.
    values: Vec<usize>,
    columns: Vec<(Hash, usize)>,
}

/// Encodes values in the file format of pinned values.
pub fn write(values: &[AnyValue]) -> Vec<u8> {
    let kept: Vec<_> = values.iter().map(AnyValue::encode).collect();
    let columns: Vec<_> = kept.iter().flat_map(|kept| &kept.columns).collect();
    let header = Header {
        values: kept.iter().map(|kept| kept.bytes.len()).collect(),
        columns: columns.iter().map(|column| (column.hash(), column.bytes().len())).collect(),
    };
    let mut bytes = MAGIC.to_vec();
    bytes.extend(serde_json::to_vec(&header).unwrap_or_default());
    bytes.push(b'\n');
    kept.iter().for_each(|kept| bytes.extend_from_slice(&kept.bytes));
    columns.iter().for_each(|column| bytes.extend_from_slice(column.bytes()));
    bytes
}

/// Decodes values of the given types and hashes. Returns `None` if the bytes are damaged or contain other values.
pub(crate) fn read(bytes: &[u8], outputs: &[(&'static ValueType, Hash)]) -> Option<Vec<AnyValue>> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let end = rest.iter().position(|byte| *byte == b'\n')?;
    let header: Header = serde_json::from_slice(&rest[..end]).ok()?;
    let content = &rest[end + 1..];
    let mut start = 0_usize;
    fn next(length: usize, start: &mut usize, content: &[u8]) -> Option<Range<usize>> {
        let range = *start..start.checked_add(length).filter(|end| *end <= content.len())?;
        *start = range.end;
        Some(range)
    }
    let values = header
        .values
        .iter()
        .map(|length| next(*length, &mut start, content))
        .collect::<Option<Vec<_>>>()?;
    let columns = header
        .columns
        .iter()
        .map(|(hash, length)| Some((*hash, next(*length, &mut start, content)?)));
    let columns = Content { content, columns: columns.collect::<Option<_>>()? };
    if values.len() != outputs.len() || next(0, &mut start, content)?.end != content.len() {
        return None;
    }
    outputs
        .iter()
        .zip(values)
        .map(|((kind, hash), range): (&(&'static ValueType, Hash), Range<usize>)| {
            kind.decode(&content[range], &columns, *hash).ok()
        })
        .collect()
}

struct Content<'a> {
    content: &'a [u8],
    columns: HashMap<Hash, Range<usize>>,
}

impl Columns for Content<'_> {
    fn read(&self, hash: Hash, into: &mut [u8]) -> bool {
        let bytes = self.columns.get(&hash).map(|range| &self.content[range.clone()]);
        bytes.filter(|bytes| bytes.len() == into.len()).map(|it| into.copy_from_slice(it)).is_some()
    }

    /// Nothing to report: damage is detected by the hashes of the values.
    fn report_damage(&self, _: Hash) {}
}
