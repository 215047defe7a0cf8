//! Round trips of materials through GLB and OBJ files: unchanged properties must be kept.

use std::sync::Arc;

use maquette_node::importers::InputFile;
use maquette_node::pack::NewFile;
use maquette_value::{
    AnyValue, Attribute, Column, Faces, Image, MATERIAL_ATTRIBUTE, Map, MapKind, Material, Mesh,
    Transparency, UvTransform, Wrap, value_type,
};
use nalgebra::Point3;

use crate::{FORMATS, png};

fn picture(seed: u8) -> Column<u8> {
    let pixels: Vec<_> = (0..4).map(|k: u8| [seed, 60 * k, 255 - seed]).collect();
    png::encode_rgb(&Image::new(2, 2, pixels).unwrap()).unwrap().into()
}

fn map(seed: u8) -> Map {
    Map { wrap: [Wrap::Repeat, Wrap::Mirror], ..Map::new(format!("{seed}.png"), picture(seed)) }
}

/// Creates two adjacent squares, with texture coordinates beyond the border of the picture.
fn squares() -> Mesh {
    fn point(x: u32, y: u32) -> Point3<f64> {
        Point3::new(f64::from(x), f64::from(y), 0.0)
    }
    let positions =
        vec![point(0, 0), point(1, 0), point(2, 0), point(0, 1), point(1, 1), point(2, 1)];
    let faces = vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]];
    let uv = positions.iter().map(|point| [2.0 * point.x - 0.5, point.y + 0.25]).collect();
    let mesh = Mesh::new(positions, Faces::triangles(faces)).unwrap();
    mesh.with_vertex("uv", Attribute::Pair(uv)).unwrap()
}

/// A material with all properties that both glTF and MTL support.
fn full_material(base_color: [f64; 4]) -> Material {
    let base = map(10);
    fn packed_map(channel: u8) -> Map {
        Map { channel: Some(channel), ..map(20) }
    }
    let picture = crate::picture_file::read(&base.bytes).unwrap();
    Material {
        name: "skin".to_owned(),
        picture: Some(picture),
        base_color,
        metallic: 0.5,
        roughness: 0.25,
        emissive: [0.0, 0.5, 1.0],
        transparency: Transparency::Blend,
        is_double_sided: true,
        has_vertex_colors: false,
        maps: [
            (MapKind::BaseColor, base),
            (MapKind::Metallic, packed_map(2)),
            (MapKind::Roughness, packed_map(1)),
            (MapKind::Occlusion, packed_map(0)),
            (MapKind::Normal, Map { strength: 0.5, ..map(128) }),
            (MapKind::Emissive, map(30)),
        ]
        .into(),
        others: [].into(),
    }
}

fn round_trip(mesh: &Mesh, ending: &str) -> (Mesh, Vec<NewFile>) {
    let format = FORMATS
        .iter()
        .find(|format| format.extension == ending && (format.kind)() == value_type::<Mesh>())
        .unwrap();
    let files = format.write(&AnyValue::new(mesh.clone()), &format!("it.{ending}")).unwrap();
    let find = |name: &str| {
        let found = files.iter().find(|file| file.name == name);
        found.map(|file| Arc::from(&file.bytes[..])).ok_or_else(|| format!("no {name}"))
    };
    let read = InputFile::new(&files[0].name, &files[0].bytes, &find);
    let again = crate::read::<Mesh>(&read).unwrap();
    assert_eq!(read.warnings(), [""; 0]);
    (again, files)
}

/// Returns the texture coordinates per corner. Rounding may have split the coordinates of a vertex at which two materials meet.
fn corner_uv(mesh: &Mesh) -> Vec<[f64; 2]> {
    match (mesh.corner().pairs("uv"), mesh.vertex().pairs("uv")) {
        (Some(uv), _) => uv.to_vec(),
        (None, uv) => mesh.faces().corners().iter().map(|&it| uv.unwrap()[it as usize]).collect(),
    }
}

/// Returns the materials without the file names of their pictures.
fn without_file_names(mesh: &Mesh) -> Vec<Material> {
    let mut all = mesh.materials().to_vec();
    all.iter_mut().flat_map(|it| it.maps.values_mut()).for_each(|map| map.file.clear());
    all
}

#[test]
fn materials_survive_glb_with_the_bytes_of_their_pictures() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let transform = UvTransform { offset: [0.5, 0.25], rotation: quarter, scale: [2.0, 0.5] };
    let mut skin = full_material([1.0, 1.0, 1.0, 0.5]);
    skin.maps.values_mut().for_each(|map| map.filters = [9729, 9987]);
    let bare = Material {
        name: "bare".to_owned(),
        base_color: [1.0, 0.0, 0.0, 1.0],
        is_double_sided: false,
        others: [("KHR_materials_ior".to_owned(), r#"{"ior":1.25}"#.to_owned())].into(),
        ..Material::default()
    };
    // The occlusion map has its own texture coordinates; all other maps are transformed.
    fn move_map(kind: &MapKind, map: &mut Map, transform: &UvTransform) {
        match kind {
            MapKind::Occlusion => map.uv = "uv1".to_owned(),
            _ => map.transform = *transform,
        }
    }
    skin.maps.iter_mut().for_each(|(kind, map)| move_map(kind, map, &transform));
    let second = Attribute::Pair((0..6).map(|k| [f64::from(k) / 8.0, 0.5]).collect());
    let colors = Attribute::Color([[255, 255, 255], [255, 0, 0], [255, 0, 0]].repeat(2).into());
    let ring = Attribute::Index((0..6).collect());
    let weight = Attribute::Number((0..6).map(|k| f64::from(k) / 4.0).collect());
    let mesh = squares()
        .with_vertex("uv1", second)
        .and_then(|mesh| mesh.with_vertex("color", colors))
        .and_then(|mesh| mesh.with_vertex("ring", ring))
        .and_then(|mesh| mesh.with_vertex("weight", weight))
        .and_then(|mesh| {
            mesh.with_face(MATERIAL_ATTRIBUTE, Attribute::Index(vec![0, 0, 1, 1].into()))
        })
        .unwrap()
        .with_materials([skin, bare]);
    let (again, files) = round_trip(&mesh, "glb");
    assert_eq!(again.materials()[..], mesh.materials()[..]);
    assert_eq!(again.face().get(MATERIAL_ATTRIBUTE), mesh.face().get(MATERIAL_ATTRIBUTE));
    // In the file, vertices are duplicated for each material and are in another order.
    let vertices = again.positions().iter().map(|point| {
        mesh.positions().iter().position(|it| (it - point).norm() < 1e-6).unwrap() as u32
    });
    let vertices: Vec<u32> = vertices.collect();
    for name in ["uv1", "ring", "weight"] {
        let expected = mesh.vertex().get(name).unwrap().select(&vertices);
        assert_eq!(again.vertex().get(name), Some(&expected), "{name}");
    }
    // The picture is not multiplied by the vertex colors.
    let colors = again.corner().colors("color").unwrap();
    assert_eq!((colors[0], colors[6]), ([255; 3], [255, 0, 0]));
    fn is_near(a: &[f64; 2], b: &[f64; 2]) -> bool {
        (0..2).all(|k| (a[k] - b[k]).abs() < 1e-6)
    }
    let [before, after] = [&mesh, &again].map(corner_uv);
    assert!(before.iter().zip(&after).all(|(a, b)| is_near(a, b)), "{before:?} {after:?}");
    // Further round trips must change nothing, and each picture must be stored once, byte for byte.
    let (again, second) = round_trip(&again, "glb");
    let (_, third) = round_trip(&again, "glb");
    assert!(second == third);
    assert_eq!(again.materials()[..], mesh.materials()[..]);
    for seed in [10, 20, 30, 128] {
        let picture = picture(seed);
        let count = files[0].bytes.windows(picture.len()).filter(|it| **it == picture[..]).count();
        assert_eq!(count, 1, "{seed}");
    }
}

#[test]
fn materials_survive_obj_with_the_files_of_their_pictures() {
    let mut skin = full_material([1.0, 1.0, 1.0, 0.5]);
    skin.maps.values_mut().for_each(|map| map.wrap = [Wrap::Repeat; 2]);
    skin.others.insert("illum".to_owned(), "2".to_owned());
    skin.others.insert("Kd".to_owned(), "0.8 0.8 0.8".to_owned());
    skin.maps.insert(MapKind::Other("map_Ks".to_owned()), Map::new("ks.png", picture(40)));
    let bare = Material {
        name: "bare".to_owned(),
        base_color: [1.0, 0.25, 0.0, 1.0],
        ..Material::default()
    };
    let numbers = Attribute::Index(vec![0, 1, 0, 1].into());
    let mesh =
        squares().with_face(MATERIAL_ATTRIBUTE, numbers).unwrap().with_materials([skin, bare]);
    let (again, files) = round_trip(&mesh, "obj");
    assert_eq!(without_file_names(&again), without_file_names(&mesh));
    // Faces keep their order.
    assert_eq!(again.face().get(MATERIAL_ATTRIBUTE), mesh.face().get(MATERIAL_ATTRIBUTE));
    assert_eq!(again.faces(), mesh.faces());
    let names: Vec<_> = files.iter().map(|file| &*file.name).collect();
    let pictures = ["it_10.png", "it_30.png", "it_20.png", "it_128.png", "it_ks.png"];
    assert_eq!(names, [&["it.obj", "it.mtl"][..], &pictures].concat());
    assert_eq!(files[2].bytes[..], picture(10)[..]);
    let (_, second) = round_trip(&again, "obj");
    assert!(second == files);
}

/// For glTF, metallic and roughness are packed into one picture; for OBJ, the base color is multiplied into the picture.
#[test]
fn materials_are_converted_between_formats() {
    let skin = Material { transparency: Transparency::Opaque, ..full_material([1.0; 4]) };
    let mesh = squares().with_materials([skin]);
    let (of_obj, _) = round_trip(&mesh, "obj");
    let (of_both, _) = round_trip(&of_obj, "glb");
    fn bytes(mesh: &Mesh) -> Vec<(MapKind, Column<u8>, Option<u8>)> {
        let maps = mesh.materials()[0].maps.clone();
        maps.into_iter().map(|(kind, map)| (kind, map.bytes, map.channel)).collect::<Vec<_>>()
    }
    assert_eq!(bytes(&of_both), bytes(&mesh));
    // Separate metallic and roughness pictures become one.
    let mut apart = of_obj.materials()[0].clone();
    for (kind, seed) in [(MapKind::Metallic, 20), (MapKind::Roughness, 40)] {
        apart.maps.insert(kind, Map { channel: None, ..map(seed) });
    }
    let (packed, _) = round_trip(&of_obj.clone().with_materials([apart]), "glb");
    let maps = &packed.materials()[0].maps;
    assert_eq!(maps[&MapKind::Metallic].bytes, maps[&MapKind::Roughness].bytes);
    let picture = crate::picture_file::read(&maps[&MapKind::Metallic].bytes).unwrap();
    assert_eq!(picture.pixel([0, 0]), [255, 40, 20]);

    let red = round_trip(&squares().with_materials([full_material([1.0, 0.0, 0.0, 1.0])]), "glb").0;
    let multiplied = red.texture().unwrap().clone();
    assert_eq!(multiplied.pixel([1, 0]), [10, 0, 0]);
    let of_obj = round_trip(&red, "obj").0;
    assert_eq!(of_obj.texture(), Some(&multiplied));
}

#[test]
fn unused_materials_are_left_out_and_faces_before_the_first_usemtl_have_none() {
    let obj =
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl red\nf 3 2 1\nusemtl gone\n";
    let beside = |name: &str| match name {
        "a.mtl" => Ok(Arc::from(&b"newmtl red\nKd 1 0 0\nnewmtl other\nKd 0 1 0\n"[..])),
        _ => Err(format!("there is no file `{name}`")),
    };
    let file = InputFile::new("a.obj", obj.as_bytes(), &beside);
    let mesh = crate::read::<Mesh>(&file).unwrap();
    assert_eq!(file.warnings(), ["there is no material `gone` in `a.mtl`"]);
    let names: Vec<_> = mesh.materials().iter().map(|material| &*material.name).collect();
    assert_eq!(names, ["red", ""]);
    assert_eq!(mesh.face_materials().map(|all| all.to_vec()), Some(vec![1, 0]));
}
