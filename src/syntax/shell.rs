//! Quoting of words for POSIX shells.

/// Quotes a word for a POSIX shell if needed.
pub fn quote_for_shell(word: &str) -> String {
    match !word.is_empty()
        && word.chars().all(|c: char| c.is_ascii_alphanumeric() || "-_./=,+:@%".contains(c))
    {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}
