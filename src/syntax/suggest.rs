//! Suggests corrections of unknown names.

use std::cell::Cell;

use super::Help;
use super::spelling::{difference, look_alike};

/// The maximum number of names that one message lists.
const MAX_LISTED: usize = 30;

thread_local! {
    /// Number of name comparisons made so far, for tests of the running time.
    pub static COMPARISONS: Cell<usize> = const { Cell::new(0) };
}

/// Suggests the known name that is nearest to `given`: "did you mean `x`?". Empty if no name is near.
///
/// A name is near if at most a third of the letters differ; a swap of two letters counts as one difference, and one difference is always
/// allowed. If no name is near, a longer name is suggested that begins with the given name, which must have at least four letters.
///
/// The help contains a fix if no other name is equally near and at most a third of the letters differ. A name equal to `given` is never
/// suggested. If a name looks the same as `given`, the help states the difference.
pub fn nearest<'a>(given: &str, known: impl IntoIterator<Item = &'a str>) -> Help {
    let name = given.to_lowercase();
    let length = name.chars().count();
    let limit = (length / 3).max(1);
    let (mut near, mut longer, mut is_only) = (None, None, false);
    for known in known {
        COMPARISONS.set(COMPARISONS.get() + 1);
        if known == given {
            continue;
        }
        if look_alike(given, known) {
            let words = format!("write `{known}` {}", difference(given, known));
            return Help::rename(words, given, known);
        }
        let lower = known.to_lowercase();
        let known_length = lower.chars().count();
        if length.abs_diff(known_length) <= limit {
            let distance = strsim::osa_distance(&name, &lower);
            let least = near.map_or(limit + 1, |(least, _)| least);
            is_only = if distance == least { false } else { is_only || distance < least };
            if distance < least {
                near = Some((distance, known));
            }
        } else if 4 <= length && length < known_length && longer.is_none_or(|(least, _)| 0 < least)
        {
            // Only the beginning of the longer name is compared, so that its end does not count as a difference. One letter may be missing
            // before it.
            let beginnings = [length, length + 1].into_iter().filter(|n| *n <= known_length);
            let distances = beginnings
                .map(|n| strsim::osa_distance(&name, &lower.chars().take(n).collect::<String>()));
            let distance = distances.min().unwrap_or(length);
            if distance <= 1 && longer.is_none_or(|(least, _)| distance < least) {
                longer = Some((distance, known));
            }
        }
    }
    fn words(known: &str) -> String {
        format!("did you mean `{known}`?")
    }
    match (near, longer) {
        (Some((distance, known)), _) if is_only && distance <= length / 3 => {
            Help::rename(words(known), given, known)
        }
        (Some((_, known)), _) | (None, Some((_, known))) => words(known).into(),
        (None, None) => Help::default(),
    }
}

/// Like [`nearest`], but lists all known names if no name is near.
pub fn nearest_or_all(name: &str, what: &str, known: &[&str]) -> Help {
    let known: Vec<_> = known.iter().copied().filter(|known| *known != name).collect();
    match nearest(name, known.iter().copied()) {
        help if !help.is_empty() => help,
        _ if known.is_empty() => Help::default(),
        _ if known.len() > MAX_LISTED => {
            let rest = known.len() - MAX_LISTED;
            format!("{what}: {} and {rest} more", known[..MAX_LISTED].join(", ")).into()
        }
        _ => format!("{what}: {}", known.join(", ")).into(),
    }
}

/// Appends a suggestion for an unknown name to a one-line message.
pub fn unknown_name_message(message: String, name: &str, what: &str, known: &[&str]) -> String {
    match nearest_or_all(name, what, known) {
        help if help.is_empty() => message,
        help => format!("{message}; {help}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_similar_names_are_suggested() {
        assert_eq!(nearest("levls", ["scheme", "levels"]).to_string(), "did you mean `levels`?");
        assert_eq!(nearest("Lop", ["Loop"]).to_string(), "did you mean `Loop`?");
        assert_eq!(nearest("lveel", ["scheme", "level"]).to_string(), "did you mean `level`?");
        assert_eq!(nearest("xyz", ["scheme", "levels"]).to_string(), "");
        assert_eq!(
            nearest_or_all("xyz", "fields", &["scheme", "levels"]).to_string(),
            "fields: scheme, levels"
        );
    }

    #[test]
    fn a_fix_requires_a_single_nearest_name() {
        fn suggested_name(name: &str, known: &[&'static str]) -> Option<String> {
            nearest(name, known.iter().copied()).suggested_name().map(str::to_owned)
        }
        assert_eq!(suggested_name("dol", &["doll", "mask"]).as_deref(), Some("doll"));
        assert_eq!(suggested_name("dol", &["doll", "dog"]), None, "either may be meant");
        assert_eq!(suggested_name("dool", &["dog", "doll"]), Some("doll".into()));
        assert_eq!(suggested_name("b", &["a"]), None, "nothing of it is the same");
        assert_eq!(suggested_name("trian", &["Triangulate"]), None, "others may begin like that");
    }

    #[test]
    fn a_suggestion_differs_visibly_from_the_given_name() {
        assert_eq!(nearest("levels", ["levels", "level"]).to_string(), "did you mean `level`?");
        assert_eq!(nearest("levels", ["levels"]).to_string(), "");
        assert_eq!(nearest_or_all("levels", "fields", &["levels"]).to_string(), "");
        assert_eq!(nearest_or_all("levels", "fields", &["levels", "x"]).to_string(), "fields: x");
        let help = nearest("lev\u{200b}els", ["scheme", "levels"]);
        assert_eq!(help.to_string(), "write `levels` without U+200B");
        assert_eq!(help.suggested_name(), Some("levels"));
    }

    #[test]
    fn a_name_that_is_cut_off_is_recognized() {
        assert_eq!(
            nearest("Tresh", ["Label", "Threshold"]).to_string(),
            "did you mean `Threshold`?"
        );
        assert_eq!(
            nearest("trian", ["Label", "Triangulate"]).to_string(),
            "did you mean `Triangulate`?"
        );
        assert_eq!(nearest("sca", ["scan-of-all-sides"]).to_string(), "");
    }

    #[test]
    fn a_long_list_of_names_is_cut() {
        let names: Vec<_> = (0..1000).map(|k| format!("node-{k}")).collect();
        let names: Vec<_> = names.iter().map(String::as_str).collect();
        let help = nearest_or_all("xyz", "its nodes", &names).to_string();
        assert!(help.ends_with("node-29 and 970 more"), "{help}");
    }

    #[test]
    fn a_message_without_suggestion_is_unchanged() {
        assert_eq!(unknown_name_message("no `foo`".into(), "foo", "nodes", &[]), "no `foo`");
        assert_eq!(
            unknown_name_message("no `foo`".into(), "foo", "nodes", &["fooo"]),
            "no `foo`; did you mean `fooo`?"
        );
        assert_eq!(
            unknown_name_message("no `foo`".into(), "foo", "nodes", &["a", "b"]),
            "no `foo`; nodes: a, b"
        );
    }
}
