//! What an OBJ file says of pictures: it names files of materials (MTL), which name pictures.
//!
//! A mesh has one picture, so that of the first material with one is taken. Names are relative to the file that they stand in.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::for_lines;
use crate::words;

/// Gives the content of a file by its name, relative to the folder of the OBJ file, or says why it cannot be had.
pub type Find<'a> = &'a mut dyn FnMut(&str) -> Result<Arc<[u8]>, String>;

/// The picture that belongs on the mesh of an OBJ file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Its name, relative to the folder of the OBJ file, and its content: a picture file, or something else.
    pub file: Option<(String, Arc<[u8]>)>,
    /// How it lies on the mesh.
    pub layout: Layout,
    /// What the user should know, in sentences: files that cannot be had, and materials that are left out.
    pub doubts: Vec<String>,
}

/// How a picture lies on a mesh: texture coordinates are multiplied by the scale, and the offset is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// The option `-s` of u and v.
    pub scale: [f64; 2],
    /// The option `-o` of u and v.
    pub offset: [f64; 2],
}

impl Default for Layout {
    fn default() -> Self {
        Self { scale: [1.0; 2], offset: [0.0; 2] }
    }
}

/// The picture on the mesh of an OBJ file: `map_Kd` of the first material in use that has one, or `map_Ka` where it has no other. What is asked of
/// `find` depends on the contents of the files alone.
pub fn picture(bytes: &[u8], find: Find<'_>) -> Picture {
    let mut found = Picture::default();
    let [libraries, used] = rests(bytes, ["mtllib", "usemtl"]);
    let mut materials = Vec::new();
    for library in &libraries {
        match find_libraries(library, find) {
            Ok(files) => {
                materials
                    .extend(files.iter().flat_map(|(name, bytes)| read_materials(bytes, name)));
            }
            Err(why) => found.doubts.push(format!("{why}: the mesh comes without its materials")),
        }
    }
    // A name may have a `#`, and a comment may follow it.
    let is_of = |text: &str, name: &str| spellings(text).any(|spelling| spelling == name);
    let is_known = |name: &&String| materials.iter().any(|one| is_of(name, &one.name));
    let unknown = used.iter().find(|name| !is_known(name));
    let unknown = unknown.filter(|_| !libraries.is_empty() && found.doubts.is_empty());
    if !used.is_empty() {
        let place = |material: &Material| used.iter().position(|name| is_of(name, &material.name));
        materials.retain(|material| place(material).is_some());
        materials.sort_by_key(place);
    }
    let mut pictures = Vec::from_iter(materials.iter().filter_map(|one| one.picture.as_ref()));
    pictures.dedup();
    let Some(&first) = pictures.first() else {
        found.doubts.extend(unknown.map(|name| {
            let files = Vec::from_iter(libraries.iter().map(|library| format!("`{library}`")));
            let files = files.join(", ");
            format!("there is no material `{name}` in {files}: the mesh comes without its picture")
        }));
        return found;
    };
    if materials.iter().any(|material| material.picture.as_ref() != Some(first)) {
        found.doubts.push(format!(
            "the mesh has {} materials, but shows one picture, `{}`, also where another one or none belongs",
            materials.len(),
            first.folder.join(&first.name).display()
        ));
    }
    match find_first(spellings(&first.name).map(|name| first.folder.join(name)), find) {
        Ok(file) => found.file = Some(file),
        Err(why) => found.doubts.push(format!("{why}: the mesh comes without its picture")),
    }
    found.layout = first.layout;
    found.doubts.extend(first.lost.iter().map(|option| {
        format!("the option `{option}` of the picture `{}` is left out", first.name)
    }));
    found
}

/// What a text may name: the whole of it, without quotes, or what stands before a comment.
fn spellings(text: &str) -> impl Iterator<Item = &str> {
    let before =
        text.char_indices().find(|(at, c)| *c == '#' && text[..*at].ends_with([' ', '\t']));
    let before = before.map(|(at, _)| text[..at].trim());
    [Some(text), before].into_iter().flatten().map(|name| {
        let name = name.trim();
        name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name)
    })
}

/// The first of some files that is there, after all of them were asked for; or why the first one cannot be had.
fn find_first(
    names: impl Iterator<Item = PathBuf>,
    find: Find<'_>,
) -> Result<(String, Arc<[u8]>), String> {
    let names = names.map(|name| name.to_string_lossy().replace('\\', "/"));
    let found = Vec::from_iter(names.map(|name| find(&name).map(|bytes| (name, bytes))));
    let mut whys = Vec::new();
    for found in found {
        match found {
            Ok(file) => return Ok(file),
            Err(why) => whys.push(why),
        }
    }
    Err(whys.into_iter().next().unwrap_or_default())
}

/// A file, and the name by which it was found.
type Named = (String, Arc<[u8]>);

/// The files of materials that a line `mtllib` names: one, whose name may have blanks, or several.
fn find_libraries(text: &str, find: Find<'_>) -> Result<Vec<Named>, String> {
    let one = find_first(spellings(text).map(PathBuf::from), find);
    let is_end = |(at, _): &(usize, &str)| {
        text[..*at].to_ascii_lowercase().ends_with(".mtl") && text[*at..].starts_with(' ')
    };
    let ends = Vec::from_iter(text.match_indices(' ').filter(is_end).map(|(at, _)| at));
    if ends.is_empty() {
        return one.map(|file| vec![file]);
    }
    let starts = [0].into_iter().chain(ends.iter().copied());
    let parts = starts.zip(ends.iter().copied().chain([text.len()]));
    let several = parts.map(|(start, end)| {
        find_first(spellings(text[start..end].trim()).map(PathBuf::from), find)
    });
    let several = Vec::from_iter(several);
    match one {
        Ok(file) => Ok(vec![file]),
        Err(_) => several.into_iter().collect(),
    }
}

/// A material and its picture.
struct Material {
    name: String,
    picture: Option<Map>,
}

/// A picture that a material names.
#[derive(Clone, PartialEq)]
struct Map {
    /// The folder of the file of materials, relative to that of the OBJ file.
    folder: PathBuf,
    /// Its name, relative to that folder, and perhaps a comment.
    name: String,
    layout: Layout,
    /// Options that change the picture and are not known.
    lost: Vec<String>,
    /// Of ambient light: only where the material has no other.
    is_ambient: bool,
}

/// The materials in the MTL file of this name.
fn read_materials(bytes: &[u8], library: &str) -> Vec<Material> {
    let mut materials: Vec<Material> = Vec::new();
    let folder = Path::new(library).parent().unwrap_or(Path::new(""));
    each_rest(bytes, |keyword, rest| {
        let is = |word: &[u8]| keyword.eq_ignore_ascii_case(word);
        if is(b"newmtl") {
            materials.push(Material { name: rest.to_owned(), picture: None });
        }
        let is_ambient = is(b"map_Ka");
        let Some(material) = materials.last_mut().filter(|_| is_ambient || is(b"map_Kd")) else {
            return;
        };
        if !is_ambient || material.picture.as_ref().is_none_or(|picture| picture.is_ambient) {
            let (name, layout, lost) = options(rest);
            let name = name.replace('\\', "/");
            let folder = folder.to_owned();
            material.picture = Some(Map { folder, name, layout, lost, is_ambient });
        }
    });
    materials
}

/// The name of a picture behind its options, such as `-s 1 1 1` and `-clamp on`: a word, at least one word that is its value, and what is a number or `on`
/// or `off` behind that. How the picture lies, and options that would change it and are not known.
fn options(mut rest: &str) -> (&str, Layout, Vec<String>) {
    let (mut layout, mut lost) = (Layout::default(), Vec::new());
    let is_value = |word: &str| word.parse::<f64>().is_ok() || matches!(word, "on" | "off");
    let cut = |rest: &str| {
        rest.split_once(char::is_whitespace).map(|(word, rest)| (word.to_owned(), rest.len()))
    };
    while rest.starts_with('-') {
        let Some((option, left)) = cut(rest) else { break };
        let mut behind = rest[rest.len() - left..].trim_start();
        let mut values = Vec::new();
        while let Some((word, left)) =
            cut(behind).filter(|(word, _)| values.is_empty() || is_value(word))
        {
            values.push(word);
            behind = behind[behind.len() - left..].trim_start();
        }
        if values.is_empty() {
            break;
        }
        rest = behind;
        let numbers = Vec::from_iter(values.iter().filter_map(|word| word.parse::<f64>().ok()));
        let numbers = numbers.into_iter().filter(|number| number.is_finite()).take(2);
        match &*option {
            "-s" => layout.scale.iter_mut().zip(numbers).for_each(|(to, number)| *to = number),
            "-o" => layout.offset.iter_mut().zip(numbers).for_each(|(to, number)| *to = number),
            // How pixels are blended, and where the picture ends.
            "-blendu" | "-blendv" | "-boost" | "-bm" | "-cc" | "-clamp" | "-imfchan"
            | "-texres" | "-type" => {}
            _ => lost.push(format!("{option} {}", values.join(" "))),
        }
    }
    (rest, layout, lost)
}

/// What follows these keywords in the lines of a text.
fn rests<const N: usize>(bytes: &[u8], keywords: [&str; N]) -> [Vec<String>; N] {
    let mut found = keywords.map(|_| Vec::new());
    each_rest(bytes, |keyword, rest| {
        if let Some(k) = keywords.iter().position(|known| known.as_bytes() == keyword) {
            found[k].push(rest.to_owned());
        }
    });
    found
}

/// Calls `each` with the first word of every line that may name a material, and with what follows it: names may have blanks.
fn each_rest(bytes: &[u8], mut each: impl FnMut(&[u8], &str)) {
    let read = |text: &[u8], _| {
        let text = text.trim_ascii();
        // Most lines of a mesh are vertices and faces.
        if matches!(text.first(), Some(b'm' | b'u' | b'n' | b'M' | b'N'))
            && let Some(keyword) = words(text).next()
        {
            each(keyword, String::from_utf8_lossy(&text[keyword.len()..]).trim());
        }
        Ok(())
    };
    for_lines(bytes, read).expect("no line is an error");
}

#[cfg(test)]
mod tests {
    use super::*;

    const MESH: &[u8] =
        b"mtllib my things/a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl skin\nf 1/1 2/1 3/1\n";

    /// What is found with these files, and which were asked for.
    fn found(mesh: &[u8], files: &[(&str, &str)]) -> (Option<String>, Vec<String>, Vec<String>) {
        let mut asked = Vec::new();
        let found = picture(mesh, &mut |name| {
            asked.push(name.to_owned());
            let file = files.iter().find(|file| file.0 == name);
            file.map(|file| file.1.as_bytes().into()).ok_or(format!("there is no file `{name}`"))
        });
        (found.file.map(|file| file.0), found.doubts, asked)
    }

    #[test]
    fn a_picture_is_found_beside_its_material() {
        let material = "# of a scanner\nnewmtl other\nmap_Kd other.png\nnewmtl skin\nKd 1 1 1\nmap_Kd -s 1 1 1 -clamp on skin of all.jpg\n";
        let files = [("my things/a.mtl", material), ("my things/skin of all.jpg", "")];
        let (picture, doubts, asked) = found(MESH, &files);
        assert_eq!(picture.as_deref(), Some("my things/skin of all.jpg"));
        assert_eq!(doubts, [""; 0]);
        assert_eq!(asked, ["my things/a.mtl", "my things/skin of all.jpg"]);
    }

    #[test]
    fn names_are_understood_however_they_are_written() {
        let mesh = |library: &str, material: &str| {
            format!(
                "mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl {material}\nf 1/1 2/1 3/1\n"
            )
        };
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
            let (picture, doubts, _) = found(mesh(library, material).as_bytes(), &files);
            assert_eq!((picture.as_deref(), doubts), (Some("scan#3.png"), vec![]), "{library}");
        }
    }

    #[test]
    fn options_say_how_a_picture_lies() {
        let told = |rest: &str| {
            let (name, layout, lost) = options(rest);
            (name.to_owned(), layout.scale, layout.offset, lost)
        };
        let plain = |name: &str| (name.to_owned(), [1.0; 2], [0.0; 2], Vec::<String>::new());
        assert_eq!(told("-clamp on my skin.png"), plain("my skin.png"));
        assert_eq!(
            told("-o 0.5 0 0 -s -15 -15 -3.7 a.png"),
            ("a.png".into(), [-15.0; 2], [0.5, 0.0], vec![])
        );
        assert_eq!(told("-s 2 a.png"), ("a.png".into(), [2.0, 1.0], [0.0; 2], vec![]));
        assert_eq!(told("-mm 0 0.5 a.png").3, ["-mm 0 0.5"]);
        assert_eq!(told("-s"), plain("-s"));
    }

    #[test]
    fn what_is_missing_is_named() {
        let (picture, doubts, _) = found(MESH, &[]);
        assert_eq!(picture, None);
        let text = "there is no file `my things/a.mtl`: the mesh comes without its materials";
        assert_eq!(doubts, [text]);
        let files = [("my things/a.mtl", "newmtl skin\nmap_Kd ..\\skin.png\n")];
        let text = "there is no file `my things/../skin.png`: the mesh comes without its picture";
        assert_eq!(found(MESH, &files).1, [text]);
    }

    #[test]
    fn of_several_materials_the_first_picture_is_shown_and_the_user_told() {
        let mesh = [MESH, b"usemtl bare\nf 1/1 3/1 2/1\n"].concat();
        let files = [
            ("my things/a.mtl", "newmtl bare\nnewmtl skin\nmap_Kd b.png\n"),
            ("my things/b.png", ""),
        ];
        let (picture, doubts, _) = found(&mesh, &files);
        assert_eq!(picture.as_deref(), Some("my things/b.png"));
        let text = "the mesh has 2 materials, but shows one picture, `my things/b.png`, also where another one or none belongs";
        assert_eq!(doubts, [text]);
    }

    #[test]
    fn a_mesh_without_materials_asks_for_no_file() {
        assert_eq!(found(b"v 0 0 0\n", &[]), (None, vec![], vec![]));
        let plain = [("my things/a.mtl", "newmtl skin\nKd 1 0 0\n")];
        assert_eq!(found(MESH, &plain).1, [""; 0]);
    }

    #[test]
    fn a_material_that_no_file_has_is_told() {
        let other = [("my things/a.mtl", "newmtl Skin\nmap_Kd b.png\n"), ("my things/b.png", "")];
        let text =
            "there is no material `skin` in `my things/a.mtl`: the mesh comes without its picture";
        assert_eq!(
            found(MESH, &other),
            (None, vec![text.to_owned()], vec!["my things/a.mtl".to_owned()])
        );
    }
}
