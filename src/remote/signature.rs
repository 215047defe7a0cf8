//! AWS Signature Version 4, which authenticates requests to an S3 bucket.
//!
//! Source: Amazon, *Signature Calculations for the Authorization Header: Transferring Payload in a Single Chunk (AWS Signature Version 4)*,
//! in the reference of S3. The test uses the example from this source.
//!
//! The signature is sent in a header and never in the URL, because proxies log URLs.

use std::fmt::Write as _;
use std::time::{Duration, SystemTime};

use ring::digest::{SHA256, digest};
use ring::hmac;

/// The credentials for a bucket. All fields except for the region are secret.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Keys {
    pub(super) id: String,
    pub(super) secret: String,
    /// The session token, if the keys are temporary.
    pub(super) token: Option<String>,
    pub(super) region: String,
}

impl Keys {
    /// Returns the value of the header `Authorization` for a request. `date` is the time in the format of [`date`]. The headers must be
    /// sorted by name, with names in lower case. `payload` is the hash of the body, or `UNSIGNED-PAYLOAD`.
    pub(super) fn authorization(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        payload: &str,
        date: &str,
    ) -> String {
        let names = headers.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(";");
        let lines: String = headers.iter().map(|(name, it)| format!("{name}:{it}\n")).collect();
        let request = format!("{method}\n{path}\n\n{lines}\n{names}\n{payload}");
        let (day, region) = (date.split('T').next().unwrap_or(date), &self.region);
        let scope = format!("{day}/{region}/s3/aws4_request");
        let hash = hex(digest(&SHA256, request.as_bytes()).as_ref());
        let text = format!("AWS4-HMAC-SHA256\n{date}\n{scope}\n{hash}");
        let parts = [day, region, "s3", "aws4_request", &text];
        let secret = format!("AWS4{}", self.secret).into_bytes();
        let signature = hex(&parts.iter().fold(secret, |key, part| {
            let key = hmac::Key::new(hmac::HMAC_SHA256, &key);
            hmac::sign(&key, part.as_bytes()).as_ref().to_vec()
        }));
        let id = &self.id;
        format!(
            "AWS4-HMAC-SHA256 Credential={id}/{scope}, SignedHeaders={names}, Signature={signature}"
        )
    }
}

/// Formats a time in UTC, such as `20130524T000000Z`.
///
/// Source: Howard Hinnant, *chrono-Compatible Low-Level Date Algorithms* (2013), `civil_from_days`. The names of the variables are those of
/// the source.
pub(super) fn date(time: SystemTime) -> String {
    let seconds = time.duration_since(SystemTime::UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
    let z = seconds / 86_400 + 719_468;
    let (era, doe) = (z / 146_097, z % 146_097);
    let yoe = (doe - doe / 1460 + doe / 36_524 - doe / 146_096) / 365;
    let doy = doe - (365 * yoe + yoe / 4 - yoe / 100);
    let mp = (5 * doy + 2) / 153;
    let day = doy - (153 * mp + 2) / 5 + 1;
    let month = if mp < 10 { mp + 3 } else { mp - 9 };
    let year = yoe + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z")
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_of_the_reference_has_its_signature() {
        let keys = Keys {
            id: "AKIAIOSFODNN7EXAMPLE".into(),
            secret: "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY".into(),
            token: None,
            region: "us-east-1".into(),
        };
        let empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        let date = "20130524T000000Z";
        let headers = [
            ("host", "examplebucket.s3.amazonaws.com"),
            ("range", "bytes=0-9"),
            ("x-amz-content-sha256", empty),
            ("x-amz-date", date),
        ];
        let said = keys.authorization("GET", "/test.txt", &headers, empty, date);
        assert_eq!(
            said,
            "AWS4-HMAC-SHA256 Credential=AKIAIOSFODNN7EXAMPLE/20130524/us-east-1/s3/aws4_request, \
             SignedHeaders=host;range;x-amz-content-sha256;x-amz-date, \
             Signature=f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41"
        );
    }

    #[test]
    fn dates_are_formatted() {
        let dates = [0, 951_782_399, 951_782_400, 1_369_353_600, 4_107_542_399]
            .map(|seconds| date(SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)));
        let known = [
            "19700101T000000Z",
            "20000228T235959Z",
            "20000229T000000Z",
            "20130524T000000Z",
            "21000228T235959Z",
        ];
        assert_eq!(dates, known);
    }
}
