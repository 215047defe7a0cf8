//! Reads files of other programs, and compares the results, errors and warnings with `tests/data/others/read.txt`. Every line of this file
//! was checked by hand.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use expect_test::expect_file;
use maquette_node::importers::{InputFile, NoReader};
use maquette_syntax::error::Error;
use maquette_value::{Material, Mesh, Points, RangeImage};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/others");

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.extension().and_then(|ending| ending.to_str()) {
            None => files(&path, found),
            Some(
                "ply" | "obj" | "stl" | "glb" | "gltf" | "xyz" | "pcd" | "ptx" | "3mf" | "png",
            ) => found.push(path),
            Some(_) => {}
        }
    }
}

/// Describes a mesh in one line of text.
fn mesh(mesh: &Mesh) -> String {
    let area = mesh.faces().iter().flat_map(|face| {
        face[1..].windows(2).map(|pair| {
            let [a, b, c] =
                [face[0], pair[0], pair[1]].map(|vertex: u32| mesh.positions()[vertex as usize]);
            (b - a).cross(&(c - a)).norm() / 2.0
        })
    });
    let area: f64 = area.sum();
    let mut text = format!(
        "{} vertices, {} faces, area {area:.2}",
        mesh.positions().len(),
        mesh.faces().len()
    );
    let domains = [("vertex", mesh.vertex()), ("corner", mesh.corner()), ("face", mesh.face())];
    for (domain, attributes) in domains {
        for (name, _) in attributes.iter() {
            write!(text, ", {domain} {name}").unwrap();
            if let Some(colors) = attributes.colors(name) {
                write!(text, " {:?}", &colors[..colors.len().min(4)]).unwrap();
            }
            if let Some(pairs) = attributes.pairs(name) {
                fn max_of(k: usize, pairs: &maquette_value::Column<[f64; 2]>) -> f64 {
                    pairs.iter().map(|pair| pair[k]).fold(f64::MIN, f64::max)
                }
                fn min_of(k: usize, pairs: &maquette_value::Column<[f64; 2]>) -> f64 {
                    pairs.iter().map(|pair| pair[k]).fold(f64::MAX, f64::min)
                }
                write!(
                    text,
                    " {}..{} {}..{}",
                    min_of(0, pairs),
                    max_of(0, pairs),
                    min_of(1, pairs),
                    max_of(1, pairs)
                )
                .unwrap();
            }
        }
    }
    if let Some(picture) = mesh.texture() {
        write!(text, ", picture {}x{}", picture.width(), picture.height()).unwrap();
    }
    for material in mesh.materials().iter().filter(|material| !material.is_plain()) {
        let maps = material.maps.iter().map(|(kind, map)| format!("{kind:?} {}", map.file));
        let others = material.others.iter().map(|(name, words)| format!("{name} {words}"));
        let all = maps.chain(others).collect::<Vec<_>>().join(", ");
        let Material { name, base_color, metallic, roughness, .. } = material;
        write!(text, "\n    material `{name}` {base_color:?} {metallic} {roughness}: {all}")
            .unwrap();
    }
    text
}

fn points(points: &Points) -> String {
    let last = points.positions().last().unwrap();
    let mut text = format!("{} points, the last at {last}", points.positions().len());
    for (name, _) in points.attributes().iter() {
        write!(text, ", {name}").unwrap();
    }
    text
}

fn range(range: &RangeImage) -> String {
    let last = (0..range.points().len()).rev().find_map(|cell| range.point(cell));
    let size = [range.width(), range.height()];
    format!("grid {size:?}, {} points, the last at {}", range.n_valid(), last.unwrap())
}

#[test]
fn files_of_other_programs_are_read_or_rejected_with_help() {
    let mut paths = Vec::new();
    files(Path::new(FOLDER), &mut paths);
    paths.sort();
    let mut report = String::new();
    for path in paths {
        let bytes = fs::read(&path).unwrap();
        let folder = path.parent().unwrap();
        let beside = |name: &str| {
            let found = fs::read(folder.join(name)).map(Arc::from);
            found.map_err(|_| format!("there is no file `{name}`"))
        };
        let name = path.file_name().unwrap().to_str().unwrap();
        if name.ends_with("png") && name != "depth.png" {
            continue;
        }
        writeln!(report, "{}", path.strip_prefix(FOLDER).unwrap().display()).unwrap();
        let mut append = |file: &InputFile<'_>, found: Result<String, Error>| {
            // A file is skipped if no reader for its extension returns the type.
            if found.as_ref().is_err_and(|error| error.downcast::<NoReader>().is_some()) {
                return;
            }
            writeln!(report, "    {}", found.unwrap_or_else(|error| format!("refused: {error}")))
                .unwrap();
            file.warnings()
                .iter()
                .for_each(|warning| writeln!(report, "    warning: {warning}").unwrap());
        };
        let file = || InputFile::new(name, &bytes, &beside);
        let read = file();
        append(&read, crate::read::<Mesh>(&read).map(|read| mesh(&read)));
        let read = file();
        append(&read, crate::read::<Points>(&read).map(|read| points(&read)));
        // Only PLY files with a grid can be read as range images, and pictures only with a camera.
        if ["pcd", "ptx"].iter().any(|ending| name.ends_with(ending)) || name == "depth.png" {
            let read = file();
            append(&read, crate::read::<RangeImage>(&read).map(|read| range(&read)));
        }
    }
    expect_file![concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/others/read.txt")]
        .assert_eq(&report);
}
