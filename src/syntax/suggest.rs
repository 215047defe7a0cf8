//! Guesses what was meant by a name that is not known.

use std::cell::Cell;

use super::Help;
use super::spelling::{difference, look_alike};

/// A list of names in a message goes no further.
const MOST_LISTED: usize = 30;

thread_local! {
    /// How many known names have been compared with one that is not: what tests ask for, since seconds say little.
    pub static LOOKS: Cell<usize> = const { Cell::new(0) };
}

/// "did you mean `x`?" with the nearest of the known names; empty if none is near.
///
/// Near is: no more than a third of the letters differ (swaps count once), and at least one may; if there is no such name, one
/// that goes on where the given one, of four letters at least, ends. It is an answer, not only a guess, if no other name is as near, and if
/// more than a single letter has been meant. A known name that is the given one is never an answer, and of one that only looks like it,
/// the words say how it is spelled.
pub fn nearest<'a>(given: &str, known: impl IntoIterator<Item = &'a str>) -> Help {
    let name = given.to_lowercase();
    let length = name.chars().count();
    let limit = (length / 3).max(1);
    let (mut near, mut longer, mut is_only) = (None, None, false);
    for known in known {
        LOOKS.set(LOOKS.get() + 1);
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
            // What is left out at the end is no mistake, but a letter before it may be missing.
            let beginnings = [length, length + 1].into_iter().filter(|n| *n <= known_length);
            let distance =
                |n| strsim::osa_distance(&name, &String::from_iter(lower.chars().take(n)));
            let distance = beginnings.map(distance).min().unwrap_or(length);
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

/// The same; if nothing is near, a list of what there is.
pub fn nearest_or_all(name: &str, what: &str, known: &[&str]) -> Help {
    let known: Vec<_> = known.iter().copied().filter(|known| *known != name).collect();
    match nearest(name, known.iter().copied()) {
        help if !help.is_empty() => help,
        _ if known.is_empty() => Help::default(),
        _ if known.len() > MOST_LISTED => {
            let rest = known.len() - MOST_LISTED;
            format!("{what}: {} and {rest} more", known[..MOST_LISTED].join(", ")).into()
        }
        _ => format!("{what}: {}", known.join(", ")).into(),
    }
}

/// A message of one line about a name that is not known: what is wrong, and what may have been meant.
pub fn unknown(message: String, name: &str, what: &str, known: &[&str]) -> String {
    match nearest_or_all(name, what, known) {
        help if help.is_empty() => message,
        help => format!("{message}; {help}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_is_recognized_and_a_stranger_is_not() {
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
    fn only_the_one_name_that_is_near_is_an_answer() {
        fn meant(name: &str, known: &[&'static str]) -> Option<String> {
            nearest(name, known.iter().copied()).meant().map(str::to_owned)
        }
        assert_eq!(meant("dol", &["doll", "mask"]).as_deref(), Some("doll"));
        assert_eq!(meant("dol", &["doll", "dog"]), None, "either may be meant");
        assert_eq!(meant("dool", &["dog", "doll"]), Some("doll".into()));
        assert_eq!(meant("b", &["a"]), None, "nothing of it is the same");
        assert_eq!(meant("trian", &["Triangulate"]), None, "others may begin like that");
    }

    #[test]
    fn a_suggestion_is_another_name_and_looks_like_one() {
        assert_eq!(nearest("levels", ["levels", "level"]).to_string(), "did you mean `level`?");
        assert_eq!(nearest("levels", ["levels"]).to_string(), "");
        assert_eq!(nearest_or_all("levels", "fields", &["levels"]).to_string(), "");
        assert_eq!(nearest_or_all("levels", "fields", &["levels", "x"]).to_string(), "fields: x");
        let help = nearest("lev\u{200b}els", ["scheme", "levels"]);
        assert_eq!(help.to_string(), "write `levels` without U+200B");
        assert_eq!(help.meant(), Some("levels"));
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
    fn a_message_without_a_guess_has_no_loose_end() {
        assert_eq!(unknown("no `foo`".into(), "foo", "nodes", &[]), "no `foo`");
        assert_eq!(
            unknown("no `foo`".into(), "foo", "nodes", &["fooo"]),
            "no `foo`; did you mean `fooo`?"
        );
        assert_eq!(
            unknown("no `foo`".into(), "foo", "nodes", &["a", "b"]),
            "no `foo`; nodes: a, b"
        );
    }
}
