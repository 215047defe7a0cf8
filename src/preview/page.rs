//! The live page of a watch, and the state that its server and the watch share.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::Path;
use std::sync::{Arc, Mutex};

use maquette_diagram::Drawing;
use maquette_graph::Graph;
use maquette_graph::catalog::Catalog;
use serde::Deserialize;
use serde_json::{Value as Json, json};

use super::event_log::{EventLog, Listener};
use super::gpu_columns::Content;
use super::pick::PickRay;
use super::saved_address::{Keeper, SavedAddress};
use crate::gpu_columns::ViewedValue;
use crate::location::Location;
use crate::locks::lock_ignoring_poison;
use crate::saved_address::Redirect;
use crate::{pixel_probe, server};

/// The live page of a watch, with its server. The server runs until the program ends.
pub struct Page {
    pub(crate) shared: Arc<PageState>,
    pub(crate) keeper: Option<Keeper>,
}

/// An output that a page shows: an output of a node, or of a used graph.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
pub struct ViewedOutput {
    pub node: String,
    pub output: String,
}

/// The outputs that at least one page shows.
pub type Views = BTreeSet<ViewedOutput>;

/// A request of a page to the watch (the running `maquette watch`).
#[derive(Clone, Debug)]
pub enum PageRequest {
    /// Reports that pages now show these outputs.
    SetViews(Views),
    /// Writes new values to the graph file. The number identifies the page. Each pair is the name of a parameter (or `node.field`) and its
    /// value as RON.
    Set(u64, Vec<(String, String)>),
    /// Evaluates the graph with new values that are not written to the file, while the user drags a slider or handle. The arguments are as
    /// in [`Self::Set`].
    Drag(u64, Vec<(String, String)>),
    /// Ends the drag of this page. Is also sent when the page disconnects.
    EndDrag(u64),
    /// Undoes the last change of the graph file by a page.
    Undo,
    /// Opens a location in the user's editor.
    Open(Location),
}

/// A question of a page about a viewed value. Only the page that asked gets the answer.
pub struct Question {
    /// The id of the question. The answer contains the same id.
    pub(crate) id: u64,
    pub(crate) viewed: ViewedOutput,
    pub(crate) about: QuestionKind,
}

pub enum QuestionKind {
    /// The value at a pixel, given as [column, row].
    Pixel([usize; 2]),
    /// The first element that a ray hits.
    Sight(PickRay),
}

impl QuestionKind {
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Pixel(_) => "probe",
            Self::Sight(_) => "pick",
        }
    }
}

/// The state that the server of the page and the watch share.
pub struct PageState {
    pub(crate) address: SocketAddr,
    /// The secret token that a browser must send to connect.
    pub(crate) token: String,
    pub(crate) feed: Mutex<Feed>,
    pub(crate) event_log: EventLog,
    /// The outputs that each page shows, by the number of the page's socket.
    pub(crate) views_by_socket: Mutex<BTreeMap<u64, Views>>,
    /// True if editors may embed the page in a frame.
    pub(crate) in_editor: bool,
    /// The function that is called for each request of a page.
    pub(crate) on_request: Box<dyn Fn(PageRequest) + Send + Sync>,
    pub(crate) values: Mutex<Values>,
}

/// The maximum total size in bytes of values that pages showed before. The limit grows by the total size of the values that pages show now.
/// So at least the values shown last are kept, however large they are.
pub const MAX_KEPT_BYTES: usize = if cfg!(test) { 1 << 10 } else { 128 << 20 };

/// The maximum number of values that are kept after pages have stopped showing them.
pub const MAX_KEPT: usize = 64;

/// The last valid value of each output that pages show, and earlier values.
#[derive(Default)]
pub struct Values {
    pub(crate) current: BTreeMap<ViewedOutput, Arc<ViewedValue>>,
    /// Values that pages showed earlier, the newest last. A page that still has the columns of such a value needs only the changes since
    /// then.
    pub(crate) previous: VecDeque<Arc<ViewedValue>>,
}

impl Values {
    pub(crate) fn put(&mut self, viewed: ViewedOutput, shown: Arc<ViewedValue>) {
        let old = self.current.insert(viewed, shown.clone());
        self.keep(old.filter(|old| !Arc::ptr_eq(old, &shown)));
    }

    pub(crate) fn retain(&mut self, views: &Views) {
        let gone = self.current.extract_if(.., |viewed, _| !views.contains(viewed));
        let gone: Vec<_> = gone.map(|(_, shown)| shown).collect();
        if views.is_empty() {
            // Drop all previous values. No page shows an output, so no page has an old column to which changes could be applied.
            return self.previous.clear();
        }
        self.keep(gone);
    }

    pub(crate) fn keep(&mut self, old: impl IntoIterator<Item = Arc<ViewedValue>>) {
        self.previous.extend(old);
        let most = MAX_KEPT_BYTES + self.current.values().map(|shown| shown.size()).sum::<usize>();
        let mut size: usize = self.previous.iter().map(|shown| shown.size()).sum();
        while size > most || self.previous.len() > MAX_KEPT {
            size -= self.previous.pop_front().map_or(size, |shown| shown.size());
        }
    }

    pub(crate) fn values(&self) -> impl Iterator<Item = &Arc<ViewedValue>> {
        self.current.values().chain(self.previous.iter().rev())
    }
}

/// The current state of the watch, as messages. A page receives these messages when it connects, in the order of the fields.
#[derive(Default)]
pub struct Feed {
    pub(crate) hello: Option<Arc<str>>,
    pub(crate) graph: Option<Arc<str>>,
    pub(crate) problems: Option<Arc<str>>,
    /// The message about the end of the last run; `None` if no run has ended yet.
    pub(crate) done: Option<Arc<str>>,
    /// The message about the beginning of the current run.
    pub(crate) run: Option<Arc<str>>,
    /// The last message about each node in the current run, by the name of the node.
    pub(crate) nodes: BTreeMap<String, Arc<str>>,
    pub(crate) values: BTreeMap<ViewedOutput, Arc<str>>,
}

impl Page {
    /// Starts the server on a port of this machine, preferably the port of the last watch. `draft` is true if runs use draft values.
    /// `in_editor` is true if editors may embed the page in a frame. `on_request` is called for each request of a page.
    ///
    /// # Errors
    /// If the server cannot listen on any port, or if the system provides no random numbers.
    pub fn open(
        graph: &Path,
        draft: bool,
        in_editor: bool,
        on_request: impl Fn(PageRequest) + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let keeper = Keeper::for_graph(graph);
        let (listener, token) = bind(keeper.as_ref())?;
        let shared = Arc::new(PageState {
            address: listener.local_addr()?,
            token,
            feed: Mutex::default(),
            event_log: EventLog::new(),
            views_by_socket: Mutex::default(),
            in_editor,
            on_request: Box::new(on_request),
            values: Mutex::default(),
        });
        server::start(listener, shared.clone())?;
        let program = concat!("maquette ", env!("CARGO_PKG_VERSION"));
        let page = server::version();
        let hello = json!({
            "event": "hello", "program": program, "graph": graph, "page": page, "draft": draft,
        });
        shared.send(&hello);
        Ok(Self { shared, keeper })
    }

    /// Returns the URL of the page, which contains the secret token. Give it only to the user: anyone who knows the URL can see the graph.
    pub fn link(&self) -> String {
        format!("http://{}/#{}", self.shared.address, self.shared.token)
    }

    /// Creates a file that redirects a browser to the page.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn redirect(&self) -> io::Result<Redirect> {
        let keeper = self
            .keeper
            .as_ref()
            .ok_or_else(|| io::Error::other("the system has no folder for a user's state"))?;
        keeper.redirect(self.shared.address.port(), &self.link())
    }

    /// Shows the diagram of a graph on the pages: a box for each node at its position, and the links.
    pub fn show(&self, graph: &Graph, catalog: &Catalog) {
        let mut message = Drawing::new(graph, catalog).to_json();
        message["event"] = "graph".into();
        message["schema"] = graph.schema().clone();
        self.shared.send(&message);
    }

    /// Shows new values after a run. Values that are not in `values` do not change. `live` is true during a drag.
    pub fn show_values(
        &self,
        run: usize,
        live: bool,
        values: &BTreeMap<ViewedOutput, Arc<ViewedValue>>,
    ) {
        for (viewed, shown) in values {
            let mut message = shown.about.clone();
            message["event"] = "value".into();
            message["node"] = viewed.node.clone().into();
            message["output"] = viewed.output.clone().into();
            message["run"] = run.into();
            message["live"] = live.into();
            lock_ignoring_poison(&self.shared.values).put(viewed.clone(), shown.clone());
            self.shared.send(&message);
        }
    }

    /// Returns a function that sends a message to all pages. A page that connects later also gets the message, if it still describes the
    /// current state.
    pub fn message_sender(&self) -> impl Fn(&Json) + Send + Sync + 'static {
        let shared = self.shared.clone();
        move |message| shared.send(message)
    }
}

/// Listens on the saved port with the saved token if possible, otherwise on a free port with a new token. A new port and token are saved
/// only if none were saved before. If the saved port is in use, it belongs to another watch of the same graph, which keeps it.
pub fn bind(keeper: Option<&Keeper>) -> io::Result<(TcpListener, String)> {
    fn listen(port: u16) -> Result<TcpListener, io::Error> {
        TcpListener::bind((Ipv4Addr::LOCALHOST, port))
    }
    let kept = keeper.and_then(Keeper::load);
    if let Some(SavedAddress { port, token }) = &kept
        && let Ok(listener) = listen(*port)
    {
        return Ok((listener, token.clone()));
    }
    let listener = listen(0)?;
    let mut secret = [0; 16];
    getrandom::fill(&mut secret).map_err(io::Error::other)?;
    let token = format!("{:032x}", u128::from_le_bytes(secret));
    if let (Some(keeper), None) = (keeper, kept) {
        let port = listener.local_addr()?.port();
        // Ignore an error: if the address cannot be saved, the next watch has another URL.
        let _ = keeper.save(&SavedAddress { port, token: token.clone() });
    }
    Ok((listener, token))
}

impl PageState {
    /// Stores which outputs a page shows. The set is empty after the page has disconnected.
    pub(crate) fn set_views(&self, socket: u64, views: Views) {
        let mut looks = lock_ignoring_poison(&self.views_by_socket);
        fn union(looks: &BTreeMap<u64, Views>) -> Views {
            looks.values().flatten().cloned().collect()
        }
        let before = union(&looks);
        if views.is_empty() {
            looks.remove(&socket);
        } else {
            looks.insert(socket, views);
        }
        let now = union(&looks);
        drop(looks);
        if now != before {
            lock_ignoring_poison(&self.values).retain(&now);
            lock_ignoring_poison(&self.feed).values.retain(|viewed, _| now.contains(viewed));
            (self.on_request)(PageRequest::SetViews(now));
        }
    }

    /// Returns the value with this hash, or `None` if no page shows the value and it is no longer kept.
    pub(crate) fn value(&self, hash: &str) -> Option<Arc<ViewedValue>> {
        let values = lock_ignoring_poison(&self.values);
        values.values().find(|shown| shown.value.hash().to_string() == hash).cloned()
    }

    /// Returns the content of the column with this name. Returns `None` if neither a value that a page shows nor a value that is still kept
    /// has the column.
    pub(crate) fn column(&self, name: &str) -> Option<Content> {
        let values = lock_ignoring_poison(&self.values);
        values.values().find_map(|shown| shown.column(name).cloned())
    }

    /// Returns the answer to a question of a page about a value.
    pub(crate) fn answer(&self, question: &Question) -> Json {
        let Question { id, viewed, about } = question;
        let shown = lock_ignoring_poison(&self.values).current.get(viewed).cloned();
        let mut answer = match (about, shown) {
            (QuestionKind::Pixel(_), None) => json!({ "why": "no page views this value" }),
            (QuestionKind::Pixel(pixel), Some(shown)) => {
                match pixel_probe::probe(&shown.value, *pixel) {
                    Some(found) => json!({ "facts": pixel_probe::facts(found) }),
                    None => {
                        let output = (&viewed.output[..], &shown.value);
                        json!({ "why": pixel_probe::no_answer(&viewed.node, &[output], *pixel) })
                    }
                }
            }
            (QuestionKind::Sight(sight), shown) => {
                let found = shown.and_then(|shown| shown.pickable().pick(sight));
                found.unwrap_or_else(|| json!({ "nothing": true }))
            }
        };
        answer["event"] = about.name().into();
        answer["id"] = (*id).into();
        answer
    }

    pub(crate) fn send(&self, message: &Json) {
        let text: Arc<str> = message.to_string().into();
        let mut feed = lock_ignoring_poison(&self.feed);
        feed.note(message, &text);
        self.event_log.send(text);
    }

    /// Returns the messages that describe the current state, and a listener for later messages.
    pub(crate) fn listen(&self) -> (Vec<Arc<str>>, Listener<'_>) {
        let feed = lock_ignoring_poison(&self.feed);
        (feed.messages(), self.event_log.listen())
    }
}

impl Feed {
    pub(crate) fn note(&mut self, message: &Json, text: &Arc<str>) {
        match message["event"].as_str() {
            Some("hello") => self.hello = Some(text.clone()),
            Some("graph") => self.graph = Some(text.clone()),
            Some("problems") => self.problems = Some(text.clone()),
            Some("run") => {
                self.run = Some(text.clone());
                self.nodes.clear();
            }
            Some("done") => {
                self.done = Some(text.clone());
                self.run = None;
                self.nodes.clear();
            }
            Some("cancelled") => {
                self.run = None;
                self.nodes.clear();
            }
            Some("value") => {
                let viewed_output = ViewedOutput::deserialize(message).ok();
                self.values.extend(viewed_output.zip(Some(text.clone())));
            }
            Some("started" | "progress" | "finished") => {
                let node = message["node"].as_str().unwrap_or_default();
                self.nodes.extend(Some((node.to_owned(), text.clone())));
            }
            _ => {}
        }
    }

    pub(crate) fn messages(&self) -> Vec<Arc<str>> {
        let once = [&self.hello, &self.graph, &self.problems, &self.done, &self.run];
        let once = once.into_iter().flatten();
        once.chain(self.nodes.values()).chain(self.values.values()).cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{AnyValue, Image};

    use super::*;

    #[test]
    fn a_late_page_gets_the_current_state() {
        let mut feed = Feed::default();
        let mut note = |message: Json| {
            feed.note(&message, &message.to_string().into());
            feed.messages()
                .iter()
                .map(|text| {
                    let message: Json = serde_json::from_str(text).unwrap();
                    message["event"].as_str().unwrap().to_owned()
                })
                .collect::<Vec<_>>()
        };
        note(json!({ "event": "problems", "problems": [] }));
        note(json!({ "event": "graph" }));
        assert_eq!(note(json!({ "event": "hello" })), ["hello", "graph", "problems"]);
        note(json!({ "event": "run", "run": 1 }));
        note(json!({ "event": "started", "node": "a" }));
        note(json!({ "event": "finished", "node": "a" }));
        let messages = note(json!({ "event": "started", "node": "b" }));
        assert_eq!(messages, ["hello", "graph", "problems", "run", "finished", "started"]);
        let messages = note(json!({ "event": "done", "run": 1 }));
        assert_eq!(messages, ["hello", "graph", "problems", "done"]);
        note(json!({ "event": "run", "run": 2 }));
        assert_eq!(note(json!({ "event": "cancelled", "run": 2 })), messages);
    }

    #[test]
    fn the_value_before_a_large_one_is_kept() {
        fn viewed_output() -> ViewedOutput {
            ViewedOutput { node: "a".into(), output: "value".into() }
        }
        let mut values = Values::default();
        let all = [0, 1, 2, 3].map(|level: u8| {
            let value = AnyValue::new(Image::new(64, 64, vec![[level; 3]; 64 * 64]).unwrap());
            Arc::new(ViewedValue::new(value.clone(), value.show(), Vec::new(), None, None))
        });
        assert!(all[0].size() > MAX_KEPT_BYTES);
        all.iter().for_each(|shown| values.put(viewed_output(), shown.clone()));
        let known: Vec<_> = values.values().map(|shown| shown.value.hash()).collect();
        assert_eq!(known, [all[3].value.hash(), all[2].value.hash()]);
    }
}
