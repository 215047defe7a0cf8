//! The outline of a graph that `outline` returns, and edits that are based on it, as a node editor makes them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, iter};

use serde_json::{Value as Json, json};

use super::Host;
use crate::beside::shared_folder;
use crate::project::Project;
use crate::thorough::is_thorough;

/// Copies the text files of a folder and its subfolders, and lists the graphs among them.
fn copy(from: &Path, to: &Path, graphs: &mut Vec<PathBuf>) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let copied = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &copied, graphs);
            continue;
        }
        let Ok(text) = fs::read_to_string(&path) else { continue };
        if path.extension().is_some_and(|it| it == "ron" || it == "toml") {
            fs::write(&copied, &text).unwrap();
        }
        if path.extension().is_some_and(|it| it == "ron") && text.contains("Graph(") {
            graphs.push(copied);
        }
    }
}

/// Copies all graphs of the project, and those in `../shared/graphs` if this folder exists, into a temporary project.
fn graphs(project: &Project) -> Vec<PathBuf> {
    let mut graphs = Vec::new();
    project.write("maquette.toml", "");
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs");
    let folders = iter::once(own).chain(shared_folder("graphs"));
    for (index, folder) in folders.enumerate() {
        copy(&folder, &project.folder().join(format!("graphs-{index}")), &mut graphs);
    }
    graphs.sort();
    assert!(graphs.len() > 20, "{graphs:?}");
    graphs
}

fn texts(list: &Json) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|it| it.as_str().unwrap()).collect()
}

/// Returns the items of a list, or an empty slice if the value is not a list.
fn list(of: &Json) -> &[Json] {
    of.as_array().map_or(&[], Vec::as_slice)
}

/// Returns the links of a node as pairs of port and target.
fn links(node: &Json) -> Vec<(String, String)> {
    fn text(it: &Json) -> String {
        it.as_str().unwrap().to_owned()
    }
    list(&node["links"]).iter().map(|link| (text(&link["port"]), text(&link["to"]))).collect()
}

fn edit(graph: &Path, edit: Json, dry: bool) -> Json {
    json!({ "graph": graph, "edits": [edit], "dry": dry })
}

/// Sends a request and returns the answer, or the reason of the refusal.
fn ask(host: &mut Host, what: &str, fields: Json) -> Result<Json, String> {
    let id = host.send(what, fields);
    let end = host.end(&id);
    match end["event"].as_str() {
        Some("answer") => Ok(end),
        _ => Err(format!("{} {}", end["why"], end["problems"])),
    }
}

#[test]
fn each_link_and_field_of_each_graph_is_where_edits_find_it() {
    let project = Project::new("");
    let mut host = Host::start(&project);
    let mut seen = BTreeMap::from([("links", 0), ("fields", 0), ("unlinked", 0)]);
    let step = if is_thorough() { 1 } else { 4 };
    for graph in graphs(&project).iter().step_by(step) {
        let told = host.ask("outline", json!({ "graph": graph }));
        let text = fs::read_to_string(graph).unwrap();
        assert_eq!(told["text"], text);
        let outline = &told["outline"];
        for node in list(&outline["nodes"]) {
            let name = node["name"].as_str().unwrap();
            if list(&outline["nodes"]).iter().filter(|other| other["name"] == name).count() > 1 {
                // Skip nodes whose name occurs twice. This is an error in the graph, and an edit cannot tell which of the nodes is meant.
                continue;
            }
            fn takes_list(port: &str, text: &str) -> bool {
                text.contains(&format!("{port}: \""))
            }
            for (port, to) in links(node) {
                let way = format!("{name}.{port}");
                let linked = json!({ "link": { "port": way, "to": to } });
                match ask(&mut host, "edit", edit(graph, linked, true)) {
                    Ok(done) if done["text"] == text => {}
                    // The port accepts many links but has only one, written without a list. So linking the port without an index appends a
                    // second link.
                    Ok(_) => {
                        let linked = json!({ "link": { "port": format!("{way}.0"), "to": to } });
                        let done = ask(&mut host, "edit", edit(graph, linked, true)).unwrap();
                        assert_eq!(done["text"], text, "{way}");
                        assert!(takes_list(&port, &text), "{way}");
                    }
                    Err(why) => assert!(why.contains("a patch has"), "{graph:?} {way}: {why}"),
                }
                *seen.get_mut("links").unwrap() += 1;
                let unlinked = edit(graph, json!({ "unlink": { "port": way } }), true);
                let Ok(done) = ask(&mut host, "edit", unlinked) else { continue };
                let new = host.ask("outline", json!({ "graph": graph, "text": done["text"] }));
                let new = list(&new["outline"]["nodes"])
                    .iter()
                    .find(|node| node["name"] == name)
                    .unwrap()
                    .clone();
                assert_eq!(links(&new).len() + 1, links(node).len(), "{graph:?} {way}");
                *seen.get_mut("unlinked").unwrap() += 1;
            }
            for field in list(&node["fields"]) {
                let [field, value] = texts(field)[..] else { panic!("{field}") };
                let set = json!({ "set": { "target": format!("{name}.{field}"), "value": value } });
                match ask(&mut host, "edit", edit(graph, set, true)) {
                    Ok(done) => assert_eq!(done["text"], text, "{graph:?} {name}.{field}"),
                    Err(why) => {
                        let known = [
                            "a patch has",
                            "a parameter of the graph",
                            "is computed by",
                            "has no node",
                            "lies outside",
                        ];
                        assert!(
                            known.iter().any(|it| why.contains(it)),
                            "{graph:?} {name}.{field}: {why}"
                        );
                    }
                }
                *seen.get_mut("fields").unwrap() += 1;
            }
        }
    }
    assert!(seen.values().all(|&count| count * step > 150), "{seen:?}");
}

/// A pseudorandom generator that gives the same numbers in each run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % sides.max(1)
    }

    fn pick<'a, T>(&mut self, all: &'a [T]) -> Option<&'a T> {
        all.get(self.roll(all.len()))
    }
}

/// Returns a random edit that refers to parts of the outline; it may be invalid.
fn random_edit(outline: &Json, dice: &mut Dice) -> Option<Json> {
    let nodes = list(&outline["nodes"]);
    fn name(node: &Json) -> String {
        node["name"].as_str().unwrap().to_owned()
    }
    let node = dice.pick(nodes)?.clone();
    let other = dice.pick(nodes)?.clone();
    fn port(dice: &mut Dice, node: &Json) -> Option<String> {
        let known = links(node);
        let linked = dice.pick(&known).map(|(port, _)| port.clone());
        let port = dice.pick(&texts(&node["ports"])).map(|port| (*port).to_owned());
        Some(format!("{}.{}", name(node), if dice.roll(2) == 0 { linked.or(port)? } else { port? }))
    }
    Some(match dice.roll(7) {
        0 => json!({ "remove": { "name": name(&node), "and_links": dice.roll(3) > 0 } }),
        1 => json!({ "rename": { "from": name(&node), "to": format!("n-{}", dice.roll(40)) } }),
        2 | 3 => {
            let output = dice.pick(list(&other["outputs"])).map(|it| it["name"].as_str().unwrap());
            let to = output.filter(|it| !it.is_empty()).map(|it| format!(".{it}"));
            json!({ "link": { "port": port(dice, &node)?, "to": name(&other) + &to.unwrap_or_default() } })
        }
        4 => json!({ "unlink": { "port": port(dice, &node)? } }),
        5 => {
            let fields: Vec<_> = list(&node["fields"]).iter().map(texts).collect();
            let fields = fields.iter().map(|field| [field[0], field[1]]);
            let to = format!("n-{}", dice.roll(40));
            json!({ "add": { "name": to, "node": node["type"], "fields": Vec::from_iter(fields), "after": name(&other) } })
        }
        _ => {
            let field = dice.pick(list(&node["fields"]))?.clone();
            let value = dice.pick(&["1", "0.5", "Loop", "\"x\"", "nothing"]).copied();
            json!({ "set": { "target": format!("{}.{}", name(&node), texts(&field)[0]), "value": value } })
        }
    })
}

/// Number of edits that are tried on each graph. `tests/engine/edits/law.rs` tries more.
const EDITS: usize = 20;

#[test]
fn random_edits_leave_what_the_answer_says_or_nothing_and_all_are_taken_back() {
    let project = Project::new("");
    let mut host = Host::start(&project);
    let (mut done, mut refused) = (0, 0);
    for graph in graphs(&project) {
        let first = fs::read_to_string(&graph).unwrap();
        let mut dice = Dice(first.len() as u64);
        let mut texts = vec![first.clone()];
        let mut told = host.ask("outline", json!({ "graph": graph }));
        for _ in 0..EDITS {
            let Some(random) = random_edit(&told["outline"], &mut dice) else { break };
            let known = texts.last().unwrap().clone();
            match ask(&mut host, "edit", edit(&graph, random.clone(), false)) {
                Ok(answer) => {
                    assert_eq!(answer["before"], known, "{graph:?} {random}");
                    let text = fs::read_to_string(&graph).unwrap();
                    assert_eq!(answer["text"], text, "{graph:?} {random}");
                    let was_ok = told["ok"] == true;
                    told = host.ask("outline", json!({ "graph": graph }));
                    assert!(
                        !was_ok || told["ok"] == true,
                        "{graph:?} {random}: {}",
                        told["problems"]
                    );
                    texts.push(text);
                    done += 1;
                }
                Err(why) => {
                    assert!(why.len() > 10, "{why}");
                    assert_eq!(fs::read_to_string(&graph).unwrap(), known, "{graph:?} {random}");
                    refused += 1;
                }
            }
        }
        while let Some(was) = texts.pop() {
            let Some(text) = texts.last() else { break };
            host.ask("put", json!({ "graph": graph, "was": was, "text": text }));
        }
        assert_eq!(fs::read_to_string(&graph).unwrap(), first);
    }
    assert!(done > 100 && refused > 100, "{done} done, {refused} refused");
}

#[test]
fn a_text_with_mistakes_has_an_outline_with_its_mistakes() {
    let text = "Graph(
    format: 1,
    inputs: { \"given\": Mesh(doc: \"what comes in\") },
    nodes: {
        // Makes it
        // smooth.
        \"fine\": Subdivide(mesh: \"given\", scheme: Loop), // not this one
        \"odd\": Oddity(mesh: \"fine\", with: \"gone.mask\"),

        \"last\": Subdivide(mesh: \"odd.thing\", levels: \"many\"),
    },
    outputs: { \"mesh\": \"last\", \"other\": \"nobody\" },
)
";
    let project = Project::new(text);
    let mut host = Host::start(&project);
    let told = host.ask("outline", json!({ "graph": "doll.ron" }));
    assert_eq!(told["ok"], false);
    assert!(list(&told["problems"]).len() >= 3, "{told}");
    let nodes = list(&told["outline"]["nodes"]);
    let node = |place: usize, key: &str| nodes[place][key].clone();
    assert_eq!((node(0, "line"), node(0, "column")), (json!(7), json!(9)));
    assert_eq!(node(0, "comment"), "Makes it\nsmooth.");
    assert_eq!(node(0, "text"), "Subdivide(mesh: \"given\", scheme: Loop)");
    assert_eq!(
        node(0, "links"),
        json!([{ "port": "mesh", "to": "given", "node": "given", "output": "" }])
    );
    assert_eq!(node(1, "comment"), "");
    let paragraphs: Vec<_> = nodes.iter().map(|node| node["paragraph"].clone()).collect();
    assert_eq!(paragraphs, [0, 0, 1]);
    // For a node of an unknown type, the outline contains only the facts in the text.
    assert_eq!((node(1, "type"), node(1, "ports")), (json!("Oddity"), json!([])));
    assert_eq!(links(&nodes[1]), [("mesh".into(), "fine".into())]);
    assert_eq!(node(1, "outputs"), json!([{ "name": "thing", "type": null }]));
    assert_eq!(node(2, "fields"), json!([["mesh", "\"odd.thing\""], ["levels", "\"many\""]]));
    let outputs = list(&told["outline"]["outputs"]);
    assert_eq!(outputs[1]["link"]["node"], "nobody");
    // A text with syntax errors has no outline.
    let told =
        host.ask("outline", json!({ "graph": "doll.ron", "text": "Graph(format: 1, nodes: {" }));
    assert_eq!(told["outline"], Json::Null);
    assert_eq!(told["ok"], false);
}

#[test]
fn where_nodes_were_put_is_kept_beside_the_graph_and_changes_nothing() {
    let text = "Graph(format: 1, inputs: { \"given\": Mesh(doc: \"what comes in\") }, nodes: { \"fine\": Subdivide(mesh: \"given\", \
                scheme: Loop) }, outputs: { \"mesh\": \"fine\" })\n";
    let project = Project::new(text);
    let mut host = Host::start(&project);
    let graph = json!({ "graph": "doll.ron" });
    let without = host.ask("outline", graph.clone());
    assert_eq!(without["layout"], Json::Null);

    let layout = json!({ "inputs": [0.0, -1.5], "nodes": { "fine": [1.25, 3.0], "gone": [2.0, 0.125] }, "outputs": null });
    host.ask("layout", json!({ "graph": "doll.ron", "layout": layout }));
    let kept = project.folder().join("doll.layout.ron");
    let written =
        "// Positions of the nodes of doll.ron in an editor. Nothing else depends on this file.
Layout(
    inputs: (0.0, -1.5),
    nodes: {
        \"fine\": (1.25, 3.0),
        \"gone\": (2.0, 0.125),
    },
    outputs: None,
)
";
    assert_eq!(fs::read_to_string(&kept).unwrap(), written);
    let mut with = host.ask("outline", graph.clone());
    assert_eq!(with["layout"], layout);
    // The layout affects only the positions of nodes in an editor, and its file may be deleted at any time.
    (with["layout"], with["id"]) = (Json::Null, without["id"].clone());
    assert_eq!(with, without);
    let moved = json!({ "nodes": { "fine": [0.0, 0.0] } });
    host.ask("layout", json!({ "graph": "doll.ron", "layout": moved }));
    assert_eq!(host.ask("outline", graph.clone())["layout"]["nodes"], moved["nodes"]);
    fs::remove_file(&kept).unwrap();
    assert_eq!(host.ask("outline", graph.clone())["layout"], Json::Null);
    assert_eq!(fs::read_to_string(project.folder().join("doll.ron")).unwrap(), text);

    // A file of another program is not replaced, even if it has the name of the layout file.
    for (other, place) in [(text, "1:1"), ("Layout(\n    nodes: 3,\n)\n", "2:12")] {
        fs::write(&kept, other).unwrap();
        let why = host.refusal("layout", json!({ "graph": "doll.ron", "layout": moved }));
        assert!(why.contains(&format!("doll.layout.ron:{place}: ")), "{why}");
        assert!(why.contains("fix or delete the file"), "{why}");
        assert_eq!(fs::read_to_string(&kept).unwrap(), other);
        let told = host.ask("outline", graph.clone());
        assert_eq!((&told["layout_why"], &told["layout"]), (&json!(why), &Json::Null));
        assert_eq!(told["ok"], true);
    }
}

#[test]
fn what_has_another_value_in_drafts_says_so() {
    let project = Project::doll();
    project.save(
        r#"Graph(format: 1, params: { "levels": Integer(default: Draft(final: 2, draft: 0)), "size": Number(default: 1.0) },
        nodes: { "net": PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, Draft(final: 1, draft: 0)), (1, 1, 0)]]),
        "s": Nurbs(net: "net", order: (2, 2)) }, outputs: { "s.ply": "s" })"#,
    );
    let mut host = Host::start(&project);
    let outline = &host.ask("outline", json!({ "graph": "doll.ron" }))["outline"];
    fn drafts(section: &str, outline: &Json) -> Vec<bool> {
        list(&outline[section]).iter().map(|it| it["draft"] == true).collect::<Vec<_>>()
    }
    assert_eq!(
        (drafts("params", outline), drafts("nodes", outline)),
        (vec![true, false], vec![true, false])
    );
    for (draft, default) in [(false, 2), (true, 0)] {
        let loaded = host.ask("load", json!({ "graph": "doll.ron", "draft": draft }));
        let levels = &loaded["schema"]["properties"]["levels"];
        assert_eq!(levels["draft"], json!({ "final": 2, "draft": 0 }), "{loaded}");
        assert_eq!(levels["default"], default);
        assert!(loaded["schema"]["properties"]["size"].get("draft").is_none());
    }
}
