//! Materials that a host passes come back unchanged, with their pictures.

use std::fs;

use serde_json::{Value as Json, json};

use super::{CORNERS, FACES, FINE, Host, tetrahedron};
use crate::project::Project;

/// Starts a host that has put a picture and a tetrahedron with texture coordinates into the exchange folder; returns the host and the
/// picture.
fn painter(project: &Project) -> (Host, Vec<u8>) {
    project.copy_asset("color.png", "wood.png");
    let host = Host::start(project);
    let wood = fs::read(project.folder().join("wood.png")).unwrap();
    host.put("in-1", &CORNERS);
    host.put("in-2", &FACES);
    host.put("in-3", &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0f64]]);
    host.put("in-4", &[0u32, 1, 1, 0]);
    host.put("in-5", &wood);
    (host, wood)
}

fn paint(materials: &Json) -> Json {
    let mut input = tetrahedron();
    let columns = input["columns"].as_array_mut().unwrap();
    columns.push(json!({ "name": "uv", "on": "vertex", "meaning": "number", "width": 2, "type": "f64", "file": "in-3" }));
    columns.push(json!({ "name": "face material", "on": "face", "meaning": "exact", "type": "u32", "file": "in-4" }));
    input["materials"] = materials.clone();
    input
}

/// Runs the graph with this input value, and returns the resulting mesh.
fn fine(host: &mut Host, value: &Json) -> Json {
    let want = json!([{ "value": "fine", "as": "mesh" }]);
    let run = json!({ "graph": "doll.ron", "inputs": { "mesh": value }, "want": want });
    host.ask("run", run)["values"]["fine"].clone()
}

#[test]
fn materials_come_back_with_their_pictures() {
    let project = Project::new(FINE);
    let (mut host, wood) = painter(&project);
    let plain = json!({
        "name": "red", "base_color": [0.5, 0.0, 0.0, 0.25], "metallic": 1.0, "roughness": 0.5, "emissive": [0.0, 0.0, 0.125],
        "transparency": { "cutoff": 0.5 }, "double_sided": false, "vertex_colors": true, "maps": {},
    });
    let picture = json!({
        "file": "in-5", "name": "wood.png", "strength": 0.5, "channel": 1, "uv": "uv", "wrap": ["mirror", "clamp"],
    });
    let wooden = json!({
        "name": "wood",
        "maps": { "base color": { "file": "in-5" }, "roughness": picture },
    });
    let value = host.ask("input", paint(&json!([plain, wooden])))["value"].clone();
    let told = fine(&mut host, &value);
    let materials = told["materials"].as_array().unwrap();
    assert_eq!(materials[0], plain);
    let told = &materials[1];
    assert_eq!((&told["name"], &told["roughness"]), (&json!("wood"), &json!(0.9)));
    for map in ["base color", "roughness"] {
        assert_eq!(host.bytes(&told["maps"][map]), wood, "{map}");
    }
    let mut same = told["maps"]["roughness"].clone();
    same["file"] = "in-5".into();
    assert_eq!(same, picture);
    let size = told["picture"]["size"].as_array().unwrap();
    assert!(size.iter().all(|side| side.as_u64() > Some(100)), "{told}");
    assert!(host.bytes(&told["picture"]).starts_with(b"\x89PNG"));
    // The second answer refers to the existing file, because the picture is equal.
    assert_eq!(fine(&mut host, &value)["materials"][1], *told);
    // A material with no more than a picture is returned as a texture.
    let value = host.ask("input", paint(&json!([{}])))["value"].clone();
    assert_eq!(fine(&mut host, &value)["materials"], Json::Null);
}

#[test]
fn a_material_that_cannot_be_is_refused_with_its_name() {
    let project = Project::new(FINE);
    let (mut host, _) = painter(&project);
    for (material, why) in [
        (
            json!({ "name": "wood", "metallic": 1.5 }),
            "`wood`: expected numbers from 0 to 1, found 1.5",
        ),
        (
            json!({ "name": "wood", "maps": { "normal": { "file": "in-1" } } }),
            "`wood`: expected a picture in in-1",
        ),
        (json!({ "maps": { "normal": { "file": "in-9" } } }), "in-9"),
        (
            json!({ "maps": { "normal": { "file": "in-5", "channel": 3 } } }),
            "expected a channel from 0 to 2",
        ),
        (json!({ "transparency": "glass" }), "unknown variant `glass`"),
        (json!({ "picture": "in-5" }), "unknown field `picture`"),
    ] {
        let told = host.refusal("input", paint(&json!([material])));
        assert!(told.contains(why), "{told}");
    }
    let curve = json!({ "type": "Curve", "facts": { "closed": false }, "materials": [{}], "columns": [
        { "name": "point", "on": "point", "meaning": "position", "width": 3, "type": "f64", "file": "in-1" },
    ] });
    assert_eq!(host.refusal("input", curve), "a Curve has no materials");
}
