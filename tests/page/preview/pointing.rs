//! The server's answers to questions about the position under the pointer.

use super::*;

#[test]
fn a_probe_says_what_inspect_says() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let (mut page, mut other) = (served.page(), served.page());
    let values = [("scan", "color"), ("scan", "range"), ("red", "mask"), ("spots", "labels")];
    let views = values.map(|(node, output)| json!({ "node": node, "output": output }));
    page.say(&json!({ "ask": "views", "views": views }));
    values.iter().for_each(|_| drop(page.wait("value")));
    let mut told = 0;
    for (id, (node, output)) in values.into_iter().enumerate() {
        for [column, row] in [[200, 210], [120, 133], [3, 399], [400, 0], [0, usize::MAX]] {
            let at = json!({ "at": [column, row] });
            let answer = page.ask("probe", id as u64, node, output, &at);
            let (name, at) = (format!("{node}.{output}"), format!("{column},{row}"));
            let inspected =
                project.maquette(&["inspect", "doll.ron", &name, "--at", &at, "--json"]);
            match serde_json::from_slice::<Json>(&inspected.stdout) {
                Ok(inspected) => {
                    assert_eq!(answer["facts"], inspected["outputs"][0]["facts"], "{name} {at}");
                    told += 1;
                }
                Err(_) => {
                    let why = answer["why"].as_str().unwrap();
                    assert!(String::from_utf8_lossy(&inspected.stderr).contains(why), "{answer}");
                }
            }
        }
    }
    assert!((9..16).contains(&told), "{told}");
    let nobody = page.ask("probe", 7, "whole", "range", &json!({ "at": [1, 1] }));
    assert!(nobody["why"].as_str().unwrap().contains("no page views"), "{nobody}");
    // Invalid numbers and names are harmless. A page that asks too fast gets answers to some requests, and always to the latest one.
    for at in [json!([-1, 0]), json!([0.5, 1]), json!([1]), json!("1,1"), json!(null)] {
        page.say(&json!({ "ask": "probe", "id": 8, "node": "red", "output": "mask", "at": at }));
    }
    page.ask("probe", 9, "../doll.ron", "\u{0}", &json!({ "at": [1, 1] }));
    for id in 10..2000 {
        page.say(&json!({ "ask": "probe", "id": id, "node": "red", "output": "mask", "at": [id % 400, 7] }));
    }
    let (mut answered, mut last) = (0, 0);
    while last < 1999 {
        let id = page.wait("probe")["id"].as_u64().unwrap();
        assert!(last < id && 10 <= id);
        (answered, last) = (answered + 1, id);
    }
    assert!(answered < 1990, "every question was answered");
    // Other pages get none of these answers.
    other.say(&json!({ "ask": "views", "views": [{ "node": "normal", "output": "normal" }] }));
    loop {
        let message = other.next();
        assert_ne!(message["event"], "probe");
        if message["event"] == "value" && message["node"] == "normal" {
            break;
        }
    }
    served.watch.end();
}

/// Computes the example graph `doll.ron` in this process and returns the mesh of a node.
pub(crate) fn mesh_of(project: &Project, node: &str) -> Mesh {
    let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory()).unwrap();
    let graph = session.load(&project.graph(), &Options::default()).graph.unwrap();
    let wanted = Targets::Named(vec![node.to_owned()]);
    let Ok(done) = session.run(&graph, &Run { targets: wanted, ..Run::default() }) else {
        panic!()
    };
    done.get::<Mesh>(node).unwrap().clone()
}

/// Returns the first triangle that a ray hits, and the hit point, by solving the linear system of each triangle.
fn first_hit(mesh: &Mesh, origin: Point3<f64>, to: Vector3<f64>) -> Option<(usize, Point3<f64>)> {
    let faces = mesh.faces().as_triangles().unwrap().iter().enumerate();
    let hits = faces.filter_map(|(face, corners)| {
        let [a, b, c] = corners.map(|corner| mesh.positions()[corner as usize]);
        let solved = Matrix3::from_columns(&[b - a, c - a, -to]).try_inverse()? * (origin - a);
        let is_met = solved.min() >= 0.0 && solved.x + solved.y <= 1.0;
        is_met.then_some((solved.z, face))
    });
    let (along, face) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((face, origin + to * along))
}

#[test]
fn a_pick_meets_the_face_and_vertex_that_a_look_at_all_of_them_meets() {
    let project = Project::doll();
    let mut served = Server::new(&project);
    served.watch.run_until_ok();
    let mut page = served.page();
    page.look_at("model", "mesh");
    page.wait("value");
    let mesh = mesh_of(&project, "model");
    let faces = mesh.faces().as_triangles().unwrap();
    let mut hits = 0;
    for k in 0..40_usize {
        let [a, b, c] = faces[k * 997 % faces.len()].map(|v| mesh.positions()[v as usize].coords);
        let aim = Point3::from(a * 0.5 + b * 0.3 + c * 0.2);
        let turn = k as f64;
        let origin = aim + Vector3::new(libm::sin(turn) * 40.0, libm::cos(turn) * 30.0, -300.0);
        // Some rays miss the mesh.
        let to = if k % 8 == 7 { Vector3::new(1.0, 0.2, 0.0) } else { (aim - origin) * 0.01 };
        let ray = json!({ "origin": origin.coords.as_slice(), "direction": to.as_slice() });
        let answer = page.ask("pick", k as u64, "model", "mesh", &ray);
        let Some((face, place)) = first_hit(&mesh, origin, to) else {
            assert_eq!(answer["nothing"], true, "{answer}");
            continue;
        };
        hits += 1;
        assert_eq!((&answer["kind"], &answer["face"]), (&json!("triangles"), &json!(face)));
        fn point(name: &str, answer: &Json) -> Point3<f64> {
            Point3::from(serde_json::from_value::<[f64; 3]>(answer[name].clone()).unwrap())
        }
        assert!((point("at", &answer) - place).norm() < 1e-6, "{answer} {place}");
        fn far(v: &u32, mesh: &Mesh, place: Point3<f64>) -> f64 {
            (mesh.positions()[*v as usize] - place).norm()
        }
        let nearest = *faces[face]
            .iter()
            .min_by(|a, b| far(a, &mesh, place).total_cmp(&far(b, &mesh, place)))
            .unwrap();
        assert_eq!(answer["vertex"], nearest, "{answer}");
        assert_eq!(point("vertex_at", &answer), mesh.positions()[nearest as usize]);
        let told = mesh.vertex().iter().chain(mesh.corner().iter()).map(|(name, _)| name);
        let (of_vertex, of_corner) = (&answer["attributes"], &answer["corner_attributes"]);
        assert!(
            told.count() > 0 && (of_vertex.get("uv").or(of_corner.get("uv"))).is_some(),
            "{answer}"
        );
    }
    assert!((20..40).contains(&hits), "{hits}");
    // Rays that are invalid, or that ask for a value that is not viewed, are harmless.
    let ray = json!({ "origin": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0] });
    for (node, output) in [("scan", "color"), ("", ""), ("model", "color")] {
        assert_eq!(page.ask("pick", 50, node, output, &ray)["nothing"], true);
    }
    for direction in [json!([0.0, 0.0, 0.0]), json!([1e308, 1e308, 1e308])] {
        let ray = json!({ "origin": [0.0, 0.0, 0.0], "direction": direction });
        assert_eq!(page.ask("pick", 51, "model", "mesh", &ray)["nothing"], true, "{direction}");
    }
    for origin in ["[1e999, 0, 0]", "[0, 0]", "[null, 0, 0]", "\"0,0,0\"", "[NaN, 0, 0]"] {
        let question = format!(
            r#"{{"ask": "pick", "id": 52, "node": "model", "output": "mesh", "origin": {origin}, "direction": [0, 0, 1]}}"#
        );
        page.0.send(Message::text(question)).unwrap();
    }
    let mut ray = ray;
    ray["radius"] = json!(-5.0);
    assert_eq!(page.ask("pick", 53, "model", "mesh", &ray)["id"], 53);
    // A net has no faces, so its nearest point is found.
    page.look_at("raised", "net");
    page.wait("value");
    let ray = json!({ "origin": [0.0, 0.0, -10.0], "direction": [0.0, 0.0, 1.0], "radius": 0.9 });
    let found = page.ask("pick", 54, "raised", "net", &ray);
    assert!(found["kind"].is_string() && found["vertex"].is_u64(), "{found}");
    served.watch.end();
}
