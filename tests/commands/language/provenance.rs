//! Output files record how they were made, and can be made again from this record.

use std::collections::BTreeMap;

use serde_json::Value as Json;

use crate::output::text_of;
use crate::project::Project;

/// A graph that writes all formats. Some of the outputs depend on a parameter.
const GRAPH: &str = r#"Graph(
    format: 1,
    params: { "height": Number(default: 10.0, min: 0.0, max: 90.0, unit: "mm", doc: "How high.") },
    nodes: {
        "mesh": ReadMesh(path: "doll/coarse.obj"),
        "lifted": Transform(mesh: "mesh", translate: (0, Param("height"), 0)),
        "scan": ReadRange(path: "doll/range.pcd"),
        "color": ReadImage(path: "doll/color.png"),
        "net": PointNet(points: [[(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 0), (1, 1, 1), (2, 1, 0)], [(0, 2, 0), (1, 2, 0), (2, 2, 0)]]),
        "surface": Nurbs(net: "net"),
    },
    outputs: {
        "lifted.glb": "lifted", "lifted.ply": "lifted", "lifted.obj": "lifted", "lifted.stl": "lifted",
        "scan.pcd": "scan", "scan.ptx": "scan", "color.png": "color", "surface.step": "surface", "net.json": "net",
    },
)"#;

fn project() -> Project {
    let project = Project::doll();
    project.copy_asset("coarse.obj", "doll/coarse.obj");
    project.save(GRAPH);
    project
}

fn run(project: &Project, more: &[&str]) -> BTreeMap<String, Vec<u8>> {
    let words = [&["run", "doll.ron", "--out", "out"], more].concat();
    let output = project.maquette(&words);
    assert!(output.status.success(), "{}", text_of(&output));
    project.outputs()
}

fn replay(project: &Project, name: &str) -> (String, bool) {
    let output = project.maquette(&["replay", &format!("out/{name}"), "--graph", "doll.ron"]);
    (text_of(&output), output.status.success())
}

/// Returns the provenance record in the JSON document of a GLB file.
fn asset(bytes: &[u8]) -> Json {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let document: Json = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    document["asset"]["extras"]["maquette"].clone()
}

#[test]
fn every_output_is_made_again_with_the_same_bytes() {
    let project = project();
    let outputs = run(&project, &["--set", "height=25", "--set", "lifted.scale=(1, 2, 1)"]);
    for name in outputs.keys() {
        let (text, is_same) = replay(&project, name);
        match &name[..] {
            "scan.ptx" => assert!(text.contains("contains no provenance"), "{text}"),
            // An STL file has room only for a hash of the provenance, so the values that were set cannot be found.
            "lifted.stl" => assert!(!is_same && text.contains("only a hash"), "{text}"),
            _ => assert!(is_same && text.contains("with the same bytes"), "{name}: {text}"),
        }
    }
    let output = project.maquette(&["replay", "out/lifted.glb"]);
    assert!(output.status.success(), "it knows its graph: {}", text_of(&output));
    let told = asset(&outputs["lifted.glb"]);
    assert_eq!((&told["graph"], &told["output"]), (&"doll.ron".into(), &"lifted.glb".into()));
    assert_eq!(told["parameters"]["height"], 25);
    assert_eq!(told["set"]["lifted.scale"], "(1, 2, 1)");
    assert!(told["files"]["doll/coarse.obj"].is_string() && told["packs"]["mesh"].is_string());
    assert!(told.to_string().len() < 600, "{told}");
    let place = project.folder().display().to_string();
    assert!(!told.to_string().contains(&place), "{told}");
    let stl = run(&project, &[]);
    assert_ne!(stl["lifted.stl"], outputs["lifted.stl"]);
    assert!(replay(&project, "lifted.stl").1);
}

#[test]
fn a_draft_is_made_again_as_one() {
    let project = project();
    let text = std::fs::read_to_string(project.graph()).unwrap();
    project.save(&text.replace("Param(\"height\")", "Draft(final: 9.0, draft: 1.0)"));
    let outputs = run(&project, &["--draft"]);
    assert_eq!(asset(&outputs["lifted.glb"])["draft"], true);
    assert!(replay(&project, "lifted.glb").1);
    assert_eq!(asset(&run(&project, &[])["lifted.glb"])["draft"], Json::Null);
}

#[test]
fn a_parameter_tells_no_path_out_of_the_project() {
    let project = project();
    let elsewhere = tempfile::tempdir_in(project.folder().parent().unwrap()).unwrap();
    let folder = elsewhere.path().file_name().unwrap().to_str().unwrap();
    let other = elsewhere.path().join("other.obj");
    std::fs::copy(project.folder().join("doll/coarse.obj"), &other).unwrap();
    project.save(
        r#"Graph(format: 1, params: { "file": Text(default: "doll/coarse.obj") },
            nodes: { "a": ReadMesh(path: Param("file")), "b": ReadMesh(path: "doll/coarse.obj") },
            outputs: { "a.ply": "a", "b.ply": "b" })"#,
    );
    let (other, root) = (format!("../{folder}/other.obj"), elsewhere.path().display().to_string());
    let (file, path) = (format!("file={other}"), format!("b.path={other}"));
    let outputs = run(&project, &["--set", &file, "--set", &path, "--root", &root]);
    for (name, bytes) in &outputs {
        let head = String::from_utf8_lossy(&bytes[..600]).into_owned();
        assert!(head.contains("\"other.obj\"") && !head.contains(folder), "{name}: {head}");
        let file = format!("out/{name}");
        let words = ["replay", &file, "--graph", "doll.ron", "--root", &root];
        let set = if name == "a.ply" { format!("file={other}") } else { format!("b.path={other}") };
        let replayed = project.maquette(&[&words[..], &["--set", &set]].concat());
        assert!(replayed.status.success(), "{}", text_of(&replayed));
    }
}
