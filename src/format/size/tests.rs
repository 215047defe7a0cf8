use maquette_node::importers::{InputFile, Readers};
use maquette_node::{AnyValue, ValueType, value_type};
use maquette_value::{Image, Mesh, Points, RangeImage};

use super::*;
use crate::READERS;

/// Returns the size that the start of a file tells, and the value that the file has.
fn size_and_value(path: &str, kind: &ValueType) -> (ValueSize, AnyValue) {
    let path = format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR"));
    let bytes = std::fs::read(&path).unwrap();
    let readers = Readers::new(READERS.iter().copied());
    let extension = path.rsplit('.').next().unwrap();
    let read_at = |offset: u64, count: usize| {
        let rest = bytes.get(offset as usize..)?;
        Some(rest[..rest.len().min(count)].to_vec())
    };
    let start = &bytes[..bytes.len().min(FileHead::START)];
    let head = FileHead { extension, length: bytes.len() as u64, start, read_at: &read_at };
    let size = readers.size(kind, &head).unwrap_or_else(|| panic!("{path}: no size"));
    (size, readers.read(kind, &InputFile::standalone(&path, &bytes)).unwrap())
}

/// Checks that the counts are exact where the size says so, and that all numbers are within a factor of 2.
fn check(path: &str, kind: &ValueType) {
    let (size, value) = size_and_value(path, kind);
    let found = ValueSize::of_value(&value);
    if size.certainty == Certainty::Exact {
        assert_eq!((size.points, size.faces), (found.points, found.faces), "{path}");
    }
    for (told, found) in [
        (size.points, found.points),
        (size.faces, found.faces),
        (size.corners, found.corners),
        (size.bytes, found.bytes),
    ] {
        assert!(told <= 2.0 * found && found <= 2.0 * told, "{path}: {size:?} {found}");
    }
}

#[test]
fn points_are_counted_by_the_header() {
    for path in ["tests/data/formats/survey.las", "tests/data/formats/bytes.las"] {
        check(path, value_type::<Points>());
    }
}

#[test]
fn the_scans_of_an_e57_file_are_counted_by_its_description() {
    let (size, _) = size_and_value("tests/data/formats/two_scans.e57", value_type::<Points>());
    // An invalid point is counted, too.
    assert_eq!((size.points, size.certainty), (4.0, Certainty::Exact));
}

#[test]
fn grids_are_measured_by_their_headers() {
    check("graphs/doll/range.pcd", value_type::<RangeImage>());
    for name in ["ascii.pcd", "binary.pcd", "range_grid_le.ply", "range_grid_ascii.ply"] {
        check(&format!("tests/data/formats/{name}"), value_type::<RangeImage>());
    }
}

#[test]
fn pictures_are_measured_by_their_headers() {
    let names = "photo.jpg progressive.jpg cmyk.jpg gray.jpg rgb.bmp palette.bmp photo.webp lossless.webp alpha.webp light.exr light.hdr \
                 deflate_rgba.tiff lzw.tiff";
    for name in names.split_whitespace() {
        check(&format!("tests/data/formats/{name}"), value_type::<Image>());
    }
    check("graphs/doll/color.png", value_type::<Image>());
}

#[test]
fn meshes_are_measured_by_their_headers_or_by_samples() {
    check("tests/data/formats/square.stl", value_type::<Mesh>());
    check("graphs/doll/coarse.obj", value_type::<Mesh>());
    check("graphs/doll/points.xyz", value_type::<Points>());
}

/// Returns the size of a picture that begins with these bytes.
fn picture_of(start: &[u8]) -> Option<[u32; 2]> {
    let read_at = |offset: u64, _: usize| start.get(offset as usize..).map(<[u8]>::to_vec);
    picture_size(&FileHead { extension: "", length: 1 << 30, start, read_at: &read_at })
}

#[test]
fn the_size_of_a_photograph_follows_its_other_segments() {
    let jpeg = b"\xff\xd8\xff\xe0\0\x04ab\xff\xc4\0\x03z\xff\xc2\0\x11\x08\x01\x02\x03\x04rest";
    assert_eq!(picture_of(jpeg), Some([0x304, 0x102]));
    for cut in 0..jpeg.len() - 4 {
        assert_eq!(picture_of(&jpeg[..cut]), (cut >= 22).then_some([0x304, 0x102]), "{cut}");
    }
}

#[test]
fn a_directory_of_tags_has_the_size_of_a_picture() {
    let tiff =
        b"II*\0\x08\0\0\0\x02\0\0\x01\x03\0\x01\0\0\0\x05\0\0\0\x01\x01\x04\0\x01\0\0\0\x07\0\0\0";
    assert_eq!(picture_of(tiff), Some([5, 7]));
}

#[test]
fn radiance_and_windows_pictures_state_their_size() {
    assert_eq!(picture_of(b"#?RADIANCE\nFORMAT=x\n\n-Y 12 +X 34\n"), Some([34, 12]));
    let mut bmp = b"BM".to_vec();
    bmp.resize(18, 0);
    bmp.extend(6_i32.to_le_bytes());
    bmp.extend((-9_i32).to_le_bytes());
    assert_eq!(picture_of(&bmp), Some([6, 9]));
}

#[test]
fn a_long_text_is_like_its_samples() {
    let text = "v 1.25 2.5 3.75\n".repeat(60_000) + &"f 1 2 3\n".repeat(120_000);
    let bytes = text.as_bytes();
    let read_at = |offset: u64, count: usize| {
        let rest = bytes.get(offset as usize..)?;
        Some(rest[..rest.len().min(count)].to_vec())
    };
    let start = &bytes[..FileHead::START];
    let length = bytes.len() as u64;
    let size = obj(&FileHead { extension: "obj", length, start, read_at: &read_at }).unwrap();
    assert!((size.points / 60_000.0 - 1.0).abs() < 0.05, "{size:?}");
    assert!((size.faces / 120_000.0 - 1.0).abs() < 0.05, "{size:?}");
    assert_eq!(size.certainty, Certainty::Guess);
}
