//! Formats numbers for test references (goldens) and messages.

/// Formats a number with six significant digits.
pub fn six_digits(x: f64) -> String {
    let text = format!("{x:.5e}");
    let exponent: i32 = text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    // Use scientific notation for numbers that are too large or too small for plain decimals. Infinity and NaN keep Rust's format.
    if !x.is_finite() || !(-5..=9).contains(&exponent) {
        return if x == 0.0 { "0".into() } else { text.replace("e0", "") };
    }
    let plain = format!("{x:.*}", (5 - exponent).max(0) as usize);
    let plain = if plain.contains('.') {
        plain.trim_end_matches('0').trim_end_matches('.')
    } else {
        &plain
    };
    if plain == "-0" { "0".into() } else { plain.to_owned() }
}
