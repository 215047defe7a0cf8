//! What is said to a server: GET, PUT and HEAD, none of which is waited for long.

use std::io::{self, Read};
use std::time::{Duration, Instant};

use ureq::http::{Response, StatusCode};
use ureq::{Agent, Body, Error, RequestBuilder, SendBody};

use super::address::Address;

/// How long it may take to find the server, and then to reach it.
const TO_REACH: Duration = Duration::from_millis(300);

/// How long the server may take to begin its answer, and may stop in the middle of it.
const TO_ANSWER: Duration = Duration::from_millis(500);

/// How long it may take to say what became of what it was sent, which nobody waits for.
const TO_STORE: Duration = Duration::from_secs(5);

/// How many seconds an answer may take whatever it is worth.
const PATIENCE: f64 = 0.5;

pub(super) struct Client {
    agent: Agent,
    authorization: Option<String>,
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
    pub(super) fn new(address: &Address) -> Self {
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
            .timeout_connect(Some(TO_REACH))
            .timeout_per_read(Some(TO_ANSWER))
            .timeout_per_write(Some(TO_ANSWER))
            .timeout_recv_response(Some(TO_ANSWER));
        let authorization = address.authorization().map(str::to_owned);
        Self { agent: config.build().into(), authorization }
    }

    /// What is at this address, at most `most` bytes, unless it takes longer than `worth` seconds.
    pub(super) fn get(&self, url: &str, most: u64, worth: f64) -> Answer {
        match self.authorized(self.agent.get(url)).call() {
            Ok(response) => body(response, most, worth),
            Err(error) => Answer::Fails(in_words(&error)),
        }
    }

    /// How many bytes are at this address, if anything is; why the server is of no use, if it is of none.
    pub(super) fn head(&self, url: &str) -> Result<Option<u64>, String> {
        let response = self.authorized(self.agent.head(url)).call();
        let response = response.map_err(|error| in_words(&error))?;
        let status = response.status();
        if status == StatusCode::UNAUTHORIZED || status.is_server_error() {
            return Err(status.to_string());
        }
        Ok(response.body().content_length().filter(|_| status == StatusCode::OK))
    }

    /// Puts so many bytes at this address.
    pub(super) fn put(&self, url: &str, length: u64, mut bytes: impl Read) -> Reply {
        let request = self.authorized(self.agent.put(url)).header("Content-Length", length);
        let request = request.content_type("application/octet-stream").config();
        let request =
            request.timeout_recv_response(Some(TO_STORE)).timeout_per_read(Some(TO_STORE));
        match request.build().send(SendBody::from_reader(&mut bytes)) {
            Ok(response) => reply(response.status()),
            Err(error) => Reply::Fails(in_words(&error)),
        }
    }

    fn authorized<B>(&self, request: RequestBuilder<B>) -> RequestBuilder<B> {
        match &self.authorization {
            Some(authorization) => request.header("Authorization", authorization),
            None => request,
        }
    }
}

fn reply(status: StatusCode) -> Reply {
    match status {
        it if it.is_success() => Reply::Took,
        StatusCode::PAYLOAD_TOO_LARGE => Reply::TooLarge,
        StatusCode::INSUFFICIENT_STORAGE => Reply::Refuses(status.to_string()),
        it if it.is_server_error() => Reply::Fails(status.to_string()),
        it => Reply::Refuses(it.to_string()),
    }
}

fn body(mut response: Response<Body>, most: u64, worth: f64) -> Answer {
    match response.status() {
        StatusCode::OK => {}
        it if it.is_redirection() => return Answer::IsNot,
        StatusCode::NOT_FOUND | StatusCode::GONE | StatusCode::NO_CONTENT => return Answer::IsNot,
        it => return Answer::Fails(it.to_string()),
    }
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
