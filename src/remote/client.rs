//! The HTTP client: GET, PUT and HEAD requests with short timeouts.

use std::io::{self, Read};
use std::time::{Duration, Instant};

use ureq::http::{Response, StatusCode};
#[cfg(feature = "tls")]
use ureq::tls::{RootCerts, TlsConfig};
use ureq::{Agent, Body, Error, RequestBuilder, SendBody};

use super::address::Address;

/// Timeout for resolving the server's name, and another one of the same length for connecting. Connecting with TLS may take twice as long.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(300);

/// Timeout for the beginning of a response, and for each pause while the response is received.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);

/// Timeout for the response to an upload. It is longer than that for downloads, because uploads run in the background.
const STORE_TIMEOUT: Duration = Duration::from_secs(5);

/// Minimum time limit of a download, in seconds. A download may take this long even if computing the result would be faster.
const MIN_ALLOWED_SECONDS: f64 = 0.5;

/// Maximum number of bytes that are read from the body of an error response.
const MAX_REFUSAL_BYTES: u64 = 8 << 10;

pub(super) struct Client {
    agent: Agent,
    address: Address,
}

/// The result of a GET request.
pub(super) enum Answer {
    Found(Vec<u8>),
    /// The file does not exist, or it is incomplete or too long.
    Missing,
    /// The server must not be used again; the text is the reason.
    Failed(String),
}

/// The result of a PUT request.
pub(super) enum Reply {
    Stored,
    /// The server does not accept files of this size.
    TooLarge,
    /// The server accepts no files at all; the text is the reason.
    Refused(String),
    Failed(String),
}

impl Client {
    pub(super) fn new(address: Address) -> Self {
        let is_encrypted = address.file_url("").starts_with("https");
        let config = Agent::config_builder()
            .http_status_as_error(false)
            // Do not follow redirects: a redirect counts as a missing file.
            .max_redirects(0)
            .max_redirects_will_error(false)
            .proxy(None)
            .user_agent(concat!("maquette/", env!("CARGO_PKG_VERSION")))
            // Close idle connections early. If the server closes a connection while a request is sent, the request fails although the
            // server works.
            .max_idle_age(Duration::from_secs(2))
            .timeout_resolve(Some(CONNECT_TIMEOUT))
            .timeout_connect(Some(if is_encrypted { 2 * CONNECT_TIMEOUT } else { CONNECT_TIMEOUT }))
            .timeout_per_read(Some(ANSWER_TIMEOUT))
            .timeout_per_write(Some(ANSWER_TIMEOUT))
            .timeout_recv_response(Some(ANSWER_TIMEOUT));
        // Trust only the root certificates of the operating system.
        #[cfg(feature = "tls")]
        let config =
            config.tls_config(TlsConfig::builder().root_certs(RootCerts::PlatformVerifier).build());
        Self { agent: config.build().into(), address }
    }

    /// Checks that the server responds.
    pub(crate) fn check(&self) -> Result<(), String> {
        // Use a GET request for a bucket, because it does not send the reason of an error in the response to a HEAD request.
        match self.address.bucket().map(|_| self.get("answers", 0, 0.0)) {
            Some(Answer::Failed(why)) => Err(why),
            Some(Answer::Found(_) | Answer::Missing) => Ok(()),
            None => self.head("").map(drop),
        }
    }

    /// Downloads a file of at most `max_bytes` bytes. Stops if the whole download is expected to take longer than `max_seconds` seconds.
    pub(super) fn get(&self, file: &str, max_bytes: u64, max_seconds: f64) -> Answer {
        let request = self.sign_request(self.agent.get(self.address.file_url(file)), "GET", file);
        match request.call() {
            Ok(mut response) if response.status() != StatusCode::OK => {
                self.refusal(&mut response).map_or(Answer::Missing, Answer::Failed)
            }
            Ok(response) => body(response, max_bytes, max_seconds),
            Err(error) => Answer::Failed(describe_error(&error)),
        }
    }

    /// Returns the size of a file in bytes. `None` if the file does not exist. The error is the reason why the server must not be used
    /// again.
    pub(super) fn head(&self, file: &str) -> Result<Option<u64>, String> {
        let request = self.sign_request(self.agent.head(self.address.file_url(file)), "HEAD", file);
        let response = request.call().map_err(|error| describe_error(&error))?;
        let status = response.status();
        if status == StatusCode::UNAUTHORIZED || status.is_server_error() {
            return Err(status.to_string());
        }
        Ok(response.body().content_length().filter(|_| status == StatusCode::OK))
    }

    /// Uploads a file of `length` bytes, which are read from `bytes`.
    pub(super) fn put(&self, file: &str, length: u64, mut bytes: impl Read) -> Reply {
        let request = self.sign_request(self.agent.put(self.address.file_url(file)), "PUT", file);
        let request = request.header("Content-Length", length);
        let request = request.content_type("application/octet-stream").config();
        let request = request
            .timeout_recv_response(Some(STORE_TIMEOUT))
            .timeout_per_read(Some(STORE_TIMEOUT));
        match request.build().send(SendBody::from_reader(&mut bytes)) {
            Ok(response) if response.status().is_success() => Reply::Stored,
            Ok(mut response) => {
                let status = response.status();
                reply(status, self.refusal(&mut response).unwrap_or_else(|| status.to_string()))
            }
            Err(error) => Reply::Failed(describe_error(&error)),
        }
    }

    /// Adds the headers with the credentials to a request.
    fn sign_request<B>(
        &self,
        request: RequestBuilder<B>,
        method: &str,
        file: &str,
    ) -> RequestBuilder<B> {
        let headers = self.address.headers(method, file).into_iter();
        headers.fold(request, |request, (name, value)| request.header(name, value))
    }

    /// Returns a message for an error response. `None` if the file does not exist, or if the response is a redirect.
    fn refusal(&self, response: &mut Response<Body>) -> Option<String> {
        let status = response.status();
        let Some(bucket) = self.address.bucket() else {
            let is_none = [StatusCode::NOT_FOUND, StatusCode::GONE, StatusCode::NO_CONTENT];
            let is_absent = status.is_redirection() || is_none.contains(&status);
            return (!is_absent).then(|| status.to_string());
        };
        let mut said = Vec::new();
        // If the body cannot be read, use only the status in the message.
        let _ = response.body_mut().as_reader().take(MAX_REFUSAL_BYTES).read_to_end(&mut said);
        let region = response.headers().get("x-amz-bucket-region");
        let region = region.and_then(|region| region.to_str().ok());
        bucket.refusal(status, region, &String::from_utf8_lossy(&said))
    }
}

/// Classifies an error response to an upload.
fn reply(status: StatusCode, why: String) -> Reply {
    match status {
        StatusCode::PAYLOAD_TOO_LARGE => Reply::TooLarge,
        StatusCode::INSUFFICIENT_STORAGE => Reply::Refused(why),
        it if it.is_server_error() => Reply::Failed(why),
        _ => Reply::Refused(why),
    }
}

fn body(mut response: Response<Body>, max_bytes: u64, max_seconds: f64) -> Answer {
    let length = response.body().content_length();
    if length.is_some_and(|length| max_bytes < length) {
        return Answer::Missing;
    }
    let start = Instant::now();
    let (mut bytes, mut part) = (Vec::new(), vec![0; 64 << 10]);
    let mut reader = response.body_mut().with_config().limit(u64::MAX).reader();
    loop {
        let read = match reader.read(&mut part) {
            Ok(0) => return Answer::Found(bytes),
            Ok(read) => read,
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Answer::Missing,
            Err(error) => return Answer::Failed(describe_error(&Error::from(error))),
        };
        bytes.extend_from_slice(&part[..read]);
        let (now, elapsed) = (bytes.len() as u64, start.elapsed().as_secs_f64());
        if max_bytes < now {
            return Answer::Missing;
        }
        // Expected time in seconds for the whole download, at its speed so far.
        let expected = length.map_or(f64::INFINITY, |length| elapsed * length as f64 / now as f64);
        if MIN_ALLOWED_SECONDS < elapsed && max_seconds.max(MIN_ALLOWED_SECONDS) < expected {
            return Answer::Failed("downloading is slower than computing".into());
        }
    }
}

/// Describes the error of a request. The message does not contain the URL, because it may contain credentials.
fn describe_error(error: &Error) -> String {
    match error {
        Error::Timeout(_) => "it does not answer in time".into(),
        Error::HostNotFound => "there is no such host".into(),
        Error::Io(error) if error.kind() == io::ErrorKind::TimedOut => {
            "it does not answer in time".into()
        }
        Error::Io(error) => match error.get_ref().and_then(|error| error.downcast_ref()) {
            Some(error) => describe_error(error),
            None => error.to_string(),
        },
        error => error.to_string(),
    }
}
