//! Exchanges messages with the editor over stdin and stdout. A message that violates the protocol is answered with an error, and reading
//! continues at the next header.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write, stdin, stdout};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use crossbeam_channel::select;
use lsp_server::{Connection, ErrorCode, Message, Notification, Request, RequestId, Response};
use maquette_engine::writing;
use serde_json::{Map, Value as Json, json};

/// The maximum length of a message in bytes, larger than any text that an editor opens.
const MAX_BYTES: u64 = 1 << 28;

/// The maximum length of a header line in bytes. A longer line is not a header. Only the end of such a line is kept, because a header may
/// begin there.
const MAX_LINE: usize = 4096;

/// The maximum number of messages that are read ahead. The server searches them for requests to cancel.
const QUEUE: usize = 256;

/// The header that gives the length of each message.
const LENGTH: &[u8] = b"content-length:";

/// The start of the text that replaces a request id which [`RequestId`] cannot represent, such as `null` or a number of more than 32 bits.
const OTHER_ID: &str = "maquette-json-id ";

/// The threads that read and write the messages of a connection.
pub struct Threads {
    writer: JoinHandle<io::Result<()>>,
}

impl Threads {
    /// Waits until all messages are written. Does not wait for the reading thread, because another process may keep stdin open.
    ///
    /// # Errors
    /// If stdout cannot be written.
    pub fn join(self) -> io::Result<()> {
        self.writer.join().unwrap_or(Ok(()))
    }
}

/// Opens a connection over stdin and stdout. If `log` is given, each message is also written to that file.
///
/// # Errors
/// If the log file cannot be created.
pub fn stdio(log: Option<&Path>) -> io::Result<(Connection, Threads)> {
    let log = MessageLog::new(log)?;
    let (to_server, receiver) = crossbeam_channel::bounded(QUEUE);
    let (sender, to_editor) = crossbeam_channel::unbounded::<Message>();
    // Give the reader thread its own channel for errors. The reader thread may outlive the server, and would keep the server's channel open
    // if it used that channel.
    let (errors, refusals) = crossbeam_channel::unbounded();
    let reader_log = log.clone();
    std::thread::spawn(move || {
        let mut frames = Frames { input: BufReader::new(stdin()), is_lost: false };
        // The loop ends when stdin ends, which means that the editor has ended.
        while let Ok(Some(frame)) = frames.next() {
            let message = frame.map_err(|why| refusal(Json::Null, ErrorCode::ParseError, why));
            match message.and_then(|body| message_of(&body, &reader_log)) {
                Ok(Some(message)) => {
                    let is_exit =
                        matches!(&message, Message::Notification(it) if it.method == "exit");
                    if to_server.send(message).is_err() || is_exit {
                        return;
                    }
                }
                Ok(None) => {}
                Err(refusal) => drop(errors.send(Message::Response(*refusal))),
            }
        }
    });
    let writer = std::thread::spawn(move || {
        let mut out = stdout().lock();
        loop {
            select! {
                recv(to_editor) -> message => match message {
                    Ok(message) => write(&mut out, &message, &log)?,
                    Err(_) => break,
                },
                recv(refusals) -> refusal => match refusal {
                    Ok(refusal) => write(&mut out, &refusal, &log)?,
                    Err(_) => return to_editor.iter().try_for_each(|it| write(&mut out, &it, &log)),
                },
            }
        }
        refusals.try_iter().try_for_each(|refusal| write(&mut out, &refusal, &log))
    });
    Ok((Connection { sender, receiver }, Threads { writer }))
}

/// Converts the id of a request, which may be any JSON value, to a [`RequestId`].
pub(super) fn id_of(id: &Json) -> RequestId {
    let number = id.as_i64().and_then(|id| i32::try_from(id).ok());
    match (number, id) {
        (Some(id), _) => id.into(),
        (None, Json::String(id)) => id.clone().into(),
        (None, other) => format!("{OTHER_ID}{other}").into(),
    }
}

fn refusal(id: Json, code: ErrorCode, why: String) -> Box<Response> {
    Box::new(Response::new_err(id_of(&id), code as i32, why))
}

/// Splits a stream of bytes into the bodies of messages.
struct Frames<R> {
    input: R,
    /// True after a protocol error. The error has been returned, and the input is being skipped up to the next header.
    is_lost: bool,
}

impl<R: BufRead> Frames<R> {
    /// Returns the body of the next message, or an error message if the input violates the protocol. Returns `None` at the end of the
    /// input.
    fn next(&mut self) -> io::Result<Option<Result<Vec<u8>, String>>> {
        let (mut length, mut has_header) = (None, false);
        loop {
            // Reject a message without a header at once, instead of waiting for the end of the line, which may never come.
            if !self.is_lost
                && !has_header
                && self.input.fill_buf()?.first().is_some_and(|first| b"{[".contains(first))
            {
                return Ok(Some(self.fail("expected `Content-Length: N`, found a message")));
            }
            let Some(line) = self.line()? else { return Ok(None) };
            let line = line.trim_ascii();
            let header = line.to_ascii_lowercase();
            if let Some(at) = header.windows(LENGTH.len()).rposition(|part| part == LENGTH) {
                let number = String::from_utf8_lossy(line[at + LENGTH.len()..].trim_ascii());
                match number.parse::<u64>() {
                    Ok(bytes) if bytes <= MAX_BYTES => {
                        (length, has_header, self.is_lost) = (Some(bytes), true, false);
                    }
                    _ if self.is_lost => {}
                    Ok(_) => {
                        let why = format!("expected at most {MAX_BYTES} bytes, found {number}");
                        return Ok(Some(self.fail(&why)));
                    }
                    Err(_) => {
                        let why = format!("expected `Content-Length: N`, found `{number}`");
                        return Ok(Some(self.fail(&why)));
                    }
                }
            } else if !line.is_empty() {
                has_header = true;
                if !line.contains(&b':') && !self.is_lost && length.is_none() {
                    return Ok(Some(self.fail("expected `Content-Length: N`, found other text")));
                }
            } else if let Some(bytes) = length {
                let mut body = Vec::new();
                (&mut self.input).take(bytes).read_to_end(&mut body)?;
                return Ok((body.len() as u64 == bytes).then_some(Ok(body)));
            } else if has_header && !self.is_lost {
                return Ok(Some(self.fail("expected `Content-Length: N`, found no such header")));
            }
        }
    }

    fn fail(&mut self, why: &str) -> Result<Vec<u8>, String> {
        self.is_lost = true;
        Err(why.to_owned())
    }

    /// Reads the next line. If the line is longer than [`MAX_LINE`], only its end is returned.
    fn line(&mut self) -> io::Result<Option<Vec<u8>>> {
        let mut line = Vec::new();
        loop {
            let count = (&mut self.input).take(MAX_LINE as u64).read_until(b'\n', &mut line)?;
            if count == 0 {
                return Ok((!line.is_empty()).then_some(line));
            }
            if line.ends_with(b"\n") {
                return Ok(Some(line));
            }
            line.drain(..line.len().saturating_sub(MAX_LINE));
        }
    }
}

/// Parses the body of a message. Returns `None` for an answer to a request that the server did not send. Returns an error response if the
/// body is not a message.
fn message_of(body: &[u8], log: &MessageLog) -> Result<Option<Message>, Box<Response>> {
    let text = String::from_utf8_lossy(body);
    log.write("editor", &text);
    let text = text.trim_start_matches('\u{feff}');
    let parsed = serde_json::from_str(text);
    let parsed = parsed
        .or_else(|error| serde_json::from_str(&without_lone_surrogates(text)).map_err(|_| error));
    let json = parsed
        .map_err(|error| refusal(Json::Null, ErrorCode::ParseError, format!("no JSON: {error}")))?;
    fn invalid(id: Json, why: &str) -> Result<Option<Message>, Box<Response>> {
        Err(refusal(id, ErrorCode::InvalidRequest, why.into()))
    }
    let Json::Object(mut fields) = json else {
        return invalid(Json::Null, "expected one message, an object");
    };
    let (id, params) = (fields.remove("id"), fields.remove("params").unwrap_or_default());
    match (fields.remove("method"), id) {
        (Some(Json::String(method)), Some(id)) => {
            Ok(Some(Request { id: id_of(&id), method, params }.into()))
        }
        (Some(Json::String(method)), None) => {
            Ok(Some(Message::Notification(Notification { method, params })))
        }
        (None, id) if fields.contains_key("result") || fields.contains_key("error") => {
            Ok(answer(id, &mut fields))
        }
        (_, id) => invalid(id.unwrap_or_default(), "expected a message with a `method`"),
    }
}

fn answer(id: Option<Json>, fields: &mut Map<String, Json>) -> Option<Message> {
    let id = id_of(&id.filter(|id| !id.is_null())?);
    let result = fields.remove("result").filter(|_| !fields.contains_key("error"));
    Some(match result {
        Some(result) => Response::new_ok(id, result).into(),
        None => {
            let why = fields["error"]["message"].as_str().unwrap_or_default().to_owned();
            Response::new_err(id, ErrorCode::RequestFailed as i32, why).into()
        }
    })
}

/// Replaces each unpaired surrogate such as `\ud83d` by `\ufffd`. Some editors send these while the user types.
fn without_lone_surrogates(json: &str) -> String {
    let mut new = String::with_capacity(json.len());
    let mut rest = json;
    fn unit(text: &str) -> Option<u16> {
        let digits = text.strip_prefix("\\u")?.get(..4)?;
        u16::from_str_radix(digits, 16).ok()
    }
    while let Some(at) = rest.find('\\') {
        new += &rest[..at];
        rest = &rest[at..];
        let length = match unit(rest) {
            Some(0xd800..0xdc00) if matches!(unit(&rest[6..]), Some(0xdc00..0xe000)) => 12,
            Some(0xd800..0xe000) => {
                new += "\\ufffd";
                rest = &rest[6..];
                continue;
            }
            _ => 1 + rest[1..].chars().next().map_or(0, char::len_utf8),
        };
        new += &rest[..length];
        rest = &rest[length..];
    }
    new + rest
}

fn write(out: &mut impl Write, message: &Message, log: &MessageLog) -> io::Result<()> {
    let has_other_id =
        matches!(message, Message::Response(it) if it.id.to_string().contains(OTHER_ID));
    if !has_other_id && log.0.is_none() {
        return message.write(out);
    }
    let mut json = serde_json::to_value(message).map_err(io::Error::other)?;
    json["jsonrpc"] = json!("2.0");
    let other = json["id"].as_str().and_then(|id| id.strip_prefix(OTHER_ID));
    if let Some(id) = other.and_then(|id| serde_json::from_str(id).ok()) {
        json["id"] = id;
    }
    let body = json.to_string();
    log.write("server", &body);
    write!(out, "Content-Length: {}\r\n\r\n{body}", body.len())?;
    out.flush()
}

/// A log file with a line for each message. Each line begins with the time in seconds since the start.
#[derive(Clone)]
struct MessageLog(Option<Arc<Mutex<(Instant, File)>>>);

impl MessageLog {
    fn new(path: Option<&Path>) -> io::Result<Self> {
        let file = path.map(writing::open_log).transpose()?;
        Ok(Self(file.map(|file| Arc::new(Mutex::new((Instant::now(), file))))))
    }

    fn write(&self, who: &str, message: &str) {
        if let Some(log) = &self.0 {
            let mut log = log.lock().unwrap_or_else(PoisonError::into_inner);
            let seconds = log.0.elapsed().as_secs_f64();
            let line = message.replace(['\n', '\r'], " ");
            // Ignore a write error: the log must not prevent the server from answering.
            let _ = writeln!(log.1, "{seconds:.3} {who}: {line}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the message bodies in the input, and `!` for each protocol error.
    fn read(input: &str) -> Vec<String> {
        let mut frames = Frames { input: input.as_bytes(), is_lost: false };
        let bodies = std::iter::from_fn(|| {
            frames.next().unwrap().map(|it| it.unwrap_or_else(|_| b"!".to_vec()))
        })
        .map(|body| String::from_utf8(body).unwrap());
        bodies.collect()
    }

    #[test]
    fn every_broken_header_is_one_error_and_the_next_message_is_read() {
        const NEXT: &str = "Content-Length: 2\r\n\r\n{}";
        for broken in [
            "X: 1\r\n\r\n{\"a\": 1}",
            "{\"a\": \"Content-Length: 5\\r\\n\"}",
            "[1]\n",
            "Content-Length: 99999999999999\r\n\r\n{}",
            "Content-Length: 99999999999999999999999\r\n\r\n{}",
            "Content-Length: -3\r\n\r\n{}",
            "Content-Length: \r\n\r\n{}",
            "content-length: two\nX: 1\n\n{\n\n}\n",
            "words\n\n",
        ] {
            assert_eq!(
                read(&format!("{NEXT}{broken}{NEXT}{NEXT}")),
                ["{}", "!", "{}", "{}"],
                "{broken}"
            );
        }
        let long = format!("{{{}", "x".repeat(3 * MAX_LINE));
        assert_eq!(read(&format!("{long}{NEXT}")), ["!", "{}"]);
    }

    #[test]
    fn headers_may_come_in_any_order_and_case() {
        let other = "content-type: x\ncontent-LENGTH:2 \n\n{}\r\n\r\n";
        assert_eq!(read(&format!("{other}{other}")), ["{}", "{}"]);
        // Ignore an incomplete message at the end of the input.
        assert_eq!(read("Content-Length: 9\r\n\r\n{}"), Vec::<String>::new());
    }

    #[test]
    fn ids_survive_a_round_trip() {
        for id in ["1", "\"a\"", "1.0", "5000000000", "null", "{\"a\":1}", "-7"] {
            let body = format!("{{\"id\": {id}, \"method\": \"x\"}}");
            let message = message_of(body.as_bytes(), &MessageLog(None)).unwrap().unwrap();
            let Message::Request(request) = message else { panic!("{message:?}") };
            let mut out = Vec::new();
            write(&mut out, &Response::new_ok(request.id, ()).into(), &MessageLog(None)).unwrap();
            let out = String::from_utf8(out).unwrap();
            assert!(out.contains(&format!("\"id\":{id}")), "{out}");
        }
    }

    #[test]
    fn invalid_messages_are_rejected_with_their_id() {
        fn code(body: &str) -> (RequestId, i32) {
            match message_of(body.as_bytes(), &MessageLog(None)) {
                Err(answer) => (answer.id, answer.response_result.unwrap_err().code),
                other => panic!("{body}: {other:?}"),
            }
        }
        let null = id_of(&Json::Null);
        assert_eq!(code("{abc}"), (null.clone(), -32700));
        assert_eq!(code(""), (null.clone(), -32700));
        assert_eq!(code(&"[".repeat(100_000)), (null.clone(), -32700));
        assert_eq!(code("[]"), (null.clone(), -32600));
        assert_eq!(code("{}"), (null, -32600));
        assert_eq!(code("{\"id\": 3, \"method\": 4}"), (3.into(), -32600));
        // These are answers to requests that the server did not send; they are ignored.
        for body in ["{\"id\": null, \"error\": {}}", "{\"error\": 3}"] {
            assert!(message_of(body.as_bytes(), &MessageLog(None)).unwrap().is_none(), "{body}");
        }
    }

    #[test]
    fn unpaired_surrogates_are_replaced() {
        let body = r#"{"method": "x", "params": ["\ud83d", "\\ud83d", "\ud83d\ude00\udc00a"]}"#;
        let message = message_of(body.as_bytes(), &MessageLog(None)).unwrap().unwrap();
        let Message::Notification(told) = message else { panic!("{message:?}") };
        assert_eq!(told.params, json!(["\u{fffd}", "\\ud83d", "\u{1f600}\u{fffd}a"]));
    }
}
