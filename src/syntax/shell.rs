//! Words of commands.

/// A word as a shell takes it.
pub fn shell(word: &str) -> String {
    match !word.is_empty()
        && word.chars().all(|c: char| c.is_ascii_alphanumeric() || "-_./=,+:@%".contains(c))
    {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}
