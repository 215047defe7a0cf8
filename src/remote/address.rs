//! Where a server is, and who one is there.

use std::fmt;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use percent_encoding::percent_decode_str;
use ureq::http::Uri;

use super::bucket::Bucket;

/// The address of a server of results. Who one is there is never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Address {
    /// Without a name, a password or a slash at the end.
    url: String,
    who: Who,
}

/// Who one is at a server.
#[derive(Clone, PartialEq, Eq)]
enum Who {
    Anybody,
    /// This is said of it.
    Said(String),
    /// Each request is signed.
    Signed(Bucket),
}

const HTTPS: &str = "https is not spoken here: build with the feature `tls`, or name a proxy on this machine or in its network that \
    speaks it, by http://";

impl Address {
    /// The server at an address such as `http://name:password@host:8080/results`, or the bucket at `s3://bucket/results`; instead of
    /// name and password, a `token` is shown if there is one.
    ///
    /// # Errors
    /// In words, if it is no address.
    pub fn parse(text: &str, token: Option<&str>) -> Result<Self, String> {
        if let Some(rest) = text.strip_prefix("s3://") {
            let who = Who::Signed(Bucket::parse(rest, |name| {
                std::env::var(name).ok().filter(|value| !value.is_empty())
            })?);
            return Ok(Self { url: text.trim_end_matches('/').to_owned(), who });
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
                return Err("the token has characters that no token has".into());
            }
            (Some(token), _) => Who::Said(format!("Bearer {token}")),
            (None, Some(login)) => Who::Said(format!("Basic {}", BASE64_STANDARD.encode(&login))),
            (None, None) => Who::Anybody,
        };
        Ok(Self { url: origin + &path, who })
    }

    /// Where the server has a file of this name.
    pub(super) fn of(&self, file: &str) -> String {
        match &self.who {
            Who::Signed(bucket) => bucket.url(file),
            Who::Anybody | Who::Said(_) => format!("{}/{file}", self.url),
        }
    }

    /// What is said with a request for a file of this name.
    pub(super) fn headers(&self, method: &str, file: &str) -> Vec<(&'static str, String)> {
        match &self.who {
            Who::Anybody => Vec::new(),
            Who::Said(said) => vec![("authorization", said.clone())],
            Who::Signed(bucket) => bucket.headers(method, file),
        }
    }

    /// The bucket, if it is one.
    pub(super) fn bucket(&self) -> Option<&Bucket> {
        match &self.who {
            Who::Signed(bucket) => Some(bucket),
            Who::Anybody | Who::Said(_) => None,
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(&self.url)
    }
}

/// The server and the path in it that `http://host:port/path` names, without a slash at the end.
///
/// # Errors
/// In words, if it is no such address.
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

/// Whether it may stand in a request as it is.
pub(super) fn is_plain(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_graphic())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_one_is_is_taken_out_of_the_address() {
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
    fn what_is_no_address_is_told_without_its_password() {
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
