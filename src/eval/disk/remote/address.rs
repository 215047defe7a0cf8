//! Where a server is, and who one is there.

use std::fmt;

use percent_encoding::percent_decode_str;
use ureq::http::Uri;

use crate::base64::base64;

/// The address of a server of results. Who one is there is never printed.
#[derive(Clone, PartialEq, Eq)]
pub(in super::super) struct Address {
    /// Without a name, a password or a slash at the end.
    url: String,
    /// What is said of who one is.
    authorization: Option<String>,
}

const HTTPS: &str = "https is not spoken here: name a proxy on this machine or in its network that does, by http://";

impl Address {
    /// The server at an address such as `http://name:password@host:8080/results`; instead of name and password, a `token` is
    /// shown if there is one.
    ///
    /// # Errors
    /// In words, if it is no address.
    pub(in super::super) fn parse(text: &str, token: Option<&str>) -> Result<Self, String> {
        let rest = match text.split_once("://") {
            Some(("http", rest)) => rest,
            Some(("https", _)) => return Err(HTTPS.into()),
            _ => return Err("an address begins with http://".into()),
        };
        let (authority, path) = rest.split_at(rest.find(['/', '?', '#']).unwrap_or(rest.len()));
        let (login, host) =
            authority.rsplit_once('@').map_or((None, authority), |(login, host)| {
                let login = percent_decode_str(login).collect::<Vec<u8>>();
                (Some(login), host)
            });
        let url = format!("http://{host}{}", path.trim_end_matches('/'));
        let is_plain = |url: &str| url.bytes().all(|byte| byte.is_ascii_graphic());
        let names_port = host.rsplit(']').next().is_some_and(|rest| rest.contains(':'));
        let is_whole = |uri: Uri| uri.port().is_some() == names_port;
        if host.is_empty()
            || path.contains(['?', '#'])
            || !is_plain(&url)
            || !url.parse().is_ok_and(is_whole)
        {
            return Err("an address is http://HOST:PORT/PATH".into());
        }
        let authorization = match (token, login) {
            (Some(token), _) if !is_plain(token) => {
                return Err("the token has characters that no token has".into());
            }
            (Some(token), _) => Some(format!("Bearer {token}")),
            (None, login) => login.map(|login| format!("Basic {}", base64(&login))),
        };
        Ok(Self { url, authorization })
    }

    /// What to say of who one is, if anything.
    pub(super) fn authorization(&self) -> Option<&str> {
        self.authorization.as_deref()
    }
}

impl fmt::Display for Address {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(&self.url)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_one_is_is_taken_out_of_the_address() {
        let read = |text, token| {
            let address = Address::parse(text, token).unwrap();
            (address.to_string(), address.authorization)
        };
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
            "https://a:secret@h",
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
