//! The URL and credentials of a remote cache.

use std::fmt;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use percent_encoding::percent_decode_str;
use ureq::http::Uri;

use super::bucket::Bucket;

/// The URL and credentials of a remote cache. The credentials must never be printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Address {
    /// The URL without user name, password and trailing slash.
    url: String,
    credentials: Credentials,
}

/// The credentials that are sent with each request.
#[derive(Clone, PartialEq, Eq)]
enum Credentials {
    Anonymous,
    /// The value of the `Authorization` header.
    Header(String),
    /// The bucket, whose keys sign each request.
    Signed(Bucket),
}

const HTTPS: &str = "https is not supported by this build: build with the feature `tls`, or use the http:// address of a proxy on this machine or \
    in its network that supports https";

impl Address {
    /// Parses the address of a server, such as `http://name:password@host:8080/results`, or of a bucket, such as `s3://bucket/results`. If
    /// `token` is given, it replaces name and password.
    ///
    /// # Errors
    /// A message if the address is invalid.
    pub fn parse(text: &str, token: Option<&str>) -> Result<Self, String> {
        if let Some(rest) = text.strip_prefix("s3://") {
            let who = Credentials::Signed(Bucket::parse(rest, |name| {
                std::env::var(name).ok().filter(|value| !value.is_empty())
            })?);
            return Ok(Self { url: text.trim_end_matches('/').to_owned(), credentials: who });
        }
        let (scheme, rest) = text.split_once("://").unwrap_or_default();
        let (authority, path) = rest.split_at(rest.find(['/', '?', '#']).unwrap_or(rest.len()));
        let (login, host) =
            authority.rsplit_once('@').map_or((None, authority), |(login, host)| {
                let login = percent_decode_str(login).collect::<Vec<u8>>();
                (Some(login), host)
            });
        let (origin, path) = endpoint(&format!("{scheme}://{host}{path}"))?;
        let who = match (token, login) {
            (Some(token), _) if !is_plain(token) => {
                return Err("the token has invalid characters".into());
            }
            (Some(token), _) => Credentials::Header(format!("Bearer {token}")),
            (None, Some(login)) => {
                Credentials::Header(format!("Basic {}", BASE64_STANDARD.encode(&login)))
            }
            (None, None) => Credentials::Anonymous,
        };
        Ok(Self { url: origin + &path, credentials: who })
    }

    /// Returns the URL of the file with this name.
    pub(super) fn file_url(&self, file: &str) -> String {
        match &self.credentials {
            Credentials::Signed(bucket) => bucket.url(file),
            Credentials::Anonymous | Credentials::Header(_) => format!("{}/{file}", self.url),
        }
    }

    /// Returns the headers that a request for a file needs.
    pub(super) fn headers(&self, method: &str, file: &str) -> Vec<(&'static str, String)> {
        match &self.credentials {
            Credentials::Anonymous => Vec::new(),
            Credentials::Header(said) => vec![("authorization", said.clone())],
            Credentials::Signed(bucket) => bucket.headers(method, file),
        }
    }

    /// Returns the bucket. `None` if the address is that of a server.
    pub(super) fn bucket(&self) -> Option<&Bucket> {
        match &self.credentials {
            Credentials::Signed(bucket) => Some(bucket),
            Credentials::Anonymous | Credentials::Header(_) => None,
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(&self.url)
    }
}

/// Splits a URL such as `http://host:port/path` into `http://host:port` and the path. Removes a trailing slash.
///
/// # Errors
/// A message if the URL is invalid.
pub(super) fn endpoint(url: &str) -> Result<(String, String), String> {
    let Some((scheme @ ("http" | "https"), rest)) = url.split_once("://") else {
        let known = if cfg!(feature = "s3") { "http://, https:// or s3://" } else { "http://" };
        return Err(format!("an address begins with {known}"));
    };
    if scheme == "https" && !cfg!(feature = "tls") {
        return Err(HTTPS.into());
    }
    let (url, rest) = (url.trim_end_matches('/'), rest.trim_end_matches('/'));
    let (host, path) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
    let names_port = host.rsplit(']').next().is_some_and(|rest| rest.contains(':'));
    if host.is_empty()
        || url.contains(['?', '#', '@'])
        || !is_plain(url)
        || !url.parse().is_ok_and(|uri: Uri| uri.port().is_some() == names_port)
    {
        return Err("an address is http://HOST:PORT/PATH".into());
    }
    Ok((format!("{scheme}://{host}"), path.to_owned()))
}

/// Returns true if a text can be used in a request without escapes.
pub(super) fn is_plain(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_graphic())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credentials_are_removed_from_the_url() {
        fn read(text: &str, token: Option<&str>) -> (String, Option<String>) {
            let address = Address::parse(text, token).unwrap();
            let said = address.headers("GET", "").pop().map(|(_, said)| said);
            (address.to_string(), said)
        }
        let basic = Some("Basic YTpiQGM=".to_owned());
        assert_eq!(read("http://a:b%40c@h:1/x/", None), ("http://h:1/x".to_owned(), basic));
        let bearer = Some("Bearer t".to_owned());
        assert_eq!(read("http://a:b@h", Some("t")), ("http://h".to_owned(), bearer));
        assert_eq!(read("http://[::1]:80/x", None), ("http://[::1]:80/x".to_owned(), None));
    }

    #[test]
    fn errors_do_not_contain_the_password() {
        for bad in [
            "",
            "host",
            "s3://a:secret@h",
            "https://a:secret@",
            "ftp://a:secret@h",
            "http://",
            "http://a:secret@",
            "http://a:secret@h/?x",
            "http://a:secret@h/\n",
            "http://a:secret@h:port",
        ] {
            let why = Address::parse(bad, None).err().unwrap_or_else(|| panic!("{bad}"));
            assert!(!why.contains("secret"), "{why}");
        }
        assert!(Address::parse("http://h", Some("a\r\nb")).is_err());
    }
}
