//! The HTTP server of the live page. It serves the files of the page, and one WebSocket for each open page.
//!
//! Without protection, any website that the user visits could read the user's files through this server. So the server listens only on the
//! loopback address. It answers only requests whose `Host` header is that address, which prevents DNS rebinding. It opens a WebSocket only
//! for its own page, which knows the secret token in the URL.
//!
//! `axum` runs on a single thread. Requests for columns need no token: the names of columns are hashes, which only authorized pages know.

use std::future::pending;
use std::net::TcpListener;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use std::{io, thread};

use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, Query, Request, State};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use connections::Lease;
use maquette_format::png;
use maquette_render as render;
use maquette_render::{Look, OwnedBackdrop, Representation, View};
use serde::Deserialize;
use serde_json::{Value as Json, json};
use tokio::task::JoinHandle;

use super::event_log::MissedEventsError;
use super::gpu_columns::changes;
use super::pick::PickRay;
use super::{Location, PageRequest, PageState, Question, QuestionKind, ViewedOutput, Views};

mod connections;

/// The files of the page. Each is a triple of URL path, content type and content.
const FILES: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("web/index.html")),
    ("/icon.svg", "image/svg+xml", include_str!("web/icon.svg")),
    ("/page.css", "text/css; charset=utf-8", include_str!("web/page.css")),
    ("/page.js", SCRIPT, include_str!("web/page.js")),
    ("/element.js", SCRIPT, include_str!("web/element.js")),
    ("/broken.js", SCRIPT, include_str!("web/broken.js")),
    ("/graph.js", SCRIPT, include_str!("web/graph.js")),
    ("/parameters.js", SCRIPT, include_str!("web/parameters.js")),
    ("/profile.js", SCRIPT, include_str!("web/profile.js")),
    ("/viewer.js", SCRIPT, include_str!("web/viewer.js")),
    ("/camera.js", SCRIPT, include_str!("web/camera.js")),
    ("/columns.js", SCRIPT, include_str!("web/columns.js")),
    ("/scene.js", SCRIPT, include_str!("web/scene.js")),
    ("/painter.js", SCRIPT, include_str!("web/painter.js")),
    ("/plot.js", SCRIPT, include_str!("web/plot.js")),
    ("/pointer.js", SCRIPT, include_str!("web/pointer.js")),
    ("/tools.js", SCRIPT, include_str!("web/tools.js")),
    ("/socket.js", SCRIPT, include_str!("web/socket.js")),
];

const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The content security policy of the page, which allows only the page's own files.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
                      worker-src 'self'; base-uri 'none'; form-action 'none'; \
                      require-trusted-types-for 'script'; trusted-types 'none'";

/// The content security policy for embedding the page in a frame: no site may embed it.
const NO_FRAMES: &str = "'none'";

/// The sites that may embed the page in a frame when the page is opened in an editor.
const EDITORS: &str =
    "vscode-webview: vscode-file: https://*.vscode-cdn.net http://127.0.0.1:* http://localhost:*";

const HEADERS: [(HeaderName, &str); 6] = [
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-embedder-policy"), "require-corp"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
];

/// The name of the WebSocket subprotocol. The page sends the token as a second subprotocol name.
const PROTOCOL: &str = "maquette";

/// The maximum size in bytes of a message that a page sends.
const MAX_MESSAGE_BYTES: usize = 1 << 20;

/// The maximum number of values that one page can show at the same time.
const MAX_VIEWS: usize = 16;

/// The maximum width and height, in pixels, of a picture that the server renders.
const MAX_PIXELS: usize = 4096;

/// The maximum time for sending a message to a page.
const SEND_TIMEOUT: Duration = Duration::from_secs(20);

/// Returns the hash of the page's files. An open page compares it with the hash of its own files to notice that it is out of date.
pub(super) fn version() -> &'static str {
    static VERSION: LazyLock<String> = LazyLock::new(|| {
        let mut hasher = blake3::Hasher::new();
        for (path, _, content) in FILES {
            for part in [path, content] {
                hasher.update(&part.len().to_le_bytes()).update(part.as_bytes());
            }
        }
        hasher.finalize().to_hex()[..16].to_owned()
    });
    &VERSION
}

/// Inserts the hash of the page's files into `index.html`.
fn index(content: &str) -> String {
    let place = "<meta name=\"page\" content=\"\">";
    content.replace(place, &format!("<meta name=\"page\" content=\"{}\">", version()))
}

/// Starts the server in a thread that runs until the program ends.
pub(super) fn start(listener: TcpListener, shared: Arc<PageState>) -> io::Result<()> {
    listener.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let serve = async move {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        connections::serve(listener, router(shared)).await;
        io::Result::Ok(())
    };
    thread::Builder::new().name("page".into()).spawn(move || runtime.block_on(serve))?;
    Ok(())
}

fn router(shared: Arc<PageState>) -> Router {
    let mut router = Router::new()
        .route("/socket", get(open))
        .route("/picture/{hash}", get(picture))
        .route("/facts/{hash}", get(facts))
        .route("/column/{name}", get(column));
    for &(path, kind, content) in FILES {
        let content = if path == "/" { index(content) } else { content.to_owned() };
        let answer = ([(header::CONTENT_TYPE, kind)], content);
        router = router.route(path, get(move || async move { answer }));
    }
    router.layer(middleware::from_fn_with_state(shared.clone(), guard)).with_state(shared)
}

/// Rejects requests with a wrong `Host` header, and adds the common headers to all answers.
async fn guard(
    State(shared): State<Arc<PageState>>,
    Extension(lease): Extension<Arc<Lease>>,
    request: Request,
    next: Next,
) -> Response {
    let _answering = lease.answering();
    let host = text_of(request.headers(), &header::HOST);
    let is_own = host.is_some_and(|host| shared.names().iter().any(|name| name == host));
    let mut response = match is_own {
        true => next.run(request).await,
        false => {
            (StatusCode::FORBIDDEN, "this page is only served to this machine\n").into_response()
        }
    };
    let framed_by = if shared.in_editor { EDITORS } else { NO_FRAMES };
    let policy = format!("{POLICY}; frame-ancestors {framed_by}");
    for (name, value) in HEADERS.into_iter().chain([(header::CONTENT_SECURITY_POLICY, &policy[..])])
    {
        response.headers_mut().insert(name, value.parse().expect("a constant of visible letters"));
    }
    response
}

/// Opens the WebSocket of a page, if the origin and the token of the request are right.
async fn open(
    State(shared): State<Arc<PageState>>,
    Extension(lease): Extension<Arc<Lease>>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let origin =
        text_of(&headers, &header::ORIGIN).and_then(|origin| origin.strip_prefix("http://"));
    let is_own = origin.is_some_and(|origin| shared.names().iter().any(|name| name == origin));
    let offered = text_of(&headers, &header::SEC_WEBSOCKET_PROTOCOL).unwrap_or_default();
    let knows = offered.split(',').any(|word| is_same(word.trim(), &shared.token));
    if !is_own || !knows {
        return (StatusCode::FORBIDDEN, "open the link that the watch has printed\n")
            .into_response();
    }
    let upgrade = upgrade
        .protocols([PROTOCOL])
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_frame_size(MAX_MESSAGE_BYTES);
    lease.belongs_to_page();
    upgrade.on_upgrade(move |socket| async move {
        static SOCKETS: AtomicU64 = AtomicU64::new(0);
        let number = SOCKETS.fetch_add(1, Ordering::Relaxed);
        let _gone = serve(socket, number, &shared).await;
        shared.set_views(number, Views::new());
        (shared.on_request)(PageRequest::EndDrag(number));
        drop(lease);
    })
}

/// The query parameters of a request for a picture.
#[derive(Deserialize)]
struct PictureRequest {
    width: usize,
    height: usize,
    yaw: f64,
    pitch: f64,
    zoom: f64,
    /// True for the flat picture of the value, false for a 3D view.
    flat: bool,
}

/// Returns a picture of a value, as `maquette render` draws it.
async fn picture(
    State(shared): State<Arc<PageState>>,
    Path(hash): Path<String>,
    Query(request): Query<PictureRequest>,
) -> Response {
    let Some(shown) = shared.value(&hash) else { return not_viewed() };
    fn side(size: usize) -> usize {
        size.clamp(1, MAX_PIXELS)
    }
    let PictureRequest { yaw, pitch, zoom, flat, .. } = request;
    let size = [side(request.width), side(request.height)];
    let view = View { size, yaw, pitch, zoom, ..View::front() };
    let kind = if flat { Representation::Fitted } else { Representation::Space };
    match tokio::task::spawn_blocking(move || {
        let below = shown.ground.as_ref().and_then(OwnedBackdrop::backdrop);
        let picture = render::picture(
            &shown.layers(),
            &Look { view, representation: kind, backdrop: below },
        )?;
        png::encode_rgb(&picture).ok()
    })
    .await
    {
        Ok(Some(bytes)) => ([(header::CONTENT_TYPE, "image/png")], bytes).into_response(),
        _ => (StatusCode::NOT_FOUND, "the value has no picture\n").into_response(),
    }
}

/// Returns the facts about a value, as `maquette inspect` prints them: rows of labels and texts.
async fn facts(State(shared): State<Arc<PageState>>, Path(hash): Path<String>) -> Response {
    let Some(shown) = shared.value(&hash) else { return not_viewed() };
    match tokio::task::spawn_blocking(move || {
        let facts = shown.value.describe();
        Json::from_iter(facts.0.iter().map(|(label, fact)| json!([label, fact]))).to_string()
    })
    .await
    {
        Ok(text) => ([(header::CONTENT_TYPE, "application/json")], text).into_response(),
        Err(_) => {
            (StatusCode::INTERNAL_SERVER_ERROR, "the value cannot be described\n").into_response()
        }
    }
}

/// The query parameters of a request for a column: the name of the older version that the page already has.
#[derive(Deserialize)]
struct ColumnRequest {
    from: Option<String>,
}

/// Returns the bytes of a column. If the page has an older version and the changes are smaller than the column, returns only the changes.
async fn column(
    State(shared): State<Arc<PageState>>,
    Path(name): Path<String>,
    Query(had): Query<ColumnRequest>,
) -> Response {
    let Some(new) = shared.column(&name) else { return not_viewed() };
    let old = had.from.and_then(|from| shared.column(&from));
    match tokio::task::spawn_blocking(move || {
        let new = new.bytes();
        let changes = old.and_then(|old| changes(&old.bytes(), &new));
        match changes {
            Some(changes) => (CHANGES, changes.into()),
            None => ("application/octet-stream", new),
        }
    })
    .await
    {
        Ok((kind, bytes)) => ([(header::CONTENT_TYPE, kind)], bytes).into_response(),
        Err(_) => {
            (StatusCode::INTERNAL_SERVER_ERROR, "the column cannot be computed\n").into_response()
        }
    }
}

/// The content type of an answer with only the changes of a column.
const CHANGES: &str = "application/x-maquette-changes";

fn not_viewed() -> Response {
    (StatusCode::NOT_FOUND, "no page views this value\n").into_response()
}

/// Sends the current state and then every new message to a page, until the page disconnects or stops reading.
async fn serve(
    mut socket: WebSocket,
    number: u64,
    shared: &Arc<PageState>,
) -> Result<(), DisconnectError> {
    let (mut due, mut news) = shared.listen();
    let mut desk = QuestionQueue::default();
    loop {
        for text in due.drain(..) {
            let sent = socket.send(Message::Text((*text).into()));
            tokio::time::timeout(SEND_TIMEOUT, sent)
                .await
                .map_err(|_| DisconnectError)?
                .map_err(|_| DisconnectError)?;
        }
        tokio::select! {
            told = news.next() => match told {
                Ok(text) => due.push(text),
                Err(MissedEventsError) => (due, news) = shared.listen(),
            },
            heard = socket.recv() => match heard {
                None | Some(Err(_) | Ok(Message::Close(_))) => return Ok(()),
                Some(Ok(Message::Text(text))) => {
                    if let Some(question) = hear(&text, number, shared) {
                        desk.ask(question, shared);
                    }
                }
                Some(Ok(_)) => {}
            },
            answer = desk.answer(shared) => due.extend(answer),
        }
    }
}

/// A message from a page. Messages of unknown kinds are ignored, because a page of a newer version may send them.
#[derive(Deserialize)]
#[serde(tag = "ask", rename_all = "lowercase")]
enum ClientMessage {
    /// The page reports which outputs it shows now.
    Views {
        views: Views,
    },
    Set {
        values: Vec<(String, String)>,
    },
    Undo,
    Open {
        node: Option<String>,
        problem: Option<Location>,
    },
    Drag {
        values: Vec<(String, String)>,
    },
    Drop,
    Probe {
        id: u64,
        node: String,
        output: String,
        at: [usize; 2],
    },
    Pick {
        id: u64,
        node: String,
        output: String,
        #[serde(flatten)]
        sight: PickRay,
    },
}

/// Handles a message from a page. If the message is a question, returns the question to be answered.
fn hear(text: &str, socket: u64, shared: &PageState) -> Option<Question> {
    match serde_json::from_str(text) {
        Ok(ClientMessage::Views { mut views }) => {
            while views.len() > MAX_VIEWS {
                views.pop_last();
            }
            shared.set_views(socket, views);
        }
        Ok(ClientMessage::Set { values }) => (shared.on_request)(PageRequest::Set(socket, values)),
        Ok(ClientMessage::Drag { values }) => {
            (shared.on_request)(PageRequest::Drag(socket, values));
        }
        Ok(ClientMessage::Drop) => (shared.on_request)(PageRequest::EndDrag(socket)),
        Ok(ClientMessage::Undo) => (shared.on_request)(PageRequest::Undo),
        Ok(ClientMessage::Open { node, problem }) => {
            let node = node.and_then(|name| shared.box_location(&name));
            let problem = problem.filter(|place| shared.has_problem_at(place));
            match node.or(problem) {
                Some(place) => (shared.on_request)(PageRequest::Open(place)),
                None => shared.send(
                    &json!({ "event": "refused", "why": "the graph has no such location now" }),
                ),
            }
        }
        Ok(ClientMessage::Probe { id, node, output, at }) => {
            let viewed = ViewedOutput { node, output };
            return Some(Question { id, viewed, about: QuestionKind::Pixel(at) });
        }
        Ok(ClientMessage::Pick { id, node, output, sight }) => {
            let viewed = ViewedOutput { node, output };
            return Some(Question { id, viewed, about: QuestionKind::Sight(sight) });
        }
        Err(_) => {}
    }
    None
}

/// The waiting questions of one page. They are answered one at a time in a separate thread. Only the latest question of each kind waits; a
/// newer one replaces it.
#[derive(Default)]
struct QuestionQueue {
    probe: Option<Question>,
    pick: Option<Question>,
    answering: Option<JoinHandle<Json>>,
}

impl QuestionQueue {
    fn ask(&mut self, question: Question, shared: &Arc<PageState>) {
        match question.about {
            QuestionKind::Pixel(_) => self.probe = Some(question),
            QuestionKind::Sight(_) => self.pick = Some(question),
        }
        self.start_next(shared);
    }

    /// Starts to answer the next question, unless a question is already being answered.
    fn start_next(&mut self, shared: &Arc<PageState>) {
        if self.answering.is_none()
            && let Some(question) = self.pick.take().or_else(|| self.probe.take())
        {
            let shared = shared.clone();
            self.answering = Some(tokio::task::spawn_blocking(move || shared.answer(&question)));
        }
    }

    /// Waits for the answer to the current question. Returns `None` if computing it failed. Dropping the future does not lose the answer.
    async fn answer(&mut self, shared: &Arc<PageState>) -> Option<Arc<str>> {
        let Some(answering) = &mut self.answering else { return pending().await };
        let answer = answering.await;
        self.answering = None;
        self.start_next(shared);
        answer.ok().map(|answer| answer.to_string().into())
    }
}

/// The error that a page has disconnected.
struct DisconnectError;

impl PageState {
    /// Returns the accepted values of the `Host` header.
    fn names(&self) -> [String; 2] {
        let port = self.address.port();
        [format!("127.0.0.1:{port}"), format!("localhost:{port}")]
    }
}

fn text_of<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Option<&'h str> {
    headers.get(name)?.to_str().ok()
}

/// Compares two texts in constant time, so that the time does not reveal where a wrong token differs from the right one.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}
