//! What is said to a server: GET, PUT and HEAD, none of which is waited for long.

use std::io::{self, Read};
use std::time::{Duration, Instant};

use ureq::http::{Response, StatusCode};
#[cfg(feature = "tls")]
use ureq::tls::{RootCerts, TlsConfig};
use ureq::{Agent, Body, Error, RequestBuilder, SendBody};

use super::address::Address;

/// How long it may take to find the server, and then to reach it; twice as long where keys are exchanged, too.
const TO_REACH: Duration = Duration::from_millis(300);

/// How long the server may take to begin its answer, and may stop in the middle of it.
const TO_ANSWER: Duration = Duration::from_millis(500);

/// How long it may take to say what became of what it was sent, which nobody waits for.
const TO_STORE: Duration = Duration::from_secs(5);

/// How many seconds an answer may take whatever it is worth.
const PATIENCE: f64 = 0.5;

/// What a bucket says of a refusal is shorter.
const MOST_WORDS: u64 = 8 << 10;

pub(super) struct Client {
    agent: Agent,
    address: Address,
}

/// What a server said of something that it was asked for.
pub(super) enum Answer {
    Is(Vec<u8>),
    /// It has no such thing, or one that is torn or too long.
    IsNot,
    /// It is of no use any more, and why.
    Fails(String),
}

/// What a server said of something that it was sent.
pub(super) enum Reply {
    Took,
    /// It takes nothing so large.
    TooLarge,
    /// It takes nothing, and why.
    Refuses(String),
    Fails(String),
}

impl Client {
    pub(super) fn new(address: Address) -> Self {
        let is_encrypted = address.of("").starts_with("https");
        let config = Agent::config_builder()
            .http_status_as_error(false)
            // What is elsewhere is not what was asked for.
            .max_redirects(0)
            .max_redirects_will_error(false)
            .proxy(None)
            .user_agent(concat!("maquette/", env!("CARGO_PKG_VERSION")))
            // One that the server is about to close looks like a server that is lost.
            .max_idle_age(Duration::from_secs(2))
            .timeout_resolve(Some(TO_REACH))
            .timeout_connect(Some(if is_encrypted { 2 * TO_REACH } else { TO_REACH }))
            .timeout_per_read(Some(TO_ANSWER))
            .timeout_per_write(Some(TO_ANSWER))
            .timeout_recv_response(Some(TO_ANSWER));
        // Whom the machine trusts is trusted, and nobody else.
        #[cfg(feature = "tls")]
        let config =
            config.tls_config(TlsConfig::builder().root_certs(RootCerts::PlatformVerifier).build());
        Self { agent: config.build().into(), address }
    }

    /// Whether the server answers; else why not.
    pub(crate) fn reach(&self) -> Result<(), String> {
        // Only in its answer to a GET a bucket says why it refuses.
        match self.address.bucket().map(|_| self.get("answers", 0, 0.0)) {
            Some(Answer::Fails(why)) => Err(why),
            Some(Answer::Is(_) | Answer::IsNot) => Ok(()),
            None => self.head("").map(drop),
        }
    }

    /// What is in the file of this name, at most `most` bytes, unless it takes longer than `worth` seconds.
    pub(super) fn get(&self, file: &str, most: u64, worth: f64) -> Answer {
        let request = self.signed(self.agent.get(self.address.of(file)), "GET", file);
        match request.call() {
            Ok(mut response) if response.status() != StatusCode::OK => {
                self.refusal(&mut response).map_or(Answer::IsNot, Answer::Fails)
            }
            Ok(response) => body(response, most, worth),
            Err(error) => Answer::Fails(in_words(&error)),
        }
    }

    /// How many bytes are in the file of this name, if there is one; why the server is of no use, if it is of none.
    pub(super) fn head(&self, file: &str) -> Result<Option<u64>, String> {
        let request = self.signed(self.agent.head(self.address.of(file)), "HEAD", file);
        let response = request.call().map_err(|error| in_words(&error))?;
        let status = response.status();
        if status == StatusCode::UNAUTHORIZED || status.is_server_error() {
            return Err(status.to_string());
        }
        Ok(response.body().content_length().filter(|_| status == StatusCode::OK))
    }

    /// Puts so many bytes into the file of this name.
    pub(super) fn put(&self, file: &str, length: u64, mut bytes: impl Read) -> Reply {
        let request = self.signed(self.agent.put(self.address.of(file)), "PUT", file);
        let request = request.header("Content-Length", length);
        let request = request.content_type("application/octet-stream").config();
        let request =
            request.timeout_recv_response(Some(TO_STORE)).timeout_per_read(Some(TO_STORE));
        match request.build().send(SendBody::from_reader(&mut bytes)) {
            Ok(response) if response.status().is_success() => Reply::Took,
            Ok(mut response) => {
                let status = response.status();
                reply(status, self.refusal(&mut response).unwrap_or_else(|| status.to_string()))
            }
            Err(error) => Reply::Fails(in_words(&error)),
        }
    }

    /// A request with what is said of who one is.
    fn signed<B>(&self, request: RequestBuilder<B>, method: &str, file: &str) -> RequestBuilder<B> {
        let headers = self.address.headers(method, file).into_iter();
        headers.fold(request, |request, (name, value)| request.header(name, value))
    }

    /// Why the server refuses what it was asked for; none if it has no such thing, or has it elsewhere.
    fn refusal(&self, response: &mut Response<Body>) -> Option<String> {
        let status = response.status();
        let Some(bucket) = self.address.bucket() else {
            let is_none = [StatusCode::NOT_FOUND, StatusCode::GONE, StatusCode::NO_CONTENT];
            let is_absent = status.is_redirection() || is_none.contains(&status);
            return (!is_absent).then(|| status.to_string());
        };
        let mut said = Vec::new();
        // What cannot be read says nothing.
        let _ = response.body_mut().as_reader().take(MOST_WORDS).read_to_end(&mut said);
        let region = response.headers().get("x-amz-bucket-region");
        let region = region.and_then(|region| region.to_str().ok());
        bucket.refusal(status, region, &String::from_utf8_lossy(&said))
    }
}

/// Why nothing was taken.
fn reply(status: StatusCode, why: String) -> Reply {
    match status {
        StatusCode::PAYLOAD_TOO_LARGE => Reply::TooLarge,
        StatusCode::INSUFFICIENT_STORAGE => Reply::Refuses(why),
        it if it.is_server_error() => Reply::Fails(why),
        _ => Reply::Refuses(why),
    }
}

fn body(mut response: Response<Body>, most: u64, worth: f64) -> Answer {
    let told = response.body().content_length();
    if told.is_some_and(|told| most < told) {
        return Answer::IsNot;
    }
    let start = Instant::now();
    let (mut bytes, mut part) = (Vec::new(), vec![0; 64 << 10]);
    let mut reader = response.body_mut().with_config().limit(u64::MAX).reader();
    loop {
        let read = match reader.read(&mut part) {
            Ok(0) => return Answer::Is(bytes),
            Ok(read) => read,
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Answer::IsNot,
            Err(error) => return Answer::Fails(in_words(&Error::from(error))),
        };
        bytes.extend_from_slice(&part[..read]);
        let (now, elapsed) = (bytes.len() as u64, start.elapsed().as_secs_f64());
        if most < now {
            return Answer::IsNot;
        }
        // At this speed, all of it would be here after so long.
        let expected = told.map_or(f64::INFINITY, |told| elapsed * told as f64 / now as f64);
        if PATIENCE < elapsed && worth.max(PATIENCE) < expected {
            return Answer::Fails("it is slower than computing".into());
        }
    }
}

/// Why a request failed; without the address, which may name who one is.
fn in_words(error: &Error) -> String {
    match error {
        Error::Timeout(_) => "it does not answer in time".into(),
        Error::HostNotFound => "there is no such host".into(),
        Error::Io(error) if error.kind() == io::ErrorKind::TimedOut => {
            "it does not answer in time".into()
        }
        Error::Io(error) => match error.get_ref().and_then(|error| error.downcast_ref()) {
            Some(error) => in_words(error),
            None => error.to_string(),
        },
        error => error.to_string(),
    }
}
