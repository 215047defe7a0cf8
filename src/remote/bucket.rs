//! S3 buckets: the URLs of files, the credentials, and error responses.

use std::time::SystemTime;

use ureq::http::StatusCode;

use super::address::{endpoint, is_plain};
use super::signature::{Keys, date};

/// An S3 bucket, and the folder in it that contains the results.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Bucket {
    name: String,
    /// The scheme, host and port of the endpoint, such as `https://host:port`.
    origin: String,
    /// The beginning of the path in each URL, before the name of the file: `/`, `/prefix/` or `/bucket/prefix/`.
    folder: String,
    keys: Keys,
}

/// Takes the place of the hash of the body in a signature. Uploads are not hashed, because downloads are verified by checksums.
const PAYLOAD: &str = "UNSIGNED-PAYLOAD";

const NO_KEYS: &str = "a bucket needs AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY; files of profiles are not read: \
    `aws configure export-credentials --format env` prints what they have";

impl Bucket {
    /// Parses an address such as `s3://BUCKET/PREFIX`. The endpoint, region and keys are read from the usual environment variables of AWS.
    ///
    /// # Errors
    /// A message if the address is invalid or a variable is missing.
    pub(super) fn parse(
        text: &str,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Self, String> {
        let (name, prefix) = text.split_once('/').unwrap_or((text, ""));
        let prefix = prefix.trim_end_matches('/');
        fn is_name(text: &str) -> bool {
            !text.trim_start_matches('.').is_empty()
                && text
                    .bytes()
                    .all(|byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte))
        }
        if !is_name(name) || !prefix.is_empty() && !prefix.split('/').all(is_name) {
            return Err("an address is s3://BUCKET/PREFIX, of letters, digits, -, _ and .".into());
        }
        let first = |names: &[&str]| names.iter().find_map(|name| variable(name));
        let region = first(&["AWS_REGION", "AWS_DEFAULT_REGION"]);
        let region = region.unwrap_or_else(|| "us-east-1".to_owned());
        if !is_name(&region) {
            return Err("AWS_REGION is not a region, such as eu-west-1".into());
        }
        let id = variable("AWS_ACCESS_KEY_ID").ok_or(NO_KEYS)?;
        let secret = variable("AWS_SECRET_ACCESS_KEY").ok_or(NO_KEYS)?;
        let token = variable("AWS_SESSION_TOKEN");
        if !is_plain(&id) || !token.as_deref().is_none_or(is_plain) {
            return Err("AWS_ACCESS_KEY_ID or AWS_SESSION_TOKEN has invalid characters".into());
        }
        let (origin, path) = match first(&["AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"]) {
            Some(url) => {
                let (origin, path) =
                    endpoint(&url).map_err(|why| format!("AWS_ENDPOINT_URL: {why}"))?;
                (origin, format!("{path}/{name}"))
            }
            None => {
                let end = if region.starts_with("cn-") { ".cn" } else { "" };
                let host = format!("s3.{region}.amazonaws.com{end}");
                match name.contains('.') {
                    // Use the path for a bucket name with dots. As a part of the host name, it would not match the wildcard certificate.
                    true => (format!("https://{host}"), format!("/{name}")),
                    false => (format!("https://{name}.{host}"), String::new()),
                }
            }
        };
        let folder = if prefix.is_empty() { path + "/" } else { format!("{path}/{prefix}/") };
        Ok(Self { name: name.to_owned(), origin, folder, keys: Keys { id, secret, token, region } })
    }

    /// Returns the URL of the file with this name.
    pub(super) fn url(&self, file: &str) -> String {
        format!("{}{}{file}", self.origin, self.folder)
    }

    /// Returns the headers of a request for a file, signed for the current time.
    pub(super) fn headers(&self, method: &str, file: &str) -> Vec<(&'static str, String)> {
        let host = self.origin.split_once("://").map_or("", |(_, host)| host);
        let date = date(SystemTime::now());
        let mut headers = vec![
            ("host", host.to_owned()),
            ("x-amz-content-sha256", PAYLOAD.to_owned()),
            ("x-amz-date", date.clone()),
        ];
        headers.extend(self.keys.token.clone().map(|token| ("x-amz-security-token", token)));
        let signed: Vec<_> = headers.iter().map(|(name, value)| (*name, &value[..])).collect();
        let path = format!("{}{file}", self.folder);
        let said = self.keys.authorization(method, &path, &signed, PAYLOAD, &date);
        headers.push(("authorization", said));
        headers
    }

    /// Returns a message for an error response. `None` if the response means that the file does not exist. Of the response, the message
    /// contains only the error code and the region.
    pub(super) fn refusal(
        &self,
        status: StatusCode,
        region: Option<&str>,
        said: &str,
    ) -> Option<String> {
        fn is_word(text: &&str) -> bool {
            (1..=64).contains(&text.len())
                && text.bytes().all(|byte: u8| byte.is_ascii_alphanumeric() || byte == b'-')
        }
        let code = element(said, "Code").filter(is_word);
        let why = match code {
            Some("NoSuchKey") => return None,
            None if status == StatusCode::NOT_FOUND => return None,
            Some("NoSuchBucket") => format!("there is no bucket `{}`", self.name),
            Some("InvalidAccessKeyId") => "there is no such AWS_ACCESS_KEY_ID".into(),
            Some("SignatureDoesNotMatch") => {
                "AWS_SECRET_ACCESS_KEY does not belong to AWS_ACCESS_KEY_ID".into()
            }
            Some("RequestTimeTooSkewed") => "the clock of this machine is wrong".into(),
            Some("ExpiredToken" | "InvalidToken") => {
                "AWS_SESSION_TOKEN is invalid or expired".into()
            }
            Some("AccessDenied") => {
                "the keys need s3:GetObject and s3:ListBucket, and s3:PutObject to keep results"
                    .into()
            }
            Some("PermanentRedirect" | "TemporaryRedirect" | "AuthorizationHeaderMalformed") => {
                match region.or_else(|| element(said, "Region")).filter(is_word) {
                    Some(region) => format!("AWS_REGION must be {region}"),
                    None => "AWS_REGION is not where the bucket is".into(),
                }
            }
            Some(code) => return Some(format!("{} {code}", status.as_u16())),
            None => return Some(status.to_string()),
        };
        Some(format!("{} {}: {why}", status.as_u16(), code.unwrap_or_default()))
    }
}

/// Returns the content of the first XML element with this name. `None` if there is none.
fn element<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(&format!("<{name}>"))?;
    rest.split_once("</").map(|(inside, _)| inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEYS: [(&str, &str); 2] =
        [("AWS_ACCESS_KEY_ID", "id"), ("AWS_SECRET_ACCESS_KEY", "hidden")];

    fn read(text: &str, more: &[(&str, &str)]) -> Result<Bucket, String> {
        let set = |name: &str| more.iter().chain(&KEYS).find(|(it, _)| *it == name);
        Bucket::parse(text, |name| set(name).map(|(_, value)| (*value).to_owned()))
    }

    #[test]
    fn a_file_of_a_bucket_has_an_address() {
        fn url(text: &str, more: &[(&str, &str)]) -> String {
            read(text, more).map(|it| it.url("build/name")).unwrap()
        }
        let at = ("AWS_ENDPOINT_URL", "http://[::1]:5000/s3/");
        assert_eq!(url("b/p/q/", &[at]), "http://[::1]:5000/s3/b/p/q/build/name");
        assert_eq!(url("b", &[]), "https://b.s3.us-east-1.amazonaws.com/build/name");
        let region = ("AWS_REGION", "cn-north-1");
        assert_eq!(url("a.b", &[region]), "https://s3.cn-north-1.amazonaws.com.cn/a.b/build/name");
    }

    #[test]
    fn errors_do_not_contain_the_keys() {
        for text in ["", "/p", "id:hidden@b/p", "b/../c", "b//c", "b/p?hidden", "b/ä"] {
            let why = read(text, &[]).err().unwrap_or_else(|| panic!("{text}"));
            assert!(why.contains("s3://BUCKET/PREFIX") && !why.contains("hidden"), "{why}");
        }
        for (name, value, expected) in [
            ("AWS_ENDPOINT_URL", "ftp://h", "AWS_ENDPOINT_URL: "),
            ("AWS_ENDPOINT_URL_S3", "https://a:hidden@h", "AWS_ENDPOINT_URL: "),
            ("AWS_REGION", "hidden/x", "AWS_REGION is not a region"),
            ("AWS_SESSION_TOKEN", "hidden\n", "AWS_ACCESS_KEY_ID or AWS_SESSION_TOKEN has invalid"),
        ] {
            let why = read("b", &[(name, value)]).err().unwrap_or_else(|| panic!("{name}"));
            assert!(why.contains(expected) && !why.contains("hidden"), "{why}");
        }
        assert!(Bucket::parse("b", |_| None).is_err_and(|why| why.contains("AWS_ACCESS_KEY_ID")));
    }

    #[test]
    fn errors_of_a_bucket_contain_the_code() {
        let bucket = read("b/p", &[]).unwrap();
        fn refusal(
            status: u16,
            region: Option<&str>,
            said: &str,
            bucket: &Bucket,
        ) -> Option<String> {
            let said =
                format!("<?xml version=\"1.0\"?><Error>{said}<Message>hidden</Message></Error>");
            bucket.refusal(StatusCode::from_u16(status).unwrap(), region, &said)
        }
        fn code(status: u16, code: &str, bucket: &Bucket) -> Option<String> {
            refusal(status, None, &format!("<Code>{code}</Code>"), bucket)
        }
        assert_eq!(code(404, "NoSuchKey", &bucket), None);
        assert_eq!(
            code(404, "NoSuchBucket", &bucket).unwrap(),
            "404 NoSuchBucket: there is no bucket `b`"
        );
        for known in ["InvalidAccessKeyId", "SignatureDoesNotMatch", "RequestTimeTooSkewed"] {
            let why = code(403, known, &bucket).unwrap();
            assert!(why.starts_with(&format!("403 {known}: ")), "{why}");
        }
        assert_eq!(code(503, "SlowDown", &bucket).unwrap(), "503 SlowDown");
        let moved =
            refusal(301, Some("eu-west-1"), "<Code>PermanentRedirect</Code>", &bucket).unwrap();
        assert!(moved.ends_with("AWS_REGION must be eu-west-1"), "{moved}");
        // An error code with invalid characters is not included in the message.
        assert_eq!(code(403, "\u{1b}[31m", &bucket).unwrap(), "403 Forbidden");
        assert_eq!(refusal(500, None, "", &bucket).unwrap(), "500 Internal Server Error");
    }
}
