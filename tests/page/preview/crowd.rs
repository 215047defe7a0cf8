//! Tests that the watch and its page continue if thousands of connections are opened by mistake.

use super::*;

/// The number of connections that are opened. It is larger than the default limit of open files.
const MANY: usize = 1100;

/// Raises the limit of open files of this process. The watch keeps the default limit.
fn limit_files(n_files: u64) {
    use rustix::process::{Resource, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    let current = limit.maximum.map_or(n_files, |maximum| maximum.min(n_files));
    setrlimit(Resource::Nofile, rustix::process::Rlimit { current: Some(current), ..limit })
        .unwrap();
}

#[test]
fn a_thousand_idle_connections_do_not_starve_the_watch_and_its_page() {
    let project = Project::doll();
    limit_files(1024);
    let mut served = Server::new(&project);
    limit_files(8192);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.look_at("model", "mesh");
    page.wait("value");
    fn connect(served_host: &str) -> TcpStream {
        TcpStream::connect(served_host).unwrap()
    }
    let mut idle: Vec<_> = (0..MANY).map(|_| connect(&served.host)).collect();
    // Some clients begin a request and do not finish it.
    for stream in &mut idle[MANY - 100..] {
        // Writing fails if the server has already closed the connection.
        let _ = write!(stream, "GET / HTTP/1.1\r\nHost: ");
    }
    let own = [("Host", &served.host[..])];
    assert_eq!(served.status("/", &own), 200);
    assert_eq!(served.status("/page.js", &own), 200);
    // The open page is notified of a save and gets its columns.
    project.save(&project.doll_text(14.0));
    let run = served.watch.run_until_ok().number();
    let value = loop {
        let value = page.wait("value");
        if value["run"] == run {
            break value;
        }
    };
    let column = value["space"]["shapes"][0]["position"].as_str().unwrap();
    assert_eq!(served.status(&format!("/column/{column}"), &own), 200);
    drop(served.page());
    // Disconnected clients get the reason.
    idle[0].set_read_timeout(Some(PATIENCE)).unwrap();
    let mut told = String::new();
    idle[0].read_to_string(&mut told).unwrap();
    assert!(told.starts_with("HTTP/1.1 503 ") && told.contains("128 connections"), "{told}");
    // Clients that send nothing are disconnected, too.
    let mut silent = connect(&served.host);
    silent.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut told = String::new();
    silent.read_to_string(&mut told).unwrap();
    assert!(told.starts_with("HTTP/1.1 408 "), "{told}");
    let mut half = connect(&served.host);
    half.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(half, "GET / HTTP/1.1\r\n").unwrap();
    let mut told = Vec::new();
    half.read_to_end(&mut told).unwrap();
    assert!(told.is_empty() || told.starts_with(b"HTTP/1.1 408 "), "{told:?}");
    // The socket of the page is still open.
    project.save(&project.doll_text(13.0));
    served.watch.run_until_ok();
    page.wait("value");
    served.watch.end();
}
