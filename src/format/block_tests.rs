//! Points that are read in blocks are the points of the whole file.

use std::io::Cursor;

use maquette_node::importers::{BlockFile, ColorRange, InputFile, Readers};
use maquette_value::Points;

use crate::READERS;

/// Reads a file in blocks. `None` if it must be read as a whole.
fn read_blocks(name: &str, bytes: &[u8], block_len: usize) -> Option<Vec<Points>> {
    let readers = Readers::new(READERS.iter().copied());
    let read = readers.read_blocks(name.rsplit('.').next()?)?;
    let mut content = Cursor::new(bytes);
    let size = bytes.len() as u64;
    let color_range = None::<ColorRange>;
    let mut blocks = Vec::new();
    let mut file = BlockFile { content: &mut content, size, color_range, block_len };
    let done = read(&mut file, &mut |block| {
        blocks.push(block);
        Ok(())
    });
    done.ok().map(|()| blocks)
}

fn read_whole(name: &str, bytes: &[u8]) -> Points {
    let readers = Readers::new(READERS.iter().copied());
    let kind = maquette_value::value_type::<Points>();
    let value = readers.read(kind, &InputFile::standalone(name, bytes)).unwrap();
    value.get::<Points>().unwrap().clone()
}

fn check(name: &str, bytes: &[u8]) {
    let whole = read_whole(name, bytes);
    for block_len in [1, 2, 1000, 65_536] {
        let blocks = read_blocks(name, bytes, block_len).unwrap_or_else(|| panic!("{name}"));
        assert_eq!(Points::concat(&blocks), Ok(whole.clone()), "{name} {block_len}");
        assert_eq!(blocks.len(), whole.positions().len().div_ceil(block_len), "{name}");
    }
}

macro_rules! data {
    ($name:literal) => {
        ($name, include_bytes!(concat!("../../tests/data/formats/", $name)).as_slice())
    };
}

#[test]
fn blocks_of_las_files_are_the_points_of_the_file() {
    for (name, bytes) in [data!("survey.las"), data!("bytes.las")] {
        check(name, bytes);
    }
}

#[test]
fn blocks_of_e57_files_are_the_points_of_the_file() {
    for (name, bytes) in [data!("two_scans.e57"), data!("spherical.e57")] {
        check(name, bytes);
    }
}

/// Returns rows of x, y, z and a color.
fn rows(count: u32) -> impl Iterator<Item = ([f32; 3], [u8; 3])> {
    (0..count).map(|k| {
        let at = [k as f32 / 7.0, (k * k % 101) as f32, -0.25];
        (at, [2 + (k % 250) as u8, 3, 250])
    })
}

fn ply_header(format: &str, count: u32, color: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
         property {color} red\nproperty {color} green\nproperty {color} blue\nend_header\n"
    )
}

fn binary_ply(count: u32) -> Vec<u8> {
    let mut bytes = ply_header("binary_little_endian", count, "uchar").into_bytes();
    for (at, color) in rows(count) {
        at.iter().for_each(|x| bytes.extend_from_slice(&x.to_le_bytes()));
        bytes.extend_from_slice(&color);
    }
    bytes
}

fn text_rows(count: u32) -> String {
    let lines = rows(count).map(|([x, y, z], [r, g, b])| format!("{x} {y} {z} {r} {g} {b}\n"));
    lines.collect()
}

#[test]
fn blocks_of_ply_files_are_the_points_of_the_file() {
    check("a.ply", &binary_ply(2500));
    let ascii = ply_header("ascii", 2500, "uchar") + &text_rows(2500);
    check("a.ply", ascii.as_bytes());
}

#[test]
fn blocks_of_texts_are_the_points_of_the_file() {
    check("a.xyz", text_rows(2500).as_bytes());
    check("a.xyz", format!("2500\n{}", text_rows(2500)).as_bytes());
    check("a.xyz", format!("x y z r g b\n# a comment\n{}", text_rows(2500)).as_bytes());
    check("a.xyz", text_rows(2500).trim_end().as_bytes());
}

/// A file is read as a whole if its reader warns, or if a block could not know how later rows are read.
#[test]
fn unusual_files_are_read_as_a_whole() {
    fn refuse(name: &str, bytes: &[u8]) {
        let blocks = read_blocks(name, bytes, 10);
        let whole = blocks.map(|blocks| Points::concat(&blocks));
        assert!(whole.is_none_or(|whole| whole.is_err()), "{name}");
    }
    let rest = [binary_ply(50), b"?".to_vec()].concat();
    refuse("a.ply", &rest);
    refuse("a.ply", &binary_ply(50)[..400]);
    refuse("a.ply", (ply_header("ascii", 50, "float") + &text_rows(50)).as_bytes());
    refuse("a.ply", (ply_header("ascii", 50, "uchar") + &text_rows(51)).as_bytes());
    refuse("a.xyz", format!("51\n{}", text_rows(50)).as_bytes());
    refuse("a.xyz", format!("{}nan 0 0 1 1 1\n", text_rows(50)).as_bytes());
    // The last three columns of the first block are colors, those of all rows are not.
    refuse("a.xyz", format!("{}1 2 3 400 1 1\n", text_rows(50)).as_bytes());
    refuse("a.xyz", text_rows(50).replace('\n', "\r").as_bytes());
}
