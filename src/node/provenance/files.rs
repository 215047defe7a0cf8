//! Adds provenance to the bytes of files in well-known formats after they were written, so that the writers need not do it.

use std::borrow::Cow;

use serde_json::{Value as Json, json};

use super::Signature;

/// The name before the provenance in comments of files, and the key of the provenance in JSON documents.
const KEY: &str = "maquette";

/// The text in the header of an STL file before the hash of the provenance.
const STL: &str = "binary STL of maquette, mm, ";

/// Provenance that was found in a file.
#[derive(Debug, PartialEq)]
#[doc(hidden)]
pub enum EmbeddedProvenance {
    /// The complete provenance, as one line of JSON.
    Words(String),
    /// The hash of the provenance, from a format with little space.
    Hash(String),
}

/// Adds the provenance to the bytes of a file with the extension `ending`, or only the hash of the provenance if the format has little
/// space. Files of other formats are not changed: PTX has a fixed structure of lines, and other programs misread or reject comments in XYZ
/// files.
#[doc(hidden)]
pub fn sign(ending: &str, bytes: &mut Vec<u8>, Signature { words, hash }: &Signature) {
    let signed = match ending {
        "glb" => glb(bytes, words),
        "png" => png(bytes, words),
        "json" => json_text(bytes, words),
        "ply" => ply(bytes, words),
        "pcd" => line_behind(bytes, b"# .PCD", &format!("# {KEY} {words}\n")),
        "step" => {
            line_behind(bytes, b"ISO-10303-21;\nHEADER;\n", &format!("/* {KEY} {words} */\n"))
        }
        "obj" | "mtl" => Some((0, 0, comment_of_obj(words).into_bytes())),
        "stl" => stl(bytes, hash),
        "3mf" => zip(bytes, words),
        "tiff" => tiff(bytes, words),
        _ => None,
    };
    if let Some((at, replaced, new)) = signed {
        bytes.splice(at..at + replaced, new);
        if ending == "glb" {
            let length = (bytes.len() as u32).to_le_bytes();
            bytes[8..12].copy_from_slice(&length);
        }
    }
}

/// Returns the provenance as comment lines of a PLY file. The comments must follow the `format` line, because Open3D, assimp and
/// CloudCompare reject files with a comment before that line.
#[doc(hidden)]
pub fn comment_of_ply(words: &str) -> String {
    let mut lines = Vec::new();
    let mut rest = words;
    while !rest.is_empty() {
        let (line, behind) = rest.split_at(end_of_line(rest));
        lines.push(format!("{COMMENT}{line}"));
        rest = behind;
    }
    pad(lines.join("\n")) + "\n"
}

/// The beginning of each comment line that [`comment_of_ply`] writes.
const COMMENT: &str = "comment maquette ";

/// Maximum length in bytes of a line of `comment_of_ply`, not including up to 63 spaces at the end of the last line. Open3D and
/// CloudCompare read PLY files with rply, which rejects lines of more than 1024 bytes.
const MAX_COMMENT: usize = 192;

/// Returns the number of bytes at the start of the ASCII text `text` that fit on one comment line of a PLY file. A line must not begin or
/// end with a space, because other programs may remove spaces there.
fn end_of_line(text: &str) -> usize {
    let max = MAX_COMMENT - COMMENT.len();
    if text.len() <= max {
        return text.len();
    }
    fn is_blank(at: usize, text: &str) -> bool {
        text.as_bytes()[at] == b' '
    }
    (1..=max).rev().find(|&end| !is_blank(end - 1, text) && !is_blank(end, text)).unwrap_or(max)
}

/// Returns the provenance as the first line of an OBJ or MTL file.
#[doc(hidden)]
pub fn comment_of_obj(words: &str) -> String {
    format!("# {KEY} {words}\n")
}

/// Pads a text with spaces to a multiple of 64 bytes. If a number in the text becomes slightly longer, the padded length stays the same.
/// The rest of the file then does not move and need not be written again.
#[doc(hidden)]
pub fn pad(mut text: String) -> String {
    let spaces = text.len().next_multiple_of(64) - text.len();
    text.extend(std::iter::repeat_n(' ', spaces));
    text
}

/// Returns the provenance as the value of `asset.extras` in a GLB file.
#[doc(hidden)]
pub fn extras_of_glb(words: &str) -> Option<Json> {
    let provenance: Json = serde_json::from_str(words).ok()?;
    Some(json!({ KEY: provenance }))
}

/// Finds the provenance in the bytes of a file with the extension `ending`. `None` if the file contains none.
#[doc(hidden)]
pub fn find(ending: &str, bytes: &[u8]) -> Option<EmbeddedProvenance> {
    fn words(text: &str) -> Option<EmbeddedProvenance> {
        Some(EmbeddedProvenance::Words(text.to_owned()))
    }
    match ending {
        "glb" => {
            let document = glb_document(bytes)?;
            words(&document["asset"]["extras"].get(KEY)?.to_string())
        }
        "png" => {
            let text = chunks(bytes).find_map(|(kind, content)| {
                let content = content.strip_prefix(KEY.as_bytes())?.strip_prefix(&[0])?;
                (kind == b"tEXt").then(|| str::from_utf8(content).ok())?
            });
            words(text?)
        }
        "tiff" | "tif" => {
            let (_, entries) = directory(bytes)?;
            let entry = entries.iter().find(|entry| entry.starts_with(&DESCRIPTION))?;
            let [count, at] = [4, 8].map(|at| number(&entry[at..]));
            let text = bytes.get(at? as usize..)?.get(..(count? as usize).checked_sub(1)?)?;
            words(str::from_utf8(text).ok()?.strip_prefix(KEY)?.trim())
        }
        "json" => {
            let document: Json = serde_json::from_slice(bytes).ok()?;
            words(&document.get(KEY)?.to_string())
        }
        "3mf" => {
            let place = bytes.windows(NOTE.len()).position(|name| name == NOTE)?;
            let length = number(bytes.get(place.checked_sub(8)?..)?)? as usize;
            words(str::from_utf8(bytes.get(place + NOTE.len()..)?.get(..length)?).ok()?)
        }
        "stl" => {
            let header = str::from_utf8(bytes.get(..80)?).ok()?;
            Some(EmbeddedProvenance::Hash(header.strip_prefix(STL)?.trim().to_owned()))
        }
        "ply" => {
            let head = head(bytes);
            let lines = head.lines().map(|line| line.strip_prefix(COMMENT));
            let lines = lines.skip_while(|text| !text.is_some_and(|text| text.starts_with('{')));
            let text: String = lines.map_while(|text| text).collect();
            (!text.is_empty()).then(|| EmbeddedProvenance::Words(text.trim_end().to_owned()))
        }
        "pcd" | "step" | "obj" | "mtl" => {
            let head = head(bytes);
            let marks = [format!("# {KEY} {{"), format!("/* {KEY} {{")];
            let line = head.lines().find_map(|line| {
                let mark = marks.iter().find(|mark| line.starts_with(&mark[..]))?;
                Some(line[mark.len() - 1..].trim_end_matches(" */").to_owned())
            });
            words(&line?)
        }
        _ => None,
    }
}

/// Returns the first 64 KiB of a file as text. All headers are shorter; the data after a header may be arbitrary bytes.
fn head(bytes: &[u8]) -> Cow<'_, str> {
    String::from_utf8_lossy(&bytes[..bytes.len().min(1 << 16)])
}

/// An edit of the bytes of a file: an offset, the number of bytes to replace, and the new bytes.
type Splice = (usize, usize, Vec<u8>);

/// Inserts a line after the first line of a file. `None` if the file does not begin with `start`.
fn line_behind(bytes: &[u8], start: &[u8], line: &str) -> Option<Splice> {
    if !bytes.starts_with(start) {
        return None;
    }
    let at = match start.ends_with(b"\n") {
        true => start.len(),
        false => bytes.iter().position(|byte| *byte == b'\n')? + 1,
    };
    Some((at, 0, line.as_bytes().to_vec()))
}

fn ply(bytes: &[u8], words: &str) -> Option<Splice> {
    if !bytes.starts_with(b"ply\n") {
        return None;
    }
    let mut end = 0;
    for line in bytes.split_inclusive(|&byte| byte == b'\n') {
        end += line.len();
        if line.starts_with(b"format ") {
            return Some((end, 0, comment_of_ply(words).into_bytes()));
        }
        if line == b"end_header\n" {
            return None;
        }
    }
    None
}

fn glb_document(bytes: &[u8]) -> Option<Json> {
    let length = u32::from_le_bytes(*bytes.get(12..)?.first_chunk()?) as usize;
    let is_document = bytes.starts_with(b"glTF") && bytes.get(16..20)? == b"JSON";
    serde_json::from_slice(bytes.get(20..20 + length)?).ok().filter(|_| is_document)
}

/// Adds the provenance to a GLB file: replaces the first chunk by one with `asset.extras`.
fn glb(bytes: &[u8], words: &str) -> Option<Splice> {
    let mut document = glb_document(bytes)?;
    let before = u32::from_le_bytes(*bytes.get(12..)?.first_chunk()?) as usize;
    document.get_mut("asset")?["extras"] = extras_of_glb(words)?;
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut chunk = (text.len() as u32).to_le_bytes().to_vec();
    chunk.extend_from_slice(b"JSON");
    chunk.append(&mut text);
    Some((12, 8 + before, chunk))
}

/// Adds the provenance to a JSON object as its last field.
fn json_text(bytes: &[u8], words: &str) -> Option<Splice> {
    let text = str::from_utf8(bytes).ok()?.trim_end();
    let inside = text.strip_prefix('{')?.strip_suffix('}')?.trim_end();
    let comma = if inside.is_empty() { "" } else { "," };
    let end = 1 + inside.len();
    Some((end, bytes.len() - end, format!("{comma}\n  \"{KEY}\": {words}\n}}\n").into_bytes()))
}

fn stl(bytes: &[u8], hash: &str) -> Option<Splice> {
    let is_binary = bytes.len() >= 84 && !bytes.starts_with(b"solid");
    is_binary.then(|| (0, 80, format!("{:<80}", format!("{STL}{hash}")).into_bytes()))
}

/// The name of the file with the provenance inside of a 3MF archive.
const NOTE: &[u8] = b"Metadata/maquette.json";

/// Adds the provenance as a file to a ZIP archive, after the other files and before the directory. The archive must not have an archive
/// comment; archives that this program writes have none.
fn zip(bytes: &[u8], words: &str) -> Option<Splice> {
    let end = bytes.len().checked_sub(22)?;
    let record = bytes[end..].strip_prefix(b"PK\x05\x06")?;
    let start = number(&record[12..])? as usize;
    let count = u16::from_le_bytes([record[4], record[5]]).checked_add(1)?;
    let length = (words.len() as u32).to_le_bytes();
    // The bytes that the local header of the file and its entry in the directory of the archive have in common: version 2.0, no flags, no
    // compression, January 1, 1980, checksum, sizes, length of the name, no extra field.
    let mut header = [20, 0, 0, 0, 0, 0, 0, 0, 33, 0].to_vec();
    header.extend(checksum(words.as_bytes()).to_le_bytes());
    header.extend([length, length].as_flattened());
    header.extend([NOTE.len() as u8, 0, 0, 0]);
    let mut new = [b"PK\x03\x04", &header[..], NOTE, words.as_bytes()].concat();
    let directory = start + new.len();
    new.extend_from_slice(bytes.get(start..end)?);
    let place = (start as u32).to_le_bytes();
    new.extend([b"PK\x01\x02\x14\0", &header[..], &[0; 10], &place, NOTE].concat());
    let size = (start + new.len() - directory) as u32;
    new.extend(b"PK\x05\x06\0\0\0\0");
    new.extend([count.to_le_bytes(), count.to_le_bytes()].as_flattened());
    new.extend([size.to_le_bytes(), u32::try_from(directory).ok()?.to_le_bytes()].as_flattened());
    new.extend([0; 2]);
    Some((start, bytes.len() - start, new))
}

/// The tag 270, `ImageDescription`, and the type 2, ASCII, of an entry in the directory of a TIFF file.
const DESCRIPTION: [u8; 4] = [14, 1, 2, 0];

fn number(bytes: &[u8]) -> Option<u32> {
    bytes.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))
}

/// Returns the offset and the entries of the first directory of a TIFF file. An entry consists of a tag, a type, a count, and a value or
/// the offset of the value.
fn directory(bytes: &[u8]) -> Option<(usize, &[[u8; 12]])> {
    let start = number(bytes.strip_prefix(b"II*\0")?)? as usize;
    let (count, rest) = bytes.get(start..)?.split_first_chunk()?;
    let entries = rest.get(..12 * usize::from(u16::from_le_bytes(*count)))?;
    Some((start, entries.as_chunks().0))
}

/// Adds the provenance to a TIFF file: replaces the directory by one with one more entry, followed by the text of that entry. The directory
/// must be at the end of the file, as in all TIFF files that this program writes.
fn tiff(bytes: &[u8], words: &str) -> Option<Splice> {
    let (start, entries) = directory(bytes)?;
    let is_last = bytes.len() == start + 2 + 12 * entries.len() + 4;
    fn tag(entry: &[u8]) -> u16 {
        u16::from_le_bytes([entry[0], entry[1]])
    }
    let at = entries.partition_point(|entry| tag(entry) < tag(&DESCRIPTION));
    let text = format!("{KEY} {words}\0");
    let count = u16::try_from(entries.len() + 1).ok()?;
    let mut new = count.to_le_bytes().to_vec();
    new.extend_from_slice(entries[..at].as_flattened());
    new.extend_from_slice(&DESCRIPTION);
    new.extend_from_slice(&(text.len() as u32).to_le_bytes());
    new.extend_from_slice(&u32::try_from(bytes.len() + 12).ok()?.to_le_bytes());
    new.extend_from_slice(entries[at..].as_flattened());
    new.extend_from_slice(&[0; 4]);
    new.extend_from_slice(text.as_bytes());
    is_last.then(|| (start, bytes.len() - start, new))
}

/// The signature at the start of every PNG file.
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Returns the type and the content of each chunk of a PNG file.
fn chunks(bytes: &[u8]) -> impl Iterator<Item = (&[u8], &[u8])> {
    let mut rest = bytes.strip_prefix(SIGNATURE).unwrap_or_default();
    std::iter::from_fn(move || {
        let length = u32::from_be_bytes(*rest.first_chunk()?) as usize;
        let chunk = rest.get(4..8 + length)?;
        rest = rest.get(12 + length..)?;
        Some(chunk.split_at(4))
    })
}

/// Adds the provenance to a PNG file, as a chunk `tEXt` after the header chunk.
fn png(bytes: &[u8], words: &str) -> Option<Splice> {
    let (kind, header) = chunks(bytes).next().filter(|(kind, _)| *kind == b"IHDR")?;
    let at = SIGNATURE.len() + 4 + kind.len() + header.len() + 4;
    let content = [b"tEXt", KEY.as_bytes(), &[0], words.as_bytes()].concat();
    let mut chunk = (content.len() as u32 - 4).to_be_bytes().to_vec();
    chunk.extend_from_slice(&content);
    chunk.extend_from_slice(&checksum(&content).to_be_bytes());
    Some((at, 0, chunk))
}

/// Computes the CRC-32 of ISO 3309, as in W3C, "PNG Specification", 3rd edition (2025), annex D.
fn checksum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc: u32, _: u32| {
            if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WORDS: &str = r#"{"maquette":"0.1.0","graph":"a*\/b.ron"}"#;

    fn signature() -> Signature {
        Signature { words: WORDS.into(), hash: "0123456789abcdef".into() }
    }

    #[track_caller]
    fn check(ending: &str, plain: &[u8], place: &str) {
        let mut bytes = plain.to_vec();
        assert_eq!(find(ending, &bytes), None);
        sign(ending, &mut bytes, &signature());
        let read = find(ending, &bytes);
        let Some(EmbeddedProvenance::Words(words)) = read else { panic!("{ending}: {read:?}") };
        let [words, expected] =
            [&words[..], WORDS].map(|words| serde_json::from_str::<Json>(words).unwrap());
        assert_eq!(words, expected);
        assert!(String::from_utf8_lossy(&bytes).contains(place), "{ending}");
    }

    #[test]
    fn every_format_contains_the_provenance() {
        check("ply", b"ply\nformat ascii 1.0\nend_header\n", "1.0\ncomment maquette {");
        check("pcd", b"# .PCD v0.7\nVERSION 0.7\n", "# .PCD v0.7\n# maquette {");
        check("obj", b"v 0 0 0\n", "# maquette {");
        check("step", b"ISO-10303-21;\nHEADER;\nENDSEC;\n", "HEADER;\n/* maquette {");
        check("json", b"{}\n", "\"maquette\": {");
        check("json", b"{\n  \"a\": 1\n}\n", "1,\n  \"maquette\": {");
        let document = br#"{"asset":{"version":"2.0"}}  "#;
        let mut glb = [&b"glTF\x02\0\0\0\0\0\0\0"[..], &[28, 0, 0, 0], b"JSON"].concat();
        glb.extend_from_slice(&document[..28]);
        check("glb", &glb, "\"extras\":{\"maquette\":{");
        let entry = [0, 1, 4, 0, 1, 0, 0, 0, 7, 0, 0, 0];
        let tiff = [&b"II*\0\x08\0\0\0\x01\0"[..], &entry, &[0; 4]].concat();
        check("tiff", &tiff, "maquette {");
        let header = [SIGNATURE, &[0, 0, 0, 1], b"IHDR", &[7], &[0; 4]].concat();
        check("png", &header, "tEXtmaquette\0{");
        let archive = [&b"PK\x05\x06"[..], &[0; 18]].concat();
        check("3mf", &archive, "Metadata/maquette.json{");
        assert_eq!(checksum(b"IEND"), 0xae42_6082);
    }

    #[test]
    fn ply_comments_are_split_into_short_lines() {
        let words =
            format!(r#"{{"maquette":"0.1.0","graph":"{}"}}"#, "a { long  name ".repeat(100));
        let mut bytes = b"ply\ncomment other\nformat ascii 1.0\nend_header\n".to_vec();
        sign("ply", &mut bytes, &Signature { words: words.clone(), hash: String::new() });
        let text = str::from_utf8(&bytes).unwrap();
        assert!(text.starts_with("ply\ncomment other\nformat ascii 1.0\ncomment maquette {"));
        assert!(text.lines().all(|line| line.len() <= 255), "{text}");
        // Some programs remove spaces at the ends of lines when they write the file again.
        let trimmed: String = text.lines().map(|line| format!("{}\r\n", line.trim_end())).collect();
        for text in [text, &trimmed] {
            assert_eq!(
                find("ply", text.as_bytes()),
                Some(EmbeddedProvenance::Words(words.clone()))
            );
        }
    }

    #[test]
    fn words_before_the_format_of_older_ply_files_are_found() {
        let file = format!("ply\ncomment maquette {WORDS}   \nformat ascii 1.0\nend_header\n");
        assert_eq!(find("ply", file.as_bytes()), Some(EmbeddedProvenance::Words(WORDS.into())));
    }

    #[test]
    fn a_header_of_80_bytes_has_room_for_a_hash_and_others_for_nothing() {
        let mut stl = vec![b' '; 84];
        sign("stl", &mut stl, &signature());
        assert_eq!(
            (stl.len(), find("stl", &stl)),
            (84, Some(EmbeddedProvenance::Hash("0123456789abcdef".into())))
        );
        for (ending, text) in
            [("ptx", "2\n2\n"), ("xyz", "0 0 0\n"), ("json", "[1]\n"), ("ply", "no")]
        {
            let mut bytes = text.as_bytes().to_vec();
            sign(ending, &mut bytes, &signature());
            assert_eq!((bytes, find(ending, text.as_bytes())), (text.as_bytes().to_vec(), None));
        }
    }
}
