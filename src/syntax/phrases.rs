//! Parts of messages.

/// `a Mask`, `an Image`.
pub fn with_article(word: &str) -> String {
    let vowel = word.starts_with(['A', 'E', 'I', 'O', 'U', 'a', 'e', 'i', 'o', 'u']);
    format!("{} {word}", if vowel { "an" } else { "a" })
}

/// The names of some types, for a message: `Mesh or Surface`.
pub fn any_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    Vec::from_iter(names).join(" or ")
}
