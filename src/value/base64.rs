//! Bytes as text.

/// The digits of RFC 4648, section 4.
const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Bytes as text.
pub fn base64(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |k: usize| u32::from(three.get(k).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for k in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * k)) as usize & 63];
            text.push(if k <= three.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

/// The value of each digit; 64 for what is none.
const VALUES: [u8; 256] = {
    let (mut values, mut value) = ([64; 256], 0);
    while value < 64 {
        values[DIGITS[value] as usize] = value as u8;
        value += 1;
    }
    values
};

/// The bytes that a text stands for, if it is one of [`base64`]; the signs at its end may be missing.
pub fn bytes_of(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for four in text.chunks(4) {
        let mut bits = 0;
        for &digit in four {
            let value = VALUES[usize::from(digit)];
            bits = bits << 6 | u32::from((value < 64).then_some(value)?);
        }
        bits <<= 6 * (4 - four.len());
        match four.len() {
            1 => return None,
            count => bytes.extend_from_slice(&bits.to_be_bytes()[1..count]),
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::{base64, bytes_of};

    #[test]
    fn base64_is_that_of_the_standard() {
        let coded =
            ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|text| base64(text.as_bytes()));
        assert_eq!(coded, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"]);
        let back = coded.map(|text| String::from_utf8(bytes_of(&text).unwrap()).unwrap());
        assert_eq!(back, ["", "f", "fo", "foo", "foob", "fooba", "foobar"]);
        assert_eq!(
            (bytes_of("Zm9vY"), bytes_of("Z?=="), bytes_of("Zg")),
            (None, None, Some(vec![b'f']))
        );
    }
}
