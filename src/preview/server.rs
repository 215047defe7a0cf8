//! The server: the page's own files, and one socket for each page that is open.
//!
//! A program that shows a user's files to any browser that asks would show them to every site that the user visits. So it listens on this
//! machine's own address alone; answers only requests that were made to that address by name, which a site that had its name
//! rebound cannot; and opens a socket only to its own page, which knows the token of the link.
//!
//! `axum` answers on one thread. The name of a column is known only to pages that were told of the column.

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
use maquette_render::{Ground, Kind, Look, View};
use serde::Deserialize;
use serde_json::{Value as Json, json};
use tokio::task::JoinHandle;

use super::news::Missed;
use super::pick::Sight;
use super::shown::changes;
use super::{About, Location, Question, Shared, Viewed, Views, Wish};

mod connections;

/// The files of the page: path, type, content.
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

/// What the page may do: nothing but what it brings.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
                      worker-src 'self'; base-uri 'none'; form-action 'none'; \
                      require-trusted-types-for 'script'; trusted-types 'none'";

/// Who may show the page in a frame.
const NOBODY: &str = "'none'";

/// The same if an editor shows it.
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

/// The name of what is spoken over the socket; the token is offered beside it.
const PROTOCOL: &str = "maquette";

/// The largest message that a page may send.
const LARGEST: usize = 1 << 20;

/// The most values that a page can look at.
const MOST_VIEWS: usize = 16;

/// The longest side of a picture.
const MOST_PIXELS: usize = 4096;

/// A page that takes no message for so long is gone.
const PATIENCE: Duration = Duration::from_secs(20);

/// What the files of the page are, as a hash, by which a page of another program knows that it is out of date.
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

/// The first file, which says what the page is.
fn index(content: &str) -> String {
    let place = "<meta name=\"page\" content=\"\">";
    content.replace(place, &format!("<meta name=\"page\" content=\"{}\">", version()))
}

/// Serves until the program ends.
pub(super) fn start(listener: TcpListener, shared: Arc<Shared>) -> io::Result<()> {
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

fn router(shared: Arc<Shared>) -> Router {
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

/// Refuses what was not asked of this machine by its own name, and adds the headers that every answer has.
async fn guard(
    State(shared): State<Arc<Shared>>,
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
            (StatusCode::FORBIDDEN, "this page is served to this machine alone\n").into_response()
        }
    };
    let framed_by = if shared.in_editor { EDITORS } else { NOBODY };
    let policy = format!("{POLICY}; frame-ancestors {framed_by}");
    for (name, value) in HEADERS.into_iter().chain([(header::CONTENT_SECURITY_POLICY, &policy[..])])
    {
        response.headers_mut().insert(name, value.parse().expect("a constant of visible letters"));
    }
    response
}

/// Opens the socket of a page, if it is this server's own and knows the token.
async fn open(
    State(shared): State<Arc<Shared>>,
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
    let upgrade = upgrade.protocols([PROTOCOL]).max_message_size(LARGEST).max_frame_size(LARGEST);
    lease.belongs_to_page();
    upgrade.on_upgrade(move |socket| async move {
        static SOCKETS: AtomicU64 = AtomicU64::new(0);
        let number = SOCKETS.fetch_add(1, Ordering::Relaxed);
        let _gone = serve(socket, number, &shared).await;
        shared.look(number, Views::new());
        (shared.wish)(Wish::Drop(number));
        drop(lease);
    })
}

/// From where a picture is wanted.
#[derive(Deserialize)]
struct Asked {
    width: usize,
    height: usize,
    yaw: f64,
    pitch: f64,
    zoom: f64,
    /// Whether a value that is a picture is seen as one, not in space.
    flat: bool,
}

/// A picture of a value, as `maquette render` makes it.
async fn picture(
    State(shared): State<Arc<Shared>>,
    Path(hash): Path<String>,
    Query(asked): Query<Asked>,
) -> Response {
    let Some(shown) = shared.value(&hash) else { return nobody_looks() };
    fn side(size: usize) -> usize {
        size.clamp(1, MOST_PIXELS)
    }
    let Asked { yaw, pitch, zoom, flat, .. } = asked;
    let size = [side(asked.width), side(asked.height)];
    let view = View { size, yaw, pitch, zoom, ..View::front() };
    let kind = if flat { Kind::Fitted } else { Kind::Space };
    match tokio::task::spawn_blocking(move || {
        let below = shown.ground.as_ref().and_then(Ground::below);
        let picture = render::picture(&shown.layers(), &Look { view, kind, below })?;
        png::encode_rgb(&picture).ok()
    })
    .await
    {
        Ok(Some(bytes)) => ([(header::CONTENT_TYPE, "image/png")], bytes).into_response(),
        _ => (StatusCode::NOT_FOUND, "there is nothing to be seen of it\n").into_response(),
    }
}

/// What is to be known of a value: rows of labels and texts, as `maquette inspect` prints them.
async fn facts(State(shared): State<Arc<Shared>>, Path(hash): Path<String>) -> Response {
    let Some(shown) = shared.value(&hash) else { return nobody_looks() };
    match tokio::task::spawn_blocking(move || {
        let facts = shown.value.describe();
        Json::from_iter(facts.0.iter().map(|(label, fact)| json!([label, fact]))).to_string()
    })
    .await
    {
        Ok(text) => ([(header::CONTENT_TYPE, "application/json")], text).into_response(),
        Err(_) => (StatusCode::INTERNAL_SERVER_ERROR, "it cannot be described\n").into_response(),
    }
}

/// Which column a page has already.
#[derive(Deserialize)]
struct Had {
    from: Option<String>,
}

/// The bytes of a column; what has changed, if the page has another one and that is less.
async fn column(
    State(shared): State<Arc<Shared>>,
    Path(name): Path<String>,
    Query(had): Query<Had>,
) -> Response {
    let Some(new) = shared.column(&name) else { return nobody_looks() };
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
        Err(_) => (StatusCode::INTERNAL_SERVER_ERROR, "it cannot be made\n").into_response(),
    }
}

/// The type of an answer that says what has changed in a column.
const CHANGES: &str = "application/x-maquette-changes";

fn nobody_looks() -> Response {
    (StatusCode::NOT_FOUND, "nobody looks at such a value\n").into_response()
}

/// Tells a page what is true and then what happens, until it goes away or takes nothing any more.
async fn serve(mut socket: WebSocket, number: u64, shared: &Arc<Shared>) -> Result<(), Gone> {
    let (mut due, mut news) = shared.listen();
    let mut desk = Desk::default();
    loop {
        for text in due.drain(..) {
            let sent = socket.send(Message::Text((*text).into()));
            tokio::time::timeout(PATIENCE, sent).await.map_err(|_| Gone)?.map_err(|_| Gone)?;
        }
        tokio::select! {
            told = news.next() => match told {
                Ok(text) => due.push(text),
                Err(Missed) => (due, news) = shared.listen(),
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

/// What a page says. What is not understood may be of a newer page, and is skipped.
#[derive(Deserialize)]
#[serde(tag = "ask", rename_all = "lowercase")]
enum Said {
    /// It shows these values now.
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
        sight: Sight,
    },
}

/// Does what a page says; a question remains.
fn hear(text: &str, socket: u64, shared: &Shared) -> Option<Question> {
    match serde_json::from_str(text) {
        Ok(Said::Views { mut views }) => {
            while views.len() > MOST_VIEWS {
                views.pop_last();
            }
            shared.look(socket, views);
        }
        Ok(Said::Set { values }) => (shared.wish)(Wish::Set(socket, values)),
        Ok(Said::Drag { values }) => (shared.wish)(Wish::Drag(socket, values)),
        Ok(Said::Drop) => (shared.wish)(Wish::Drop(socket)),
        Ok(Said::Undo) => (shared.wish)(Wish::Undo),
        Ok(Said::Open { node, problem }) => {
            let node = node.and_then(|name| shared.place_of_box(&name));
            let problem = problem.filter(|place| shared.has_problem_at(place));
            match node.or(problem) {
                Some(place) => (shared.wish)(Wish::Open(place)),
                None => shared.tell(&json!({ "event": "refused", "why": "there is no such place in the graph now" })),
            }
        }
        Ok(Said::Probe { id, node, output, at }) => {
            let viewed = Viewed { node, output };
            return Some(Question { id, viewed, about: About::Pixel(at) });
        }
        Ok(Said::Pick { id, node, output, sight }) => {
            let viewed = Viewed { node, output };
            return Some(Question { id, viewed, about: About::Sight(sight) });
        }
        Err(_) => {}
    }
    None
}

/// The questions of a page: one is answered at a time, in a thread of its own, and of each kind the latest one waits.
#[derive(Default)]
struct Desk {
    probe: Option<Question>,
    pick: Option<Question>,
    answering: Option<JoinHandle<Json>>,
}

impl Desk {
    fn ask(&mut self, question: Question, shared: &Arc<Shared>) {
        match question.about {
            About::Pixel(_) => self.probe = Some(question),
            About::Sight(_) => self.pick = Some(question),
        }
        self.work(shared);
    }

    /// Begins with the next question, if none is being answered.
    fn work(&mut self, shared: &Arc<Shared>) {
        if self.answering.is_none()
            && let Some(question) = self.pick.take().or_else(|| self.probe.take())
        {
            let shared = shared.clone();
            self.answering = Some(tokio::task::spawn_blocking(move || shared.answer(&question)));
        }
    }

    /// The next answer, as soon as there is one; none if finding it failed. Whoever stops waiting for it loses nothing.
    async fn answer(&mut self, shared: &Arc<Shared>) -> Option<Arc<str>> {
        let Some(answering) = &mut self.answering else { return pending().await };
        let answer = answering.await;
        self.answering = None;
        self.work(shared);
        answer.ok().map(|answer| answer.to_string().into())
    }
}

/// A page is not there any more.
struct Gone;

impl Shared {
    /// The names by which this server is asked.
    fn names(&self) -> [String; 2] {
        let port = self.address.port();
        [format!("127.0.0.1:{port}"), format!("localhost:{port}")]
    }
}

fn text_of<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Option<&'h str> {
    headers.get(name)?.to_str().ok()
}

/// Whether two texts are the same, in a time that does not tell where they differ.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}
