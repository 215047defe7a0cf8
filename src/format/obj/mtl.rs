//! What is written in MTL files, and where they and their pictures are.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_value::MapKind;

use super::lines::for_lines;
use super::material::Find;
use crate::words;

/// How a picture lies on a mesh: texture coordinates are multiplied by the scale, and the offset is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layout {
    /// The option `-s` of u and v.
    pub(super) scale: [f64; 2],
    /// The option `-o` of u and v.
    pub(super) offset: [f64; 2],
}

impl Default for Layout {
    fn default() -> Self {
        Self { scale: [1.0; 2], offset: [0.0; 2] }
    }
}

impl Layout {
    pub(super) fn apply(&self, uv: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|k| uv[k] * self.scale[k] + self.offset[k])
    }
}

/// Options of a picture.
#[derive(Debug, PartialEq)]
pub(super) struct Options {
    pub(super) layout: Layout,
    pub(super) strength: f64,
    pub(super) is_clamped: bool,
    pub(super) channel: Option<usize>,
    /// Those that change the picture and are not known.
    pub(super) lost: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        let lost = Vec::new();
        Self { layout: Layout::default(), strength: 1.0, is_clamped: false, channel: None, lost }
    }
}

/// Whether a statement, in small letters, names a picture.
pub(super) fn is_picture(keyword: &str) -> bool {
    keyword.starts_with("map_") && keyword != "map_aat"
        || ["bump", "disp", "decal", "refl", "norm"].contains(&keyword)
}

/// What a text may name: the whole of it, without quotes, or what stands before a comment.
pub(super) fn spellings(text: &str) -> impl Iterator<Item = &str> {
    let before =
        text.char_indices().find(|(at, c)| *c == '#' && text[..*at].ends_with([' ', '\t']));
    let before = before.map(|(at, _)| text[..at].trim());
    [Some(text), before].into_iter().flatten().map(|name| {
        let name = name.trim();
        name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name)
    })
}

/// The first of some files that is there, after all of them were asked for; or why the first one cannot be had.
pub(super) fn find_first(
    names: impl Iterator<Item = PathBuf>,
    find: Find<'_>,
) -> Result<(String, Arc<[u8]>), String> {
    let names = names.map(|name| name.to_string_lossy().replace('\\', "/"));
    let found: Vec<_> = names.map(|name| find(&name).map(|bytes| (name, bytes))).collect();
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
pub(super) type Named = (String, Arc<[u8]>);

/// The files of materials that a line `mtllib` names: one, whose name may have blanks, or several.
pub(super) fn find_libraries(text: &str, find: Find<'_>) -> Result<Vec<Named>, String> {
    let one = find_first(spellings(text).map(PathBuf::from), find);
    let ends: Vec<_> = text
        .match_indices(' ')
        .filter(|(at, _)| {
            text[..*at].to_ascii_lowercase().ends_with(".mtl") && text[*at..].starts_with(' ')
        })
        .map(|(at, _)| at)
        .collect();
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

/// What a picture says, and the channel that counts if only one does.
pub(super) type Said = (MapKind, Option<u8>);

/// A material as its file has it.
pub(super) struct MtlMaterial {
    pub(super) name: String,
    /// The folder of the file of materials, relative to that of the OBJ file.
    pub(super) folder: PathBuf,
    /// First words of lines and what follows them.
    pub(super) statements: Vec<(String, String)>,
}

impl MtlMaterial {
    /// The statement with the picture of its color: that of ambient light only where it has no other.
    pub(super) fn base_color(&self) -> Option<&(String, String)> {
        let last = |wanted: &str| {
            let mut all = self.statements.iter().rev();
            all.find(|(keyword, _)| keyword.eq_ignore_ascii_case(wanted))
        };
        last("map_Kd").or(last("map_Ka"))
    }

    /// What its pictures say, with the channel that counts, and the rests of their statements; the picture of its color is the first one.
    pub(super) fn maps(&self) -> Vec<(Vec<Said>, &str)> {
        let base = self.base_color();
        let first = base.map(|(_, rest)| (vec![(MapKind::BaseColor, None)], &rest[..]));
        let others = self.statements.iter().filter(|it| base.is_none_or(|base| base != *it));
        let others = others.filter_map(|(keyword, rest)| {
            use MapKind::{Emissive, Metallic, Normal, Occlusion, Other, Roughness};
            let own = keyword.to_ascii_lowercase();
            let kinds = match &own[..] {
                "map_kd" => return None,
                "map_ke" | "map_emissive" => vec![(Emissive, None)],
                "map_pr" => vec![(Roughness, None)],
                "map_pm" => vec![(Metallic, None)],
                "map_ao" => vec![(Occlusion, None)],
                "norm" | "map_norm" | "map_kn" => vec![(Normal, None)],
                "map_orm" => vec![(Occlusion, Some(0)), (Roughness, Some(1)), (Metallic, Some(2))],
                "map_rma" => vec![(Roughness, Some(0)), (Metallic, Some(1)), (Occlusion, Some(2))],
                _ if is_picture(&own) => vec![(Other(keyword.clone()), None)],
                _ => return None,
            };
            Some((kinds, &rest[..]))
        });
        // A picture of normals by that name comes before a bump that may be one.
        let mut others = Vec::from_iter(others);
        others.sort_by_key(|(kinds, _)| matches!(kinds[0].0, MapKind::Other(_)));
        first.into_iter().chain(others).collect()
    }
}

/// The materials in the MTL file of this name.
pub(super) fn read_materials(bytes: &[u8], library: &str) -> Vec<MtlMaterial> {
    let mut materials: Vec<MtlMaterial> = Vec::new();
    let folder = Path::new(library).parent().unwrap_or(Path::new("")).to_owned();
    each_rest(bytes, |keyword, rest| {
        let keyword = String::from_utf8_lossy(keyword);
        if keyword.eq_ignore_ascii_case("newmtl") {
            let (name, folder) = (rest.to_owned(), folder.clone());
            materials.push(MtlMaterial { name, folder, statements: Vec::new() });
        } else if let Some(material) = materials.last_mut() {
            material.statements.push((keyword.into_owned(), rest.to_owned()));
        }
    });
    materials
}

/// What follows `mtllib` and `usemtl` in the lines of an OBJ file, each once.
pub(super) fn names(bytes: &[u8]) -> [Vec<String>; 2] {
    let mut found = [Vec::new(), Vec::new()];
    let mut known = HashSet::new();
    let read = |text: &[u8], _| {
        let text = text.trim_ascii_start();
        // Most lines of a mesh are vertices and faces.
        if !matches!(text.first(), Some(b'm' | b'u')) {
            return Ok(());
        }
        for (keyword, found) in [&b"mtllib"[..], b"usemtl"].into_iter().zip(&mut found) {
            if let Some(rest) = text.strip_prefix(keyword)
                && rest.first().is_some_and(u8::is_ascii_whitespace)
            {
                let name = String::from_utf8_lossy(rest).trim().to_owned();
                if known.insert((keyword, name.clone())) {
                    found.push(name);
                }
            }
        }
        Ok(())
    };
    for_lines(bytes, read).expect("no line is an error");
    found
}

/// The name of a picture behind its options, such as `-s 1 1 1` and `-clamp on`: a word, at least one word that is its value, and what is a number or `on`
/// or `off` behind that. How the picture lies, and options that would change it and are not known.
pub(super) fn options(mut rest: &str) -> (&str, Options) {
    let mut found = Options::default();
    fn is_value(word: &str) -> bool {
        word.parse::<f64>().is_ok() || matches!(word, "on" | "off")
    }
    fn cut(rest: &str) -> Option<(String, usize)> {
        rest.split_once(char::is_whitespace).map(|(word, rest)| (word.to_owned(), rest.len()))
    }
    fn set(to: &mut [f64; 2], numbers: &mut dyn Iterator<Item = f64>) {
        to.iter_mut().zip(numbers).for_each(|(to, number)| *to = number);
    }
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
        let numbers: Vec<_> = values.iter().filter_map(|word| word.parse::<f64>().ok()).collect();
        let mut numbers = numbers.into_iter().filter(|number| number.is_finite()).take(2);
        match &*option {
            "-s" => set(&mut found.layout.scale, &mut numbers),
            "-o" => set(&mut found.layout.offset, &mut numbers),
            "-bm" => found.strength = numbers.next().unwrap_or(1.0),
            "-clamp" => found.is_clamped = values[0] == "on",
            "-imfchan" => found.channel = ["r", "g", "b"].iter().position(|it| *it == values[0]),
            // How pixels are blended.
            "-blendu" | "-blendv" | "-boost" | "-cc" | "-texres" | "-type" => {}
            _ => found.lost.push(format!("{option} {}", values.join(" "))),
        }
    }
    (rest, found)
}

/// Calls `each` with the first word of every line, and with what follows it: names may have blanks.
fn each_rest(bytes: &[u8], mut each: impl FnMut(&[u8], &str)) {
    for_lines(bytes, |text, _| {
        let text = text.trim_ascii();
        if let Some(keyword) = words(text).next().filter(|keyword| !keyword.starts_with(b"#")) {
            each(keyword, String::from_utf8_lossy(&text[keyword.len()..]).trim());
        }
        Ok(())
    })
    .expect("no line is an error");
}
