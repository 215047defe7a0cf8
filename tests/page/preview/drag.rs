//! Drags on the live page, as messages to the server.

use super::*;

/// Starts a watch with cached results and a page that views a value. Returns them with the hash of that value.
fn looking_at(node: &str, output: &str) -> (Project, Server, Page, String) {
    let project = Project::doll();
    assert!(project.maquette(&["run", "doll.ron", "--out", "out"]).status.success());
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.wait("done");
    page.look_at(node, output);
    let value = page.wait("value");
    assert_eq!(value["live"], false, "{value}");
    let hash = value["hash"].as_str().unwrap().to_owned();
    (project, served, page, hash)
}

#[test]
fn a_drag_evaluates_what_is_looked_at_and_writes_nothing() {
    let (project, mut served, mut page, first) = looking_at("raised", "net");
    let last = project.hash("raised.net", &["growth=31.5"]);
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let (outputs, remembered) = (project.output_times(), project.settled_cache());
    for k in 0..20 {
        page.drag("growth", 12.5 + f64::from(k));
        std::thread::sleep(Duration::from_millis(16));
    }
    assert!(page.wait_live(&last));
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), text);
    assert_eq!(project.output_times(), outputs);
    assert!(project.settled_cache() == remembered, "something was kept on disk");
    // The drag is cancelled, so the saved value is shown again.
    page.say(&json!({ "ask": "drop" }));
    assert!(!page.wait_live(&first));
    page.drag("growth", 31.5);
    assert!(page.wait_live(&last));
    page.set("growth", 31.5);
    assert!(!page.wait_live(&last));
    let events = served.watch.events_until("run");
    // All results on which `raised` depends are available, at least on disk, so only `raised` is computed.
    let started = events.iter().filter(|event| event["event"] == "started");
    let started: Vec<_> = started.map(|event| event["node"].as_str().unwrap()).collect();
    assert!(started.iter().all(|&node| node == "raised"), "{events:?}");
    assert!((1..=20).contains(&started.len()), "{events:?}");
    // The run that writes the outputs computes only those nodes that the viewed value does not need.
    let run = served.watch.run_until_ok();
    assert_eq!((run.state("raised"), run.state("blended")), ("cached", "computed"));
    page.wait("done");
    page.say(&json!({ "ask": "undo" }));
    assert!(!page.wait_live(&first));
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), text);
    served.watch.end();
}

#[test]
fn a_run_after_a_drag_computes_nothing_again_in_this_process_and_in_the_next() {
    let (project, mut served, mut page, first) = looking_at("model", "mesh");
    // A value takes longer to compute than the time between two moves. Nevertheless, intermediate values arrive during the drag, which ends
    // after three of them.
    let (mut growth, mut seen) = (12.0, Vec::new());
    page.0.get_mut().0.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
    while seen.len() < 3 {
        growth = if growth < 39.0 { growth + 0.1 } else { 12.0 };
        page.drag("growth", growth);
        match page.0.read() {
            Ok(Message::Text(text)) => {
                let message: Json = serde_json::from_str(&text).unwrap();
                seen.extend((message["event"] == "value").then_some(message));
            }
            Ok(_) => {}
            Err(tungstenite::Error::Io(_)) => {}
            Err(other) => panic!("{other}"),
        }
    }
    page.0.get_mut().0.set_read_timeout(Some(PATIENCE)).unwrap();
    assert!(seen.iter().all(|value| value["live"] == true), "{seen:?}");
    page.drag("growth", 20.5);
    let last = project.hash("model.mesh", &["growth=20.5"]);
    assert!(page.wait_live(&last));
    page.set("growth", 20.5);
    let run = served.watch.run_until_ok();
    assert_eq!((&run.done["computed"], run.state("model")), (&json!(0), "cached"), "{run:?}");
    assert!(!page.wait_live(&last));
    assert_ne!(first, last);
    project.settled_cache();
    served.watch.end();
    let next = project.maquette(&["run", "doll.ron", "--out", "out", "--json"]);
    let next: Json = serde_json::from_slice(&next.stdout).unwrap();
    let states = next["nodes"].as_array().unwrap().iter().map(|node| &node["state"]);
    assert!(states.clone().count() > 5 && states.clone().all(|state| state == "cached"), "{next}");
}

#[test]
fn a_hand_that_rests_gives_up_the_value_before() {
    let (project, mut served, mut page, _) = looking_at("skin", "mesh");
    let last = project.hash("skin.mesh", &["levels=0"]);
    fn levels(levels: &str) -> Json {
        json!({ "ask": "drag", "values": [["levels", levels.to_owned()]] })
    }
    page.say(&levels("4"));
    served.watch.wait(|event| event["event"] == "started" && event["node"] == "skin");
    let moved = Instant::now();
    page.say(&levels("0"));
    served.watch.wait(|event| event["event"] == "started" && event["node"] == "skin");
    let took = moved.elapsed();
    // The first value would take seconds. It is cancelled long before it is done, but not at once, because drags show intermediate values.
    let sensible = Duration::from_millis(120)..Duration::from_millis(2000);
    assert!(sensible.contains(&took), "{took:?}");
    let value = page.wait("value");
    assert_eq!((&value["hash"], &value["live"]), (&json!(last), &json!(true)));
    served.watch.end();
}

#[test]
fn values_of_a_drag_that_do_not_do_are_told_once_and_the_picture_stays() {
    let (project, mut served, mut page, _) = looking_at("raised", "net");
    page.drag("growth", 100.0);
    let refused = page.wait("refused");
    assert!(refused["why"].as_str().unwrap().contains("growth"), "{refused}");
    for growth in [101.0, 102.0, 103.0] {
        page.drag("growth", growth);
        std::thread::sleep(Duration::from_millis(30));
    }
    page.say(&json!({ "ask": "drag", "values": [["girth", "1.0"], ["growth", "[1"]] }));
    page.drag("growth", 20.0);
    let mut message = page.next();
    while message["event"] == "started" || message["event"] == "finished" {
        message = page.next();
    }
    let hash = project.hash("raised.net", &["growth=20.0"]);
    assert_eq!((&message["hash"], &message["live"]), (&json!(hash), &json!(true)), "{message}");
    page.drag("growth", 100.0);
    page.wait("refused");
    served.watch.end();
}

#[test]
fn a_drag_ends_when_somebody_saves_the_file_and_when_its_page_is_gone() {
    let (project, mut served, mut page, _) = looking_at("raised", "net");
    let [of_25, of_27, of_30] = [25.0, 27.0, 30.0]
        .map(|growth: f64| project.hash("raised.net", &[&format!("growth={growth:.1}")]));
    page.drag("growth", 25.0);
    assert!(page.wait_live(&of_25));
    project.save(&project.doll_text(30.0));
    assert!(page.wait("refused")["why"].as_str().unwrap().contains("changed"));
    let value = page.wait("value");
    assert_eq!((&value["hash"], &value["live"]), (&json!(of_30), &json!(false)));
    // Until the page sends `drop`, moves still belong to the ended drag.
    page.drag("growth", 26.0);
    page.say(&json!({ "ask": "drop" }));
    page.drag("growth", 27.0);
    let value = page.wait("value");
    assert_eq!((&value["hash"], &value["live"]), (&json!(of_27), &json!(true)));
    // The page itself has caused the change of the file, so a drag that begins immediately afterwards is not cancelled.
    page.set("growth", 27.0);
    page.drag("growth", 25.0);
    assert!(page.wait_live(&of_25));
    let mut other = served.page();
    other.look_at("raised", "net");
    assert!(other.wait_live(&of_25));
    drop(page);
    assert!(!other.wait_live(&of_27));
    served.watch.run_until_ok();
    assert!(project.doll_text(27.0) == std::fs::read_to_string(project.graph()).unwrap());
    project.assert_outputs_are_right();
    served.watch.end();
}
