//! How much is tried of what has many cases.

/// Whether all of them are tried, as `just nightly` does (`TESTS=all`), and not only as many as each change is asked for.
pub(crate) fn is_thorough() -> bool {
    std::env::var_os("TESTS").is_some_and(|which| which == "all")
}
