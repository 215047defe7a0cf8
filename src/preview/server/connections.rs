//! Manages the connections to the server of the live page. Limits their number and their idle time.
//!
//! Any program on this machine may open connections, even thousands by mistake. They must not use up the files that the watch can open, and
//! must not prevent a page from connecting.

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

use crate::locks::lock_ignoring_poison;

/// The maximum number of connections. A browser opens up to six to a server, and one more for each open page. The limit leaves room for
/// other files, because a process may have only 1024 open files.
const MAX_CONNECTIONS: usize = 128;

/// The idle time after which a connection is closed. The browser opens a new connection when it needs one.
const IDLE_TIMEOUT: Duration = Duration::from_secs(10);

/// The maximum time to finish sending an answer before a connection is closed.
const LINGER_TIMEOUT: Duration = Duration::from_secs(1);

/// The delay before trying again after the system failed to accept a connection.
const RETRY_DELAY: Duration = Duration::from_millis(100);

/// The open connections, by the number of the connection.
#[derive(Default)]
struct Connections {
    open: Mutex<BTreeMap<u64, Arc<Connection>>>,
    last: AtomicU64,
}

struct Connection {
    usage: Mutex<Usage>,
    /// Notified when this connection must be closed to make room for another one.
    close: Notify,
    has_asked: AtomicBool,
}

/// The current use of a connection.
struct Usage {
    last: Instant,
    /// The number of requests on this connection whose answers are being computed or sent.
    n_requests: usize,
    is_page: bool,
}

/// An entry in the list of open connections. Dropping it removes the connection from the list.
pub(super) struct Lease {
    connection: Arc<Connection>,
    number: u64,
    of: Arc<Connections>,
}

impl Connections {
    /// Adds a connection to the list. If there are too many connections, closes the one that has been idle for the longest time. If none is
    /// idle, returns `None` and does not add the connection.
    fn admit(self: &Arc<Self>) -> Option<Lease> {
        let mut open = lock_ignoring_poison(&self.open);
        if open.len() >= MAX_CONNECTIONS {
            let idle = open.iter().filter_map(|(number, connection)| {
                let used = lock_ignoring_poison(&connection.usage);
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
    /// Marks the connection as the WebSocket of a page, which is not closed while it is idle.
    pub(super) fn belongs_to_page(&self) {
        lock_ignoring_poison(&self.connection.usage).is_page = true;
    }

    /// Counts a request as being answered until the returned guard is dropped.
    pub(super) fn answering(&self) -> AnswerGuard {
        self.connection.has_asked.store(true, Ordering::Relaxed);
        lock_ignoring_poison(&self.connection.usage).n_requests += 1;
        AnswerGuard(self.connection.clone())
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        lock_ignoring_poison(&self.of.open).remove(&self.number);
    }
}

/// Marks a request as being answered while it exists.
pub(super) struct AnswerGuard(Arc<Connection>);

impl Drop for AnswerGuard {
    fn drop(&mut self) {
        let mut used = lock_ignoring_poison(&self.0.usage);
        used.n_requests -= 1;
        used.last = Instant::now();
    }
}

/// Accepts and serves connections. Never returns.
pub(super) async fn serve(listener: TcpListener, router: Router) {
    let connections = Arc::new(Connections::default());
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(RETRY_DELAY).await;
            continue;
        };
        match connections.admit() {
            Some(lease) => drop(tokio::spawn(serve_one(stream, router.clone(), lease))),
            None => drop(tokio::spawn(reject(stream, full()))),
        }
    }
}

async fn serve_one(stream: TcpStream, router: Router, lease: Lease) {
    let lease = Arc::new(lease);
    let connection = lease.connection.clone();
    let mut first = [0];
    // Wait for the first request. If the connection must be closed before a request arrives, the reason can still be sent as an answer.
    tokio::select! {
        // Use `peek` instead of `readable`, which may return although there is nothing to read.
        asked = stream.peek(&mut first) => if asked.is_err() { return },
        () = connection.close.notified() => return reject(stream, full()).await,
        () = sleep(IDLE_TIMEOUT) => return reject(stream, idle()).await,
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
            let _ = timeout(LINGER_TIMEOUT, served).await;
        },
    }
}

/// Sends the reason why a connection is not served, and then closes it.
async fn reject(stream: TcpStream, answer: String) {
    // Wait until the connection is writable. Its send buffer is empty, so the whole answer then fits into it.
    let is_open = timeout(LINGER_TIMEOUT, stream.writable()).await.is_ok();
    if !is_open || stream.try_write(answer.as_bytes()).is_err() {
        return;
    }
    // Read all unread bytes: closing a connection with unread bytes would reset it, and the answer would be lost.
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
    let _ = timeout(LINGER_TIMEOUT, drain).await;
}

fn full() -> String {
    let why = format!(
        "the page has {MAX_CONNECTIONS} connections open, which is the maximum: close other pages, then load this one again\n"
    );
    answer("503 Service Unavailable", &why)
}

fn idle() -> String {
    let seconds = IDLE_TIMEOUT.as_secs();
    answer("408 Request Timeout", &format!("no request for {seconds} seconds\n"))
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
    fn the_longest_idle_connection_is_closed() {
        let connections = Arc::new(Connections::default());
        let leases: Vec<_> = (0..MAX_CONNECTIONS).map(|_| connections.admit().unwrap()).collect();
        leases[0].belongs_to_page();
        let answering = leases[1].answering();
        fn is_open(lease: &Lease, connections: &Arc<Connections>) -> bool {
            lock_ignoring_poison(&connections.open).contains_key(&lease.number)
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
