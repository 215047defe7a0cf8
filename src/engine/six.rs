//! Numbers as goldens and messages have them.

/// Six digits, as goldens and messages have them.
pub fn six(x: f64) -> String {
    let text = format!("{x:.5e}");
    let exponent: i32 = text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    // Not a number, or beyond what reads well as a plain one.
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
