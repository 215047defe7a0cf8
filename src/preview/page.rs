//! A page of a watch, and who looks at it.

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

use super::kept::{Keeper, Kept};
use super::news::{Listener, News};
use super::pick::Sight;
use super::shown::Content;
use crate::kept::Redirect;
use crate::location::Location;
use crate::locks::unpoisoned;
use crate::shown::Shown;
use crate::{probe, server};

/// The live page, served until the program ends.
pub struct Page {
    pub(crate) shared: Arc<Shared>,
    pub(crate) keeper: Option<Keeper>,
}

/// An output of a node that somebody looks at, or of a use of a graph.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
pub struct Viewed {
    pub node: String,
    pub output: String,
}

/// All that anybody looks at.
pub type Views = BTreeSet<Viewed>;

/// What pages want of the watch.
#[derive(Clone, Debug)]
pub enum Wish {
    /// These are all values that are looked at now.
    Look(Views),
    /// The page of this number wants values to be put into the file of the graph: for each a parameter, or a field `node.field`, and
    /// RON.
    Set(u64, Vec<(String, String)>),
    /// It wants to see what such values would give.
    Drag(u64, Vec<(String, String)>),
    /// It does not any more, or it is gone.
    Drop(u64),
    /// The last such change is to be taken back.
    Undo,
    /// The user's editor is to be opened here.
    Open(Location),
}

/// What a page asks of a value that it looks at. It alone is answered.
pub struct Question {
    /// By which it knows the answer.
    pub(crate) id: u64,
    pub(crate) viewed: Viewed,
    pub(crate) about: About,
}

pub enum About {
    /// What is under this pixel (column, row)?
    Pixel([usize; 2]),
    /// What does this ray meet?
    Sight(Sight),
}

impl About {
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Pixel(_) => "probe",
            Self::Sight(_) => "pick",
        }
    }
}

/// What the server and the watch both know.
pub struct Shared {
    pub(crate) address: SocketAddr,
    /// What a browser has to know before it is told anything.
    pub(crate) token: String,
    pub(crate) feed: Mutex<Feed>,
    pub(crate) news: News,
    /// What each page looks at, by the number of its socket.
    pub(crate) looks: Mutex<BTreeMap<u64, Views>>,
    /// Whether editors may show the page in a frame.
    pub(crate) in_editor: bool,
    /// Is told what pages want.
    pub(crate) wish: Box<dyn Fn(Wish) + Send + Sync>,
    pub(crate) values: Mutex<Values>,
}

/// Bytes of values that nobody looks at any more which are kept, beside as many as somebody looks at: so the last ones before these
/// are there, however large they are.
pub const KEPT: usize = if cfg!(test) { 1 << 10 } else { 128 << 20 };

/// Values of before that are kept.
pub const MOST_KEPT: usize = 64;

/// The last good values that pages look at.
#[derive(Default)]
pub struct Values {
    pub(crate) now: BTreeMap<Viewed, Arc<Shown>>,
    /// Those of before, the last one last: pages have columns of them, and need no more than what has changed since.
    pub(crate) before: VecDeque<Arc<Shown>>,
}

impl Values {
    pub(crate) fn put(&mut self, viewed: Viewed, shown: Arc<Shown>) {
        let old = self.now.insert(viewed, shown.clone());
        self.keep(old.filter(|old| !Arc::ptr_eq(old, &shown)));
    }

    pub(crate) fn retain(&mut self, views: &Views) {
        let gone = self.now.extract_if(.., |viewed, _| !views.contains(viewed));
        let gone: Vec<_> = gone.map(|(_, shown)| shown).collect();
        if views.is_empty() {
            // Nobody has columns of which some may have changed.
            return self.before.clear();
        }
        self.keep(gone);
    }

    pub(crate) fn keep(&mut self, old: impl IntoIterator<Item = Arc<Shown>>) {
        self.before.extend(old);
        let most = KEPT + self.now.values().map(|shown| shown.size()).sum::<usize>();
        let mut size: usize = self.before.iter().map(|shown| shown.size()).sum();
        while size > most || self.before.len() > MOST_KEPT {
            size -= self.before.pop_front().map_or(size, |shown| shown.size());
        }
    }

    pub(crate) fn all(&self) -> impl Iterator<Item = &Arc<Shown>> {
        self.now.values().chain(self.before.iter().rev())
    }
}

/// What is true now, told in this order.
#[derive(Default)]
pub struct Feed {
    pub(crate) hello: Option<Arc<str>>,
    pub(crate) graph: Option<Arc<str>>,
    pub(crate) problems: Option<Arc<str>>,
    /// The end of the last run.
    pub(crate) done: Option<Arc<str>>,
    /// The beginning of the run under way.
    pub(crate) run: Option<Arc<str>>,
    /// The last that was said of each node in this run.
    pub(crate) nodes: BTreeMap<String, Arc<str>>,
    pub(crate) values: BTreeMap<Viewed, Arc<str>>,
}

impl Page {
    /// Starts the server on a port of this machine: that of the last time if it is free. `draft` is whether runs are drafts,
    /// `in_editor` whether editors may show it in a frame; `wish` is told what pages want.
    ///
    /// # Errors
    /// If no port can be listened on, or the system gives no random numbers.
    pub fn open(
        graph: &Path,
        draft: bool,
        in_editor: bool,
        wish: impl Fn(Wish) + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let keeper = Keeper::of(graph);
        let (listener, token) = bind(keeper.as_ref())?;
        let shared = Arc::new(Shared {
            address: listener.local_addr()?,
            token,
            feed: Mutex::default(),
            news: News::new(),
            looks: Mutex::default(),
            in_editor,
            wish: Box::new(wish),
            values: Mutex::default(),
        });
        server::start(listener, shared.clone())?;
        let program = concat!("maquette ", env!("CARGO_PKG_VERSION"));
        let page = server::version();
        let hello = json!({
            "event": "hello", "program": program, "graph": graph, "page": page, "draft": draft,
        });
        shared.tell(&hello);
        Ok(Self { shared, keeper })
    }

    /// What opens the page in a browser. Who has it may see the graph: it is for the user alone.
    pub fn link(&self) -> String {
        format!("http://{}/#{}", self.shared.address, self.shared.token)
    }

    /// A file that leads a browser to the page.
    ///
    /// # Errors
    /// If there is no place for such a file.
    pub fn redirect(&self) -> io::Result<Redirect> {
        let keeper = self
            .keeper
            .as_ref()
            .ok_or_else(|| io::Error::other("the system has no folder for a user's state"))?;
        keeper.redirect(self.shared.address.port(), &self.link())
    }

    /// Shows a graph: where its boxes are, and what links them.
    pub fn show(&self, graph: &Graph, catalog: &Catalog) {
        let mut message = Drawing::new(graph, catalog).to_json();
        message["event"] = "graph".into();
        message["schema"] = graph.schema().clone();
        self.shared.tell(&message);
    }

    /// Values that pages look at, as of a run, `live` ones of a drag; those that are not among them stay as they were.
    pub fn show_values(&self, run: usize, live: bool, values: &BTreeMap<Viewed, Arc<Shown>>) {
        for (viewed, shown) in values {
            let mut message = shown.about.clone();
            message["event"] = "value".into();
            message["node"] = viewed.node.clone().into();
            message["output"] = viewed.output.clone().into();
            message["run"] = run.into();
            message["live"] = live.into();
            unpoisoned(&self.shared.values).put(viewed.clone(), shown.clone());
            self.shared.tell(&message);
        }
    }

    /// What tells all pages something, and those that come later as long as it is true.
    pub fn teller(&self) -> impl Fn(&Json) + Send + Sync + 'static {
        let shared = self.shared.clone();
        move |message| shared.tell(message)
    }
}

/// Listens on the port that is kept, with the token that is kept; or on a free one with a new token, which are kept if nothing is. If
/// the port that is kept is taken, another watch of the same graph has it, and what is kept stays its own.
pub fn bind(keeper: Option<&Keeper>) -> io::Result<(TcpListener, String)> {
    fn at(port: u16) -> Result<TcpListener, io::Error> {
        TcpListener::bind((Ipv4Addr::LOCALHOST, port))
    }
    let kept = keeper.and_then(Keeper::load);
    if let Some(Kept { port, token }) = &kept
        && let Ok(listener) = at(*port)
    {
        return Ok((listener, token.clone()));
    }
    let listener = at(0)?;
    let mut secret = [0; 16];
    getrandom::fill(&mut secret).map_err(io::Error::other)?;
    let token = format!("{:032x}", u128::from_le_bytes(secret));
    if let (Some(keeper), None) = (keeper, kept) {
        let port = listener.local_addr()?.port();
        // Where it cannot be kept the link is another one the next time.
        let _ = keeper.save(&Kept { port, token: token.clone() });
    }
    Ok((listener, token))
}

impl Shared {
    /// A page looks at something else now; at nothing when it is gone.
    pub(crate) fn look(&self, socket: u64, views: Views) {
        let mut looks = unpoisoned(&self.looks);
        let union =
            |looks: &BTreeMap<u64, Views>| Views::from_iter(looks.values().flatten().cloned());
        let before = union(&looks);
        if views.is_empty() {
            looks.remove(&socket);
        } else {
            looks.insert(socket, views);
        }
        let now = union(&looks);
        drop(looks);
        if now != before {
            unpoisoned(&self.values).retain(&now);
            unpoisoned(&self.feed).values.retain(|viewed, _| now.contains(viewed));
            (self.wish)(Wish::Look(now));
        }
    }

    /// The value with this hash, if somebody looks at it or did so not long ago.
    pub(crate) fn value(&self, hash: &str) -> Option<Arc<Shown>> {
        let values = unpoisoned(&self.values);
        values.all().find(|shown| shown.value.hash().to_string() == hash).cloned()
    }

    /// The column of this name of such a value.
    pub(crate) fn column(&self, name: &str) -> Option<Content> {
        let values = unpoisoned(&self.values);
        values.all().find_map(|shown| shown.column(name).cloned())
    }

    /// What a page is answered that asks of a value.
    pub(crate) fn answer(&self, question: &Question) -> Json {
        let Question { id, viewed, about } = question;
        let shown = unpoisoned(&self.values).now.get(viewed).cloned();
        let mut answer = match (about, shown) {
            (About::Pixel(_), None) => json!({ "why": "nobody looks at such a value" }),
            (About::Pixel(pixel), Some(shown)) => match probe::at(&shown.value, *pixel) {
                Some(found) => json!({ "facts": probe::facts(found) }),
                None => {
                    let asked = (&viewed.output[..], &shown.value);
                    json!({ "why": probe::no_answer(&viewed.node, &[asked], *pixel) })
                }
            },
            (About::Sight(sight), shown) => {
                let found = shown.and_then(|shown| shown.pickable().pick(sight));
                found.unwrap_or_else(|| json!({ "nothing": true }))
            }
        };
        answer["event"] = about.name().into();
        answer["id"] = (*id).into();
        answer
    }

    pub(crate) fn tell(&self, message: &Json) {
        let text: Arc<str> = message.to_string().into();
        let mut feed = unpoisoned(&self.feed);
        feed.note(message, &text);
        self.news.tell(text);
    }

    /// All that is true, and what comes after it.
    pub(crate) fn listen(&self) -> (Vec<Arc<str>>, Listener<'_>) {
        let feed = unpoisoned(&self.feed);
        (feed.all(), self.news.listen())
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
                let viewed = Viewed::deserialize(message).ok();
                self.values.extend(viewed.zip(Some(text.clone())));
            }
            Some("started" | "progress" | "finished") => {
                let node = message["node"].as_str().unwrap_or_default();
                self.nodes.extend(Some((node.to_owned(), text.clone())));
            }
            _ => {}
        }
    }

    pub(crate) fn all(&self) -> Vec<Arc<str>> {
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
    fn who_comes_late_is_told_what_is_true() {
        let mut feed = Feed::default();
        let mut note = |message: Json| {
            feed.note(&message, &message.to_string().into());
            feed.all()
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
        let told = note(json!({ "event": "started", "node": "b" }));
        assert_eq!(told, ["hello", "graph", "problems", "run", "finished", "started"]);
        let told = note(json!({ "event": "done", "run": 1 }));
        assert_eq!(told, ["hello", "graph", "problems", "done"]);
        note(json!({ "event": "run", "run": 2 }));
        assert_eq!(note(json!({ "event": "cancelled", "run": 2 })), told);
    }

    #[test]
    fn the_value_before_a_large_one_is_still_known() {
        fn viewed() -> Viewed {
            Viewed { node: "a".into(), output: "value".into() }
        }
        let mut values = Values::default();
        let all = [0, 1, 2, 3].map(|level: u8| {
            let value = AnyValue::new(Image::new(64, 64, vec![[level; 3]; 64 * 64]).unwrap());
            Arc::new(Shown::new(value.clone(), value.show(), Vec::new(), None, None))
        });
        assert!(all[0].size() > KEPT);
        all.iter().for_each(|shown| values.put(viewed(), shown.clone()));
        let known: Vec<_> = values.all().map(|shown| shown.value.hash()).collect();
        assert_eq!(known, [all[3].value.hash(), all[2].value.hash()]);
    }
}
