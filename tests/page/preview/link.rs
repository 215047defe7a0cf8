//! The address of the live page, and the programs that the watch starts: a browser and an editor.

use super::*;

#[test]
fn the_link_of_a_graph_stays_the_same() {
    let project = Project::doll();
    let mut first = Server::new(&project);
    let link = first.link();
    // A second watch of the graph gets its own address and does not change the first one.
    let mut second = Server::new(&project);
    assert_ne!(second.host, first.host);
    second.page().wait("hello");
    first.watch.end();
    let mut again = Server::new(&project);
    assert_eq!(again.link(), link);
    again.page().wait("hello");
    second.watch.end();
    again.watch.end();
    let mut last = Server::new(&project);
    assert_eq!(last.link(), link);
    last.watch.end();
}

#[test]
fn what_is_kept_of_a_link_is_a_secret_and_can_be_lost() {
    let project = Project::doll();
    fn link(project: &Project) -> String {
        let mut served = Server::new(project);
        served.page().wait("hello");
        served.watch.end();
        served.link()
    }
    let first = link(&project);
    fn address_file(project: &Project) -> PathBuf {
        let mut entries = std::fs::read_dir(project.pages()).unwrap();
        let path = entries.next().unwrap().unwrap().path();
        assert!(entries.next().is_none());
        path
    }
    let text = std::fs::read_to_string(address_file(&project)).unwrap();
    let token = first.split('#').nth(1).unwrap();
    assert!(
        text.contains(token) && !address_file(&project).display().to_string().contains("doll"),
        "{text}"
    );
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fn mode(path: &Path) -> u32 {
            std::fs::metadata(path).unwrap().permissions().mode() & 0o777
        }
        assert_eq!((mode(&address_file(&project)), mode(&project.pages())), (0o600, 0o700));
        // If other users could have read the saved token, it is replaced.
        std::fs::set_permissions(address_file(&project), std::fs::Permissions::from_mode(0o644))
            .unwrap();
        assert!(!link(&project).ends_with(token));
        assert_eq!(mode(&address_file(&project)), 0o600);
    }
    std::fs::write(address_file(&project), "nothing of the kind").unwrap();
    let other = link(&project);
    assert!(!other.ends_with(token));
    assert_eq!(link(&project), other);
    // If the address cannot be saved, each watch gets a new one.
    std::fs::remove_dir_all(project.pages()).unwrap();
    std::fs::write(project.pages(), "").unwrap();
    assert_ne!(link(&project), link(&project));
}

/// Writes a shell script with this text and returns its path.
#[cfg(target_os = "linux")]
pub(crate) fn script(project: &Project, name: &str, text: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let path = project.folder().join(name);
    std::fs::write(&path, format!("#!/bin/sh\n{text}")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// Waits until a file exists and returns its text.
#[cfg(target_os = "linux")]
pub(crate) fn read_when_written(path: &Path) -> String {
    let start = Instant::now();
    loop {
        if let Ok(text) = std::fs::read_to_string(path) {
            return text;
        }
        assert!(start.elapsed() < PATIENCE, "{} was never written", path.display());
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_browser_is_given_a_file_that_leads_to_the_page() {
    use std::os::unix::fs::PermissionsExt;
    let project = Project::doll();
    let told = project.folder().join("told");
    let seen = "tr '\\0' ' ' < /proc/$$/cmdline > told.new; tr '\\0' ' ' < /proc/$PPID/cmdline >> told.new; mv told.new told\n";
    let browser = script(&project, "browser", seen);
    let browser = format!("no-such-browser:{} --new %s", browser.display());
    let mut served =
        Server::start_with(&project, &["--open"], &[("BROWSER", OsStr::new(&browser))]);
    let told = read_when_written(&told);
    assert!(told.contains("--open") && !told.contains(&served.token), "{told}");
    let given = told.split_whitespace().find(|word| word.ends_with(".html")).unwrap();
    let given = Path::new(given);
    assert!(given.starts_with(project.pages()), "{given:?}");
    assert_eq!(std::fs::metadata(given).unwrap().permissions().mode() & 0o777, 0o600);
    let page = std::fs::read_to_string(given).unwrap();
    let url = page.split("url=").nth(1).unwrap().split('"').next().unwrap();
    assert_eq!(url, served.link());
    served.page().wait("hello");
    served.watch.end();
    assert!(!given.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn without_a_browser_the_link_is_told_and_the_watch_goes_on() {
    let project = Project::doll();
    let failing = script(&project, "browser", "exit 3\n");
    for browser in ["", "no-such-browser", failing.to_str().unwrap()] {
        let mut command = project.command(&["watch", "doll.ron", "--open", "--out", "out"]);
        command.env("BROWSER", browser).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut process = command.spawn().unwrap();
        let said = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
        let words = said.into_iter().find(|line| line.contains("no browser was opened")).unwrap();
        assert!(words.contains("http://127.0.0.1:"), "{words}");
        let runs = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        assert!(runs.into_iter().any(|line| line.starts_with("run 1: ")));
        process.kill().unwrap();
        process.wait().unwrap();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn the_editor_is_opened_where_pages_were_told_and_nowhere_else() {
    let project = Project::doll();
    let told = project.folder().join("told");
    let editor = "for word; do echo \"$word\"; done > told.new; mv told.new told\n";
    let editor = script(&project, "code", editor);
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let mut served =
        Server::start_with(&project, &["--preview"], &[("MAQUETTE_EDITOR", editor.as_os_str())]);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.wait("done");
    fn open_request(page: &mut Page, what: Json, told: &Path, project: &Project) -> (usize, usize) {
        let _ = std::fs::remove_file(told);
        page.say(&what);
        let told = read_when_written(told);
        let (option, place) = told.trim_end().split_once('\n').unwrap();
        assert_eq!(option, "-g");
        let place = place.strip_prefix(&format!("{}:", project.graph().display()));
        let (line, column) = place.unwrap().split_once(':').unwrap();
        (line.parse::<usize>().unwrap(), column.parse::<usize>().unwrap())
    }
    fn place_of(text: &str, words: &str) -> (usize, usize) {
        let (line, row) = text.lines().enumerate().find(|(_, row)| row.contains(words)).unwrap();
        (line + 1, row.find(words).unwrap() + 1)
    }
    let at = open_request(&mut page, json!({ "ask": "open", "node": "nose" }), &told, &project);
    assert_eq!(at, place_of(&text, "ExtractRegion("));
    let (line, _) =
        open_request(&mut page, json!({ "ask": "open", "node": "nose-mask.png" }), &told, &project);
    assert_eq!(line, place_of(&text, "\"nose-mask.png\"").0);
    let broken = text.replace("Nurbs(", "Nurb(");
    project.save(&broken);
    let problem = loop {
        let told = page.wait("problems");
        if told["problems"] != json!([]) {
            break told["problems"][0].clone();
        }
    };
    let place =
        json!({ "file": problem["file"], "line": problem["line"], "column": problem["column"] });
    let at = open_request(&mut page, json!({ "ask": "open", "problem": place }), &told, &project);
    assert_eq!(at, place_of(&broken, "Nurb("));
    let _ = std::fs::remove_file(&told);
    for what in [
        json!({ "problem": { "file": "/etc/passwd", "line": 1, "column": 1 } }),
        json!({ "problem": { "file": "doll.ron", "line": 1, "column": 1 } }),
        json!({ "node": "../../etc/passwd" }),
        json!({}),
    ] {
        let mut asked = what.clone();
        asked["ask"] = "open".into();
        page.say(&asked);
        let why = page.wait("refused")["why"].as_str().unwrap().to_owned();
        assert!(why.contains("no such location"), "{what}: {why}");
    }
    assert!(!told.exists());
    served.watch.end();
}

#[cfg(target_os = "linux")]
#[test]
fn an_editor_that_cannot_be_opened_is_told_of() {
    let project = Project::doll();
    let failing = script(&project, "failing", "exit 3\n");
    for (variable, editor, expected) in [
        ("VISUAL", "vim", "MAQUETTE_EDITOR"),
        ("MAQUETTE_EDITOR", "no-such-editor", "program not found: no-such-editor"),
        ("MAQUETTE_EDITOR", failing.to_str().unwrap(), "exit status: 3"),
    ] {
        let mut served =
            Server::start_with(&project, &["--preview"], &[(variable, OsStr::new(editor))]);
        served.watch.run_until_ok();
        let mut page = served.page();
        page.say(&json!({ "ask": "open", "node": "nose" }));
        let why = page.wait("refused")["why"].as_str().unwrap().to_owned();
        assert!(why.contains(expected), "{why}");
        served.watch.end();
    }
}
