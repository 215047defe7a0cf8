//! Reads the materials of an OBJ file. The OBJ file refers to MTL files, and these refer to pictures, by paths relative to the referring
//! file.
//!
//! The supported statements are those of Wavefront's manual ("Alias/WaveFront Material (.mtl) File Format", 1995), and those that exporters
//! write for physically based materials: `Pr`, `Pm`, `map_Pr`, `map_Pm`, `map_ORM`, `map_RMA`, `map_ao`, `norm`.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_value::{Image, Map, MapKind, Material, Transparency, UvTransform, Wrap};

use super::mtl::{
    Layout, MapUse, MtlMaterial, NamedFile, find_first, find_libraries, is_picture, names, options,
    read_materials, spellings,
};
use crate::picture_file;

/// Loads a file by its path relative to the OBJ file, or returns the reason why the file cannot be loaded.
pub type FindFile<'a> = &'a mut dyn FnMut(&str) -> Result<Arc<[u8]>, String>;

/// The materials that an OBJ file uses, with warnings.
#[derive(Default)]
pub(super) struct UsedMaterials {
    /// One material per name, or at most one material if the OBJ file uses no name.
    pub(super) materials: Vec<Material>,
    /// For each material, the placements of its pictures: one for each of the attributes `uv`, `uv1`, ..
    pub(super) layouts: Vec<Vec<Layout>>,
    /// Warnings about materials and pictures that are missing or not read completely.
    pub(super) warnings: Vec<String>,
}

/// Reads the materials that an OBJ file uses from its MTL files.
pub fn materials(bytes: &[u8], find: FindFile<'_>) -> Vec<Material> {
    let [libraries, used] = names(bytes);
    read_named(&libraries, &used, true, find).materials
}

/// Requests the MTL files and the pictures of an OBJ file through `find`, without decoding the pictures.
pub(super) fn request_files(bytes: &[u8], find: FindFile<'_>) {
    let [libraries, used] = names(bytes);
    let mut all = Vec::new();
    for library in &libraries {
        let files = find_libraries(library, find).unwrap_or_default();
        all.extend(files.iter().flat_map(|(name, bytes)| read_materials(bytes, name)));
    }
    let by_name = by_name(&all);
    let indices = used.iter().filter_map(|name| spellings(name).find_map(|it| by_name.get(it)));
    let first = all.iter().filter(|material| used.is_empty() && material.base_color().is_some());
    for material in indices.map(|&index| &all[index]).chain(first.take(1)) {
        for (_, rest) in material.maps() {
            let name = options(rest).0.replace('\\', "/");
            drop(find_first(spellings(&name).map(|name| material.folder.join(name)), find));
        }
    }
}

/// Returns for each material name the index of the first material with this name.
fn by_name(materials: &[MtlMaterial]) -> HashMap<&str, usize> {
    let names = materials.iter().enumerate().rev();
    names.map(|(index, material)| (&material.name[..], index)).collect()
}

/// Reads the materials with the names `used`; if there are none, reads the first material with a picture. `libraries` are the arguments of
/// `mtllib`. Pictures are left out if the mesh has no texture coordinates.
pub(super) fn read_named(
    libraries: &[String],
    used: &[String],
    has_uv: bool,
    find: FindFile<'_>,
) -> UsedMaterials {
    let mut found = UsedMaterials::default();
    let mut all = Vec::new();
    for library in libraries {
        match find_libraries(library, find) {
            Ok(files) => {
                all.extend(files.iter().flat_map(|(name, bytes)| read_materials(bytes, name)));
            }
            Err(why) => found.warnings.push(format!("{why}: the mesh comes without its materials")),
        }
    }
    if libraries.is_empty() || !found.warnings.is_empty() && all.is_empty() {
        return found;
    }
    let by_name = by_name(&all);
    let mut files = Files {
        find,
        known: BTreeMap::new(),
        pictures: BTreeMap::new(),
        has_uv,
        warnings: Vec::new(),
    };
    if used.is_empty() {
        let first = all.iter().find(|material| material.base_color().is_some());
        let made = first.map(|material| files.material(material));
        (found.materials, found.layouts) = made.into_iter().unzip();
    }
    for name in used {
        // A `#` may be part of the name, or begin a comment after the name.
        let index = spellings(name).find_map(|spelling| by_name.get(spelling));
        let (material, layouts) = match index {
            Some(&index) => files.material(&all[index]),
            None => {
                let all: Vec<_> = libraries.iter().map(|library| format!("`{library}`")).collect();
                files.warnings.push(format!("there is no material `{name}` in {}", all.join(", ")));
                (Material::default(), Vec::new())
            }
        };
        found.materials.push(material);
        found.layouts.push(layouts);
    }
    found.warnings.append(&mut files.warnings);
    found
}

/// Loads and caches the picture files of materials.
struct Files<'a> {
    find: FindFile<'a>,
    /// The loaded files. The key is the path; the value also has the path by which the file was found, or is `None` if the file cannot be
    /// loaded.
    known: BTreeMap<PathBuf, Option<NamedFile>>,
    /// The decoded color pictures, by path; `None` if a picture is damaged.
    pictures: BTreeMap<String, Option<Image>>,
    has_uv: bool,
    warnings: Vec<String>,
}

impl Files<'_> {
    /// Loads a picture file. If that fails, adds a warning and returns `None`.
    fn file(&mut self, folder: &Path, name: &str) -> Option<NamedFile> {
        let key = folder.join(name);
        if !self.known.contains_key(&key) {
            let found = find_first(spellings(name).map(|name| folder.join(name)), self.find);
            let found = found.and_then(|(name, bytes)| match picture_file::Kind::detect(&bytes) {
                Some(_) => Ok((name, bytes)),
                None => match picture_file::read(&bytes) {
                    Err(error) => Err(format!("{name}: {error}")),
                    Ok(_) => Ok((name, bytes)),
                },
            });
            let found = found.map_err(|why| {
                self.warnings.push(format!("{why}: the mesh comes without its picture"));
            });
            self.known.insert(key.clone(), found.ok());
        }
        self.known[&key].clone()
    }

    /// Converts an MTL material. Returns the material and the placement of its pictures.
    fn material(&mut self, from: &MtlMaterial) -> (Material, Vec<Layout>) {
        let mut material = Material { name: from.name.clone(), ..Material::default() };
        let (mut layouts, mut shine) = (Vec::new(), None);
        let mut color = None;
        for (keyword, rest) in &from.statements {
            let numbers = rest.split_whitespace().map_while(|word| word.parse::<f64>().ok());
            let numbers: Vec<_> = numbers.filter(|number| number.is_finite()).collect();
            let lower = keyword.to_ascii_lowercase();
            match (&lower[..], &numbers[..]) {
                // A color given by one number is gray.
                ("kd", [red, green, blue, ..]) => color = Some([*red, *green, *blue]),
                ("kd", [gray]) => color = Some([*gray; 3]),
                ("ke", [red, green, blue, ..]) => material.emissive = [*red, *green, *blue],
                ("d", [opacity]) => material.base_color[3] = *opacity,
                ("tr", [clear]) => material.base_color[3] = 1.0 - clear,
                ("pr", [rough]) => material.roughness = *rough,
                ("pm", [metal]) => material.metallic = *metal,
                ("ns", [exponent]) => {
                    shine = Some(*exponent);
                    material.others.insert(keyword.clone(), rest.clone());
                }
                _ if is_picture(&lower) => {}
                _ => drop(material.others.insert(keyword.clone(), rest.clone())),
            }
        }
        fn has(wanted: &str, from_statements: &[(String, String)]) -> bool {
            from_statements.iter().any(|(keyword, _)| keyword.eq_ignore_ascii_case(wanted))
        }
        if let Some(shine) =
            shine.filter(|_| !has("pr", &from.statements) && !has("map_pr", &from.statements))
        {
            // Shininess is converted to roughness by Blender's formula.
            material.roughness = 1.0 - (shine.clamp(0.0, 1000.0) / 1000.0).sqrt();
        }
        if material.base_color[3] < 1.0 {
            material.transparency = Transparency::Blend;
        }
        if !self.has_uv {
            if let Some((_, rest)) = from.base_color() {
                let name = options(rest).0;
                self.warnings.push(format!(
                    "the picture `{name}` is left out: the mesh has no texture coordinates"
                ));
            }
        } else {
            for (kinds, rest) in from.maps() {
                self.add_map(&mut material, &mut layouts, from, kinds, rest);
            }
        }
        match color {
            // Do not apply a color beside a picture: exporters write arbitrary colors there, which most programs ignore.
            Some([1.0, 1.0, 1.0]) if material.picture.is_some() => {}
            Some(color) if material.picture.is_some() => {
                let words = color.map(|channel| channel.to_string()).join(" ");
                material.others.insert("Kd".to_owned(), words);
            }
            Some(color) => material.base_color[..3].copy_from_slice(&color),
            None => {}
        }
        (material, layouts)
    }

    /// Adds the picture of a map statement to a material.
    fn add_map(
        &mut self,
        material: &mut Material,
        layouts: &mut Vec<Layout>,
        from: &MtlMaterial,
        kinds: Vec<MapUse>,
        rest: &str,
    ) {
        let (name, options) = options(rest);
        let name = name.replace('\\', "/");
        let Some((name, bytes)) = self.file(&from.folder, &name) else { return };
        let is_color = kinds[0].0 == MapKind::BaseColor;
        if is_color {
            if !self.pictures.contains_key(&name) {
                let picture = picture_file::read(&bytes).map_err(|error| {
                    let warning = format!("{name}: {error}: the mesh comes without its picture");
                    self.warnings.push(warning);
                });
                self.pictures.insert(name.clone(), picture.ok());
            }
            material.picture = self.pictures[&name].clone();
            if material.picture.is_none() {
                return;
            }
        }
        let Layout { scale, offset } = options.layout;
        let index = layouts.iter().position(|it| *it == options.layout).unwrap_or_else(|| {
            layouts.push(options.layout);
            layouts.len() - 1
        });
        let short = name.rsplit('/').next().unwrap_or(&name);
        self.warnings.extend(
            options.lost.iter().map(|option| {
                format!("the option `{option}` of the picture `{short}` is left out")
            }),
        );
        let mut map = Map::new(short, bytes.to_vec());
        map.strength = options.strength;
        map.uv = if index == 0 { "uv".to_owned() } else { format!("uv{index}") };
        let offset = [offset[0], 1.0 - scale[1] - offset[1]];
        map.transform = UvTransform { offset, scale, rotation: 0.0 };
        if options.is_clamped {
            map.wrap = [Wrap::Clamp; 2];
        }
        for (kind, channel) in kinds {
            fn has_picture(material: &Material, kind: &MapKind, picture: &Map) -> bool {
                material.maps.get(kind).is_some_and(|map| map.bytes == picture.bytes)
            }
            let kind = match kind {
                MapKind::Other(keyword)
                    if is_bump(&keyword) && has_picture(material, &MapKind::Normal, &map) =>
                {
                    continue;
                }
                MapKind::Other(keyword) if is_bump(&keyword) && is_of_normals(&bytes) => {
                    MapKind::Normal
                }
                // If the opacity is in the color picture itself, no separate map is needed.
                MapKind::Other(keyword) if keyword.eq_ignore_ascii_case("map_d") => {
                    material.transparency = Transparency::Blend;
                    if has_picture(material, &MapKind::BaseColor, &map) {
                        continue;
                    }
                    MapKind::Other(keyword)
                }
                kind => kind,
            };
            let channel = options.channel.map(|channel| channel as u8).or(channel);
            material.maps.entry(kind).or_insert_with(|| Map { channel, ..map.clone() });
        }
    }
}

/// Returns true if a picture looks like a normal map. Such a picture is mostly blue, because normals point away from the surface.
fn is_of_normals(bytes: &[u8]) -> bool {
    let Ok(picture) = picture_file::read(bytes) else { return false };
    fn mean(picture: &Image, channel: usize) -> f64 {
        let sum: f64 = picture.pixels().iter().map(|pixel| f64::from(pixel[channel])).sum();
        sum / picture.pixels().len().max(1) as f64
    }
    let [red, green, blue] = [0, 1, 2].map(|channel| mean(&picture, channel));
    blue > 180.0 && (red - 127.5).abs() < 40.0 && (green - 127.5).abs() < 40.0
}

fn is_bump(keyword: &str) -> bool {
    ["bump", "map_bump"].iter().any(|it| keyword.eq_ignore_ascii_case(it))
}

#[cfg(test)]
mod tests {
    use super::super::mtl::Options;
    use super::*;

    const MESH: &[u8] =
        b"mtllib my things/a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl skin\nf 1/1 2/1 3/1\n";

    /// Reads the materials of `mesh` with these files. Returns the names of the color pictures, the warnings and the requested files. An
    /// empty text represents a picture of one pixel.
    fn find_pictures(
        mesh: &[u8],
        files: &[(&str, &str)],
    ) -> (Option<String>, Vec<String>, Vec<String>) {
        let mut asked = Vec::new();
        let picture = Image::new(1, 1, vec![[9; 3]]).unwrap();
        let picture = crate::png::encode_rgb(&picture).unwrap();
        let [libraries, mut used] = names(mesh);
        used.dedup();
        let found = read_named(&libraries, &used, true, &mut |name| {
            asked.push(name.to_owned());
            let file = files.iter().find(|file| file.0 == name);
            let bytes = file.ok_or(format!("there is no file `{name}`"))?.1.as_bytes();
            Ok(if bytes.is_empty() { &picture[..] } else { bytes }.into())
        });
        let maps = found.materials.iter().filter_map(|it| it.maps.get(&MapKind::BaseColor));
        let names = maps.map(|map| map.file.clone()).collect::<Vec<_>>().join(", ");
        (Some(names).filter(|names| !names.is_empty()), found.warnings, asked)
    }

    #[test]
    fn a_picture_is_found_beside_its_material() {
        let material = "# of a scanner\nnewmtl other\nmap_Kd other.png\nnewmtl skin\nKd 1 1 1\nmap_Kd -s 1 1 1 -clamp on skin of all.jpg\n";
        let files = [("my things/a.mtl", material), ("my things/skin of all.jpg", "")];
        let (picture, warnings, asked) = find_pictures(MESH, &files);
        assert_eq!(picture.as_deref(), Some("skin of all.jpg"));
        assert_eq!(warnings, [""; 0]);
        assert_eq!(asked, ["my things/a.mtl", "my things/skin of all.jpg"]);
    }

    #[test]
    fn all_spellings_of_names_are_understood() {
        fn mesh(library: &str, material: &str) -> String {
            format!(
                "mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl {material}\nf 1/1 2/1 3/1\n"
            )
        }
        let skin = "newmtl skin\nmap_Kd scan#3.png\n";
        for (library, material, files) in [
            ("my größe #1.mtl", "skin", [("my größe #1.mtl", skin), ("scan#3.png", "")]),
            ("a.mtl # of a scanner", "skin # the first", [("a.mtl", skin), ("scan#3.png", "")]),
            ("none.mtl a.mtl", "skin", [("a.mtl", skin), ("none.mtl", "")]),
            (
                "\"my a.mtl\"",
                "skin",
                [("my a.mtl", "newmtl skin\nmap_kd \"scan#3.png\" # it\n"), ("scan#3.png", "")],
            ),
            ("a.mtl", "skin", [("a.mtl", "newmtl skin\nmap_Ka scan#3.png\n"), ("scan#3.png", "")]),
        ] {
            let files = [&files[..], &[("scan#3.png", "")]].concat();
            let (picture, warnings, _) = find_pictures(mesh(library, material).as_bytes(), &files);
            assert_eq!((picture.as_deref(), warnings), (Some("scan#3.png"), vec![]), "{library}");
        }
    }

    #[test]
    fn options_of_pictures_are_parsed() {
        fn parse_options(rest: &str) -> (String, [f64; 2], [f64; 2], Vec<String>) {
            let (name, Options { layout, lost, .. }) = options(rest);
            (name.to_owned(), layout.scale, layout.offset, lost)
        }
        let (_, bump) = options("-bm 0.5 -clamp on -imfchan g a.png");
        assert_eq!((bump.strength, bump.is_clamped, bump.channel), (0.5, true, Some(1)));
        fn plain(name: &str) -> (String, [f64; 2], [f64; 2], Vec<String>) {
            (name.to_owned(), [1.0; 2], [0.0; 2], Vec::<String>::new())
        }
        assert_eq!(parse_options("-clamp on my skin.png"), plain("my skin.png"));
        assert_eq!(
            parse_options("-o 0.5 0 0 -s -15 -15 -3.7 a.png"),
            ("a.png".into(), [-15.0; 2], [0.5, 0.0], vec![])
        );
        assert_eq!(parse_options("-s 2 a.png"), ("a.png".into(), [2.0, 1.0], [0.0; 2], vec![]));
        assert_eq!(parse_options("-mm 0 0.5 a.png").3, ["-mm 0 0.5"]);
        assert_eq!(parse_options("-s"), plain("-s"));
    }

    #[test]
    fn missing_files_give_warnings() {
        let (picture, warnings, _) = find_pictures(MESH, &[]);
        assert_eq!(picture, None);
        let text = "there is no file `my things/a.mtl`: the mesh comes without its materials";
        assert_eq!(warnings, [text]);
        let files = [("my things/a.mtl", "newmtl skin\nmap_Kd ..\\skin.png\n")];
        let text = "there is no file `my things/../skin.png`: the mesh comes without its picture";
        assert_eq!(find_pictures(MESH, &files).1, [text]);
    }

    #[test]
    fn each_material_keeps_its_statements() {
        let mesh = [MESH, b"usemtl bare\nf 1/1 3/1 2/1\n"].concat();
        let files = [
            (
                "my things/a.mtl",
                "newmtl bare\nKd 1 0 0\nd 0.5\nNs 250\nillum 2\nnewmtl skin\nKd 0.8 0.8 0.8\nmap_Kd b.png\nmap_d b.png\n\
                 map_ORM p.png\nnorm -bm 0.5 n.png\nmap_Ks s.png\n",
            ),
            ("my things/b.png", ""),
            ("my things/p.png", ""),
            ("my things/n.png", ""),
            ("my things/s.png", ""),
        ];
        assert_eq!(find_pictures(&mesh, &files).0.as_deref(), Some("b.png"));
        let [libraries, used] = names(&mesh);
        let picture = Image::new(1, 1, vec![[9; 3]]).unwrap();
        let picture = crate::png::encode_rgb(&picture).unwrap();
        let found = read_named(&libraries, &used, true, &mut |name| {
            let file = files.iter().find(|file| file.0 == name).unwrap();
            Ok(if file.1.is_empty() { &picture[..] } else { file.1.as_bytes() }.into())
        });
        assert_eq!(found.warnings, [""; 0]);
        let [skin, bare] = &found.materials[..] else { panic!("two materials") };
        assert_eq!((bare.base_color, bare.roughness), ([1.0, 0.0, 0.0, 0.5], 0.5));
        assert_eq!(bare.transparency, Transparency::Blend);
        assert_eq!(bare.others["illum"], "2");
        // The color beside a picture is kept only for writing MTL.
        assert_eq!((skin.base_color, &*skin.others["Kd"]), ([1.0; 4], "0.8 0.8 0.8"));
        assert_eq!(skin.transparency, Transparency::Blend);
        use MapKind::{Metallic, Occlusion, Roughness};
        let channels = [Occlusion, Roughness, Metallic].map(|kind| skin.maps[&kind].channel);
        assert_eq!(channels, [Some(0), Some(1), Some(2)]);
        assert_eq!(skin.maps[&MapKind::Normal].strength, 0.5);
        assert!(skin.maps.contains_key(&MapKind::Other("map_Ks".into())));
        assert_eq!(skin.maps.len(), 6);
    }

    #[test]
    fn a_mesh_without_materials_requests_no_file() {
        assert_eq!(find_pictures(b"v 0 0 0\n", &[]), (None, vec![], vec![]));
        let plain = [("my things/a.mtl", "newmtl skin\nKd 1 0 0\n")];
        assert_eq!(find_pictures(MESH, &plain).1, [""; 0]);
    }

    #[test]
    fn requested_files_are_those_that_are_read_each_once() {
        let again = b"usemtl bare\nf 1/1 3/1 2/1\nusemtl skin\nf 3/1 2/1 1/1\nusemtl gone\n";
        let mesh = [MESH, again].concat();
        let text = "newmtl bare\nmap_Kd b.png\nnorm n.png\nnewmtl skin\nmap_Kd s.png\nnewmtl unused\nmap_Kd u.png\n";
        let files = [
            ("my things/a.mtl", text),
            ("my things/b.png", ""),
            ("my things/n.png", ""),
            ("my things/s.png", ""),
        ];
        let (_, _, read) = find_pictures(&mesh, &files);
        let mut asked = Vec::new();
        request_files(&mesh, &mut |name| {
            asked.push(name.to_owned());
            let file = files.iter().find(|file| file.0 == name);
            file.map(|file| file.1.as_bytes().into()).ok_or_else(String::new)
        });
        assert_eq!(asked, read);
        let names = ["a.mtl", "s.png", "b.png", "n.png"].map(|name| format!("my things/{name}"));
        assert_eq!(asked, names);
    }

    #[test]
    fn a_missing_material_gives_a_warning() {
        let other = [("my things/a.mtl", "newmtl Skin\nmap_Kd b.png\n"), ("my things/b.png", "")];
        let text = "there is no material `skin` in `my things/a.mtl`";
        assert_eq!(
            find_pictures(MESH, &other),
            (None, vec![text.to_owned()], vec!["my things/a.mtl".to_owned()])
        );
    }
}
