//! Tests of the choice of a reader by type and extension.

use maquette_node::importers::{InputFile, Readers};
use maquette_value::{Mesh, Points, value_type};

use crate::READERS;

#[test]
fn the_type_and_the_extension_choose_the_reader() {
    let readers = Readers::new(READERS.iter().copied());
    let triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let file = InputFile::standalone("a.obj", triangle);
    let mesh = readers.read(value_type::<Mesh>(), &file).unwrap();
    assert_eq!(mesh.get::<Mesh>().unwrap().faces().len(), 1);
    let error = readers.read(value_type::<Points>(), &file).unwrap_err().to_string();
    assert_eq!(
        error,
        "no Points can be read from `.obj`; supported extensions: ply, pcd, xyz, xyzn, xyzrgb, xyzi, pts, asc, ptx, las, laz, e57"
    );
    let error = readers.read_any(&InputFile::standalone("a", triangle)).unwrap_err().to_string();
    assert!(error.starts_with(
        "no value can be read from a file without an extension; supported extensions: "
    ));
}

#[test]
fn a_byte_order_mark_is_skipped_in_a_text_and_in_files_it_names() {
    let cube = b"\xef\xbb\xbfv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 9\nf 1 2 3\n";
    let mesh: Mesh = crate::read(&InputFile::standalone("a.obj", cube)).unwrap();
    assert_eq!(mesh.positions().len(), 4);
    let points = InputFile::standalone("a.xyz", b"\xef\xbb\xbf1 2 3\n");
    assert_eq!(crate::read::<Points>(&points).unwrap().positions().len(), 1);
    let named = InputFile::new("a.obj", cube, &|_: &str| Ok(b"\xef\xbb\xbfnewmtl a\n"[..].into()))
        .companion("a.mtl")
        .unwrap();
    assert_eq!(&named[..], b"newmtl a\n");
    // The bytes of the binary numbers begin with those of a byte order mark.
    let numbers = [&b"\xef\xbb\xbf\x3f"[..], &[0; 200]].concat();
    assert_eq!(InputFile::standalone("a.stl", &numbers).bytes(), numbers);
}

#[test]
fn a_file_of_unknown_type_is_read_as_the_type_that_is_not_empty() {
    let readers = Readers::new(READERS.iter().copied());
    let cloud = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n";
    let value = readers.read_any(&InputFile::standalone("a.ply", cloud)).unwrap();
    assert_eq!(value.kind().name, "Points");
}

#[test]
fn all_reasons_are_reported_and_the_most_frequent_one_first() {
    let readers = Readers::new(READERS.iter().copied());
    let why = |file: &[u8]| {
        readers.read_any(&InputFile::standalone("a.ply", file)).unwrap_err().to_string()
    };
    let wrong = b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n1 2 3\n4 5 6\n3 0 1 7\n";
    let expected =
        "as Mesh or Points: face 0 refers to vertex 7, but there are only 2; as RangeImage: ";
    let told = why(wrong);
    assert!(told.starts_with(expected), "{told}");
    // An error that all readers report is listed once.
    assert!(!why(b"plain text").contains("as Mesh"));
    let wide: Vec<_> = "ply\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let told = why(&[b"\xff\xfe", &wide[..]].concat());
    assert_eq!(told, "it is text in UTF-16: save it as UTF-8");
}
