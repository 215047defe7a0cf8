//! Selects the number of random test cases.

/// Returns true if all random cases are tested, as in `just nightly` (`TESTS=all`). Otherwise only a part of them is tested, as in the
/// checks of each change.
pub(crate) fn is_thorough() -> bool {
    std::env::var_os("TESTS").is_some_and(|which| which == "all")
}
