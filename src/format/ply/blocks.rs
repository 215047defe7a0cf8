//! Reads the points of a PLY file in blocks of rows.

use std::io::{BufRead, BufReader, Read, SeekFrom};

use maquette_node::importers::{BlockFile, FileReader, InputFile, NotInBlocks, ReadBlocks};
use maquette_syntax::error::Error;
use maquette_value::Points;

use super::body::Body;
use super::header::{self, Element, Encoding, Header, Scalar};
use super::points::PointsPly;
use super::points_of;
use super::table::Table;
use crate::colors::ColorRange;
use crate::finite;

impl FileReader for PointsPly {
    type Value = Points;
    const EXTENSIONS: &'static [&'static str] = &["ply"];
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_PLY;
    const BLOCKS: Option<ReadBlocks> = Some(read_blocks);
    const SIZE: crate::SizeReader = Some(super::size::points);

    fn read(file: &InputFile<'_>) -> Result<Points, Error> {
        let (points, left_out, notes) = super::read_finite(file.bytes(), file.color_range())?;
        notes.into_iter().for_each(|note| file.warn(note));
        finite::warn_left_out(file, left_out, "point");
        Ok(points)
    }
}

/// Reads the points in blocks, if vertices are the only rows of the file, and they have no lists.
pub(super) fn read_blocks(
    file: &mut BlockFile<'_>,
    sink: &mut dyn FnMut(Points) -> Result<(), Error>,
) -> Result<(), Error> {
    /// Longer headers are not expected.
    const HEAD: u64 = 1 << 16;
    let mut head = Vec::new();
    Read::take(&mut *file.content, HEAD).read_to_end(&mut head)?;
    let header = header::read(&head)?;
    let (vertices, others) = header.elements.split_first().ok_or(NotInBlocks)?;
    if !can_be_split(vertices) || others.iter().any(|element| element.count > 0) {
        return Err(NotInBlocks.into());
    }
    file.content.seek(SeekFrom::Start(header.start as u64))?;
    if header.encoding == Encoding::Ascii {
        return read_lines(file, &header, vertices, sink);
    }
    let stride = header.encoding.min_row_size(vertices);
    let expected = stride.checked_mul(vertices.count).and_then(|it| it.checked_add(header.start));
    if expected.map(|size| size as u64) != Some(file.size) {
        return Err(NotInBlocks.into());
    }
    let mut left = vertices.count;
    while left > 0 {
        let count = left.min(file.block_len);
        let mut rows = vec![0; count * stride];
        file.content.read_exact(&mut rows)?;
        sink(decode(&header, vertices, &rows, count, file.color_range)?)?;
        left -= count;
    }
    Ok(())
}

/// Returns true if the attributes of a row do not depend on other rows.
fn can_be_split(vertices: &Element) -> bool {
    let mut properties = vertices.properties.iter();
    vertices.name == "vertex"
        && vertices.count > 0
        && properties
            .all(|it| it.length.is_none() && (it.name != "alpha" || it.scalar == Scalar::U8))
}

/// Reads the vertices of a text, one per line.
fn read_lines(
    file: &mut BlockFile<'_>,
    header: &Header,
    vertices: &Element,
    sink: &mut dyn FnMut(Points) -> Result<(), Error>,
) -> Result<(), Error> {
    let (range, block_len) = (file.color_range, file.block_len);
    let mut lines = BufReader::new(&mut *file.content);
    let mut left = vertices.count;
    while left > 0 {
        let (mut rows, count) = (Vec::new(), left.min(block_len));
        for _ in 0..count {
            lines.read_until(b'\n', &mut rows)?;
        }
        sink(decode(header, vertices, &rows, count, range)?)?;
        left -= count;
    }
    let mut rest = Vec::new();
    lines.read_until(b'\n', &mut rest)?;
    if rest.trim_ascii().is_empty() && lines.fill_buf()?.is_empty() {
        return Ok(());
    }
    Err(NotInBlocks.into())
}

/// Returns the points of `count` rows, which must be all of `rows`.
fn decode(
    header: &Header,
    vertices: &Element,
    rows: &[u8],
    count: usize,
    range: Option<ColorRange>,
) -> Result<Points, Error> {
    let mut body = Body::of_rows(header, rows);
    let mut table = Table::read(&Element { count, ..vertices.clone() }, &mut body)?;
    table.color_range = range;
    let mut notes = Vec::from_iter(body.rest());
    let (mesh, finite) = table.into_mesh(header, Default::default(), &mut notes)?;
    if !notes.is_empty() || finite.n_left_out() > 0 {
        return Err(NotInBlocks.into());
    }
    Ok(points_of(&mesh))
}
