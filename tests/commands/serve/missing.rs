//! If one input file is missing, only the values that depend on it fail, for a host as on the command line.

use serde_json::{Value as Json, json};

use super::Host;
use crate::missing_files::project;
use crate::project::TETRAHEDRON;

/// Returns the severity and the message of each diagnostic.
fn problems(answer: &Json) -> Vec<(&str, &str)> {
    let problems = answer["problems"].as_array().unwrap().iter();
    problems.map(|it| (it["severity"].as_str().unwrap(), it["message"].as_str().unwrap())).collect()
}

const MESSAGE: &str = "there is no file `tte.obj`";

#[test]
fn only_what_depends_on_a_missing_file_fails() {
    let project = project();
    let mut host = Host::start(&project);
    for asked in ["load", "outline"] {
        let told = host.ask(asked, json!({ "graph": "doll.ron" }));
        let warning = vec![("warning", MESSAGE)];
        assert_eq!((&told["ok"], problems(&told)), (&json!(true), warning), "{asked}");
    }
    // Checks a run: the values that are requested, those in the answer, and the states of the nodes on which they depend.
    fn check(
        want: Option<&[&str]>,
        set: Json,
        given: &[&str],
        nodes: &[(&str, &str)],
        host: &mut Host,
    ) {
        let mut wish = json!({ "graph": "doll.ron", "set": set });
        if let Some(want) = want {
            wish["want"] =
                want.iter().map(|value| json!({ "value": value, "as": "facts" })).collect();
        }
        let told = host.ask("run", wish);
        let is_right = nodes.iter().all(|(_, state)| !matches!(*state, "failed" | "skipped"));
        let severity = if is_right { "warning" } else { "error" };
        assert_eq!((&told["ok"], problems(&told)), (&json!(is_right), vec![(severity, MESSAGE)]));
        let mut values: Vec<_> = told["values"].as_object().unwrap().keys().collect();
        values.sort();
        assert_eq!(values, given, "{told}");
        let states = told["nodes"].as_array().unwrap().iter();
        let state =
            |node: &Json| [&node["name"], &node["state"]].map(|it| it.as_str().unwrap().to_owned());
        let states: Vec<_> = states.map(state).collect();
        let expected = nodes.iter().map(|(name, state)| [(*name).to_owned(), (*state).to_owned()]);
        assert_eq!(states, Vec::from_iter(expected));
    }
    check(Some(&["good.obj"]), json!({}), &["good.obj"], &[("good", "computed")], &mut host);
    check(Some(&["chosen.obj"]), json!({}), &["chosen.obj"], &[("good", "cached")], &mut host);
    let failed = [("bad", "failed"), ("moved", "skipped")];
    check(Some(&["bad.obj"]), json!({}), &[], &failed, &mut host);
    check(Some(&["chosen.obj"]), json!({ "which": "Bad" }), &[], &failed, &mut host);
    let all = [("good", "cached"), failed[0], failed[1]];
    check(None, json!({}), &["chosen.obj", "good.obj"], &all, &mut host);
    let why = host.ask("why", json!({ "graph": "doll.ron", "node": "moved" }));
    assert!(why["why"].as_str().unwrap().contains("tte.obj"), "{why}");

    project.write("tte.obj", TETRAHEDRON.replace('9', "8"));
    let told = host.ask("run", json!({ "graph": "doll.ron" }));
    assert_eq!((&told["ok"], problems(&told)), (&json!(true), Vec::new()), "{told}");
    assert_eq!(told["values"].as_object().unwrap().len(), 3, "{told}");
}
