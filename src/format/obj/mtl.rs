//! Parses MTL files, and finds them and their pictures.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use maquette_value::MapKind;

use super::lines::for_lines;
use super::material::FindFile;
use crate::words;

/// The placement of a picture on a mesh: texture coordinates are multiplied by `scale`, and `offset` is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layout {
    /// The option `-s`, for u and v.
    pub(super) scale: [f64; 2],
    /// The option `-o`, for u and v.
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
    /// Options that are not supported but may change the picture.
    pub(super) lost: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        let lost = Vec::new();
        Self { layout: Layout::default(), strength: 1.0, is_clamped: false, channel: None, lost }
    }
}

/// Returns true if `keyword`, in lower case, introduces a picture.
pub(super) fn is_picture(keyword: &str) -> bool {
    keyword.starts_with("map_") && keyword != "map_aat"
        || ["bump", "disp", "decal", "refl", "norm"].contains(&keyword)
}

/// Returns the file names that a text may mean: the entire text, the text without quotes, or the part before a comment.
pub(super) fn spellings(text: &str) -> impl Iterator<Item = &str> {
    let before =
        text.char_indices().find(|(at, c)| *c == '#' && text[..*at].ends_with([' ', '\t']));
    let before = before.map(|(at, _)| text[..at].trim());
    [Some(text), before].into_iter().flatten().map(|name| {
        let name = name.trim();
        name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name)
    })
}

/// Requests all of the given files. Returns the first one that exists, or else the error for the first one.
pub(super) fn find_first(
    names: impl Iterator<Item = PathBuf>,
    find: FindFile<'_>,
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

/// The path by which a file was found, and its content.
pub(super) type NamedFile = (String, Arc<[u8]>);

/// Finds the files of a line `mtllib`. The line names either one file, whose name may contain blanks, or several.
pub(super) fn find_libraries(text: &str, find: FindFile<'_>) -> Result<Vec<NamedFile>, String> {
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
    let several: Vec<_> = several.collect();
    match one {
        Ok(file) => Ok(vec![file]),
        Err(_) => several.into_iter().collect(),
    }
}

/// The kind of a map, and the channel of the picture if the map uses only one.
pub(super) type MapUse = (MapKind, Option<u8>);

/// A material in an MTL file.
pub(super) struct MtlMaterial {
    pub(super) name: String,
    /// The folder of the MTL file, relative to the folder of the OBJ file.
    pub(super) folder: PathBuf,
    /// The statements as pairs: the keyword and the rest of the line.
    pub(super) statements: Vec<(String, String)>,
}

impl MtlMaterial {
    /// Returns the statement with the color picture; if there is none, the statement with the picture of ambient light.
    pub(super) fn base_color(&self) -> Option<&(String, String)> {
        self.last_statement("map_Kd").or_else(|| self.last_statement("map_Ka"))
    }

    fn last_statement(&self, keyword: &str) -> Option<&(String, String)> {
        self.statements.iter().rfind(|(known, _)| known.eq_ignore_ascii_case(keyword))
    }

    /// Returns the maps of all picture statements, each with the rest of its statement. The color picture comes first.
    pub(super) fn maps(&self) -> Vec<(Vec<MapUse>, &str)> {
        let base = self.base_color();
        let first = base.map(|(_, rest)| (vec![(MapKind::BaseColor, None)], &rest[..]));
        let others = self.statements.iter().filter(|it| base.is_none_or(|base| base != *it));
        let others = others.filter_map(|(keyword, rest)| {
            use MapKind::{Emissive, Metallic, Normal, Occlusion, Other, Roughness};
            let lower = keyword.to_ascii_lowercase();
            let kinds = match &lower[..] {
                "map_kd" => return None,
                "map_ke" | "map_emissive" => vec![(Emissive, None)],
                "map_pr" => vec![(Roughness, None)],
                "map_pm" => vec![(Metallic, None)],
                "map_ao" => vec![(Occlusion, None)],
                "norm" | "map_norm" | "map_kn" => vec![(Normal, None)],
                "map_orm" => vec![(Occlusion, Some(0)), (Roughness, Some(1)), (Metallic, Some(2))],
                "map_rma" => vec![(Roughness, Some(0)), (Metallic, Some(1)), (Occlusion, Some(2))],
                _ if is_picture(&lower) => vec![(Other(keyword.clone()), None)],
                _ => return None,
            };
            Some((kinds, &rest[..]))
        });
        // A normal map must come before a bump map, because the bump map may be a normal map, too.
        let mut others: Vec<_> = others.collect();
        others.sort_by_key(|(kinds, _)| matches!(kinds[0].0, MapKind::Other(_)));
        first.into_iter().chain(others).collect()
    }
}

/// Reads the materials of the MTL file `library`.
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

/// Returns the arguments of `mtllib` and the arguments of `usemtl` in an OBJ file, each argument once.
pub(super) fn names(bytes: &[u8]) -> [Vec<String>; 2] {
    let mut found = [Vec::new(), Vec::new()];
    let mut known = HashSet::new();
    for_lines(bytes, |text, _| {
        let text = text.trim_ascii_start();
        // Most lines of a mesh are vertices and faces; testing the first letter skips them quickly.
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
    })
    .expect("no line is an error");
    found
}

/// Splits the text after a map keyword into the options, such as `-s 1 1 1` and `-clamp on`, and the name of the picture. An option takes
/// one word, and further words as long as they are numbers, `on` or `off`.
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
        let mut remaining = rest[rest.len() - left..].trim_start();
        let mut values = Vec::new();
        while let Some((word, left)) =
            cut(remaining).filter(|(word, _)| values.is_empty() || is_value(word))
        {
            values.push(word);
            remaining = remaining[remaining.len() - left..].trim_start();
        }
        if values.is_empty() {
            break;
        }
        rest = remaining;
        let numbers: Vec<_> = values.iter().filter_map(|word| word.parse::<f64>().ok()).collect();
        let mut numbers = numbers.into_iter().filter(|number| number.is_finite()).take(2);
        match &*option {
            "-s" => set(&mut found.layout.scale, &mut numbers),
            "-o" => set(&mut found.layout.offset, &mut numbers),
            "-bm" => found.strength = numbers.next().unwrap_or(1.0),
            "-clamp" => found.is_clamped = values[0] == "on",
            "-imfchan" => found.channel = ["r", "g", "b"].iter().position(|it| *it == values[0]),
            // The options in this list concern filtering and blending, and are ignored.
            "-blendu" | "-blendv" | "-boost" | "-cc" | "-texres" | "-type" => {}
            _ => found.lost.push(format!("{option} {}", values.join(" "))),
        }
    }
    (rest, found)
}

/// Calls `each` for every line with its keyword and the rest of the line. The rest may contain blanks.
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
