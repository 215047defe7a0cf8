//! Guesses what was meant by a name that is not known.

/// "did you mean `x`?" with the nearest of the known names; empty if none is near.
///
/// Near is: no more than a third of the letters differ (Damerau-Levenshtein, swaps count once), and at least one may.
pub(crate) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let distance =
        |known: &str| strsim::damerau_levenshtein(&name.to_lowercase(), &known.to_lowercase());
    let nearest = known.into_iter().map(|known| (distance(known), known)).min_by_key(|near| near.0);
    match nearest {
        Some((distance, known)) if distance <= (name.chars().count() / 3).max(1) => {
            format!("did you mean `{known}`?")
        }
        _ => String::new(),
    }
}

/// The same; if nothing is near, a list of what there is.
pub(crate) fn nearest_or_all(name: &str, what: &str, known: &[&str]) -> String {
    match nearest(name, known.iter().copied()) {
        help if !help.is_empty() => help,
        _ if known.is_empty() => String::new(),
        _ => format!("{what}: {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_is_recognized_and_a_stranger_is_not() {
        assert_eq!(nearest("levls", ["scheme", "levels"]), "did you mean `levels`?");
        assert_eq!(nearest("Lop", ["Loop"]), "did you mean `Loop`?");
        assert_eq!(nearest("xyz", ["scheme", "levels"]), "");
        assert_eq!(
            nearest_or_all("xyz", "fields", &["scheme", "levels"]),
            "fields: scheme, levels"
        );
    }
}
