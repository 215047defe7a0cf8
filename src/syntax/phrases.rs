//! Phrases for messages.

/// Returns the name of a type with its article: `a Mask`, `an Image`.
pub fn with_article(word: &str) -> String {
    let vowel = word.starts_with(['A', 'E', 'I', 'O', 'U', 'a', 'e', 'i', 'o', 'u']);
    format!("{} {word}", if vowel { "an" } else { "a" })
}

/// Joins the names of types for a message: `Mesh or Surface`.
pub fn any_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    names.into_iter().collect::<Vec<_>>().join(" or ")
}
