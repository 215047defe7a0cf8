//! What an OBJ file says of pictures: it names files of materials (MTL), which name pictures.
//!
//! A mesh has one picture, so that of the first material with one is taken. Names are relative to the file that they stand in.

use std::path::Path;
use std::sync::Arc;

use super::for_lines;
use crate::words;

/// Gives the content of a file by its name, relative to the folder of the OBJ file, or says why it cannot be had.
pub type Find<'a> = &'a mut dyn FnMut(&str) -> Result<Arc<[u8]>, String>;

/// The picture that belongs on the mesh of an OBJ file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// Its name, relative to the folder of the OBJ file, and its content: a picture file, or something else.
    pub file: Option<(String, Arc<[u8]>)>,
    /// What the user should know, in sentences: files that cannot be had, and materials that are left out.
    pub doubts: Vec<String>,
}

/// The picture on the mesh of an OBJ file: `map_Kd` of the first material in use that has one. What is asked of `find` depends on
/// the contents of the files alone.
pub fn picture(bytes: &[u8], find: Find<'_>) -> Picture {
    let mut found = Picture::default();
    let [libraries, used] = rests(bytes, ["mtllib", "usemtl"]);
    let mut materials = Vec::new();
    for library in &libraries {
        let library = library.replace('\\', "/");
        match find(&library) {
            Ok(bytes) => materials.extend(read_materials(&bytes, &library)),
            Err(why) => found.doubts.push(format!("{why}: the mesh comes without its materials")),
        }
    }
    let is_known = |name: &&String| materials.iter().any(|material| material.name == **name);
    let unknown = used.iter().find(|name| !is_known(name));
    let unknown = unknown.filter(|_| !libraries.is_empty() && found.doubts.is_empty());
    if !used.is_empty() {
        let place = |material: &Material| used.iter().position(|name| *name == material.name);
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
            "the mesh has {} materials, but shows one picture, `{first}`, also where another one or none belongs",
            materials.len()
        ));
    }
    match find(first) {
        Ok(bytes) => found.file = Some((first.clone(), bytes)),
        Err(why) => found.doubts.push(format!("{why}: the mesh comes without its picture")),
    }
    found
}

/// A material and its picture, by a name relative to the folder of the OBJ file.
struct Material {
    name: String,
    picture: Option<String>,
}

/// The materials in the MTL file of this name.
fn read_materials(bytes: &[u8], library: &str) -> Vec<Material> {
    let mut materials: Vec<Material> = Vec::new();
    let folder = Path::new(library).parent().unwrap_or(Path::new(""));
    each_rest(bytes, |keyword, rest| match (keyword, materials.last_mut()) {
        (b"newmtl", _) => materials.push(Material { name: rest.to_owned(), picture: None }),
        (b"map_Kd", Some(material)) => {
            let name = without_options(rest).replace('\\', "/");
            material.picture = Some(folder.join(name).to_string_lossy().into_owned());
        }
        _ => {}
    });
    materials
}

/// The name of a picture without the options before it, such as `-s 1 1 1` and `-clamp on`: a word and what is a number or `on` or
/// `off` behind it, at least one word.
fn without_options(mut rest: &str) -> &str {
    let next = |rest: &str| rest.split_once(char::is_whitespace).map(|(_, rest)| rest.len());
    while rest.starts_with('-') {
        let is_value = |word: &str| word.parse::<f64>().is_ok() || matches!(word, "on" | "off");
        let mut first = true;
        loop {
            let Some(left) = next(rest) else { return rest };
            rest = rest[rest.len() - left..].trim_start();
            let word = rest.split(char::is_whitespace).next().unwrap_or_default();
            if !first && !is_value(word) {
                break;
            }
            // What follows the option itself is its value, whatever it is.
            first = false;
        }
    }
    rest
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
        if matches!(text.first(), Some(b'm' | b'u' | b'n'))
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
