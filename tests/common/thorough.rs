//! Selects the number of random test cases.

/// Returns true if all random cases are tested, as in `just nightly` (`TESTS=all`). Otherwise fewer are tested, as for each change.
pub(crate) fn is_thorough() -> bool {
    std::env::var_os("TESTS").is_some_and(|which| which == "all")
}
