//! The connections of the page's server: how many there may be, and how long one may say nothing.
//!
//! Any program of this machine may open connections, also by mistake and by the thousand. They must not use up the files that the
//! watch may have open, and not keep a page out.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use axum::{Extension, Router};
use hyper::server::conn::http1::Builder;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio::time::{sleep, timeout};

use crate::locks::unpoisoned;

/// The maximum number of connections. A browser has six for all pages of a server, and one more for each page; the system gives a
/// process 1024 open files.
const MAX_CONNECTIONS: usize = 128;

/// A connection on which nothing is asked for so long is closed; a browser opens another one when it needs it.
const IDLE_TIMEOUT: Duration = Duration::from_secs(10);

/// The time that an answer has to leave when its connection is to be closed.
const LINGER: Duration = Duration::from_secs(1);

/// The pause after the system could not open a connection.
const RETRY: Duration = Duration::from_millis(100);

/// All connections that are open, by number.
#[derive(Default)]
struct Connections {
    open: Mutex<BTreeMap<u64, Arc<Connection>>>,
    last: AtomicU64,
}

struct Connection {
    usage: Mutex<Usage>,
    /// Is notified when it has to make room for another one.
    close: Notify,
    has_asked: AtomicBool,
}

/// What a connection is used for.
struct Usage {
    last: Instant,
    /// Requests that are being answered.
    n_requests: usize,
    is_page: bool,
}

/// The right to one connection. It is kept as long as the connection is open.
pub(super) struct Lease {
    connection: Arc<Connection>,
    number: u64,
    of: Arc<Connections>,
}

impl Connections {
    /// Makes room for one more connection: the one that has been idle for the longest time goes. None if all are in use.
    fn admit(self: &Arc<Self>) -> Option<Lease> {
        let mut open = unpoisoned(&self.open);
        if open.len() >= MAX_CONNECTIONS {
            let idle = open.iter().filter_map(|(number, connection)| {
                let used = unpoisoned(&connection.usage);
                (used.n_requests == 0 && !used.is_page).then_some((used.last, *number))
            });
            let (_, number) = idle.min()?;
            open.remove(&number)?.close.notify_one();
        }
        let number = self.last.fetch_add(1, Ordering::Relaxed);
        let connection = Arc::new(Connection {
            usage: Mutex::new(Usage { last: Instant::now(), n_requests: 0, is_page: false }),
            close: Notify::new(),
            has_asked: AtomicBool::new(false),
        });
        open.insert(number, connection.clone());
        Some(Lease { connection, number, of: self.clone() })
    }
}

impl Lease {
    /// Marks it as the socket of a page, which stays open while nothing is said.
    pub(super) fn belongs_to_page(&self) {
        unpoisoned(&self.connection.usage).is_page = true;
    }

    /// Marks that a request is being answered, until the result is dropped.
    pub(super) fn answering(&self) -> Answering {
        self.connection.has_asked.store(true, Ordering::Relaxed);
        unpoisoned(&self.connection.usage).n_requests += 1;
        Answering(self.connection.clone())
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        unpoisoned(&self.of.open).remove(&self.number);
    }
}

/// A request that is being answered.
pub(super) struct Answering(Arc<Connection>);

impl Drop for Answering {
    fn drop(&mut self) {
        let mut used = unpoisoned(&self.0.usage);
        used.n_requests -= 1;
        used.last = Instant::now();
    }
}

/// Serves every connection, for ever.
pub(super) async fn serve(listener: TcpListener, router: Router) {
    let connections = Arc::new(Connections::default());
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(RETRY).await;
            continue;
        };
        match connections.admit() {
            Some(lease) => drop(tokio::spawn(serve_one(stream, router.clone(), lease))),
            None => drop(tokio::spawn(refuse(stream, full()))),
        }
    }
}

async fn serve_one(stream: TcpStream, router: Router, lease: Lease) {
    let lease = Arc::new(lease);
    let connection = lease.connection.clone();
    let mut first = [0];
    // Until something is asked, the reason can still be told why it is closed.
    tokio::select! {
        // Not `readable`, which may be true of a connection that has nothing to read.
        asked = stream.peek(&mut first) => if asked.is_err() { return },
        () = connection.close.notified() => return refuse(stream, full()).await,
        () = sleep(IDLE_TIMEOUT) => return refuse(stream, idle()).await,
    }
    let service = TowerToHyperService::new(router.layer(Extension(lease)));
    let mut builder = Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(IDLE_TIMEOUT);
    let served = builder.serve_connection(TokioIo::new(stream), service).with_upgrades();
    let mut served = std::pin::pin!(served);
    tokio::select! {
        _ = served.as_mut() => {}
        () = connection.close.notified() => if connection.has_asked.load(Ordering::Relaxed) {
            served.as_mut().graceful_shutdown();
            let _ = timeout(LINGER, served).await;
        },
    }
}

/// Says why a connection is not served, and closes it.
async fn refuse(stream: TcpStream, answer: String) {
    // It fits into what the system holds for an empty connection, as soon as that is known to be open.
    let is_open = timeout(LINGER, stream.writable()).await.is_ok();
    if !is_open || stream.try_write(answer.as_bytes()).is_err() {
        return;
    }
    // Closed with bytes that nobody has read, the connection would be reset, and the answer lost.
    let drain = async {
        let mut bytes = [0; 1024];
        while stream.readable().await.is_ok() {
            match stream.try_read(&mut bytes) {
                Ok(1..) => {}
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
                Ok(0) | Err(_) => return,
            }
        }
    };
    let _ = timeout(LINGER, drain).await;
}

fn full() -> String {
    let why = format!(
        "the page has {MAX_CONNECTIONS} connections open, which is the maximum: close other pages, then load this one again\n"
    );
    answer("503 Service Unavailable", &why)
}

fn idle() -> String {
    let seconds = IDLE_TIMEOUT.as_secs();
    answer("408 Request Timeout", &format!("nothing was asked for {seconds} seconds\n"))
}

fn answer(status: &str, why: &str) -> String {
    let length = why.len();
    format!(
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{why}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_idle_connection_makes_room_and_none_that_is_in_use() {
        let connections = Arc::new(Connections::default());
        let leases: Vec<_> = (0..MAX_CONNECTIONS).map(|_| connections.admit().unwrap()).collect();
        leases[0].belongs_to_page();
        let answering = leases[1].answering();
        fn is_open(lease: &Lease, connections: &Arc<Connections>) -> bool {
            unpoisoned(&connections.open).contains_key(&lease.number)
        }
        let next = connections.admit().unwrap();
        assert!(
            is_open(&leases[0], &connections)
                && is_open(&leases[1], &connections)
                && !is_open(&leases[2], &connections)
        );
        leases.iter().for_each(Lease::belongs_to_page);
        next.belongs_to_page();
        assert!(connections.admit().is_none());
        drop((answering, next));
        assert!(connections.admit().is_some());
    }
}
