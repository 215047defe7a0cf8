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
fn what_does_not_matter_changes_no_byte() {
    let project = project();
    let (outputs, times) = (run(&project, &[]), project.output_times());
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let renamed =
        text.replace("\"lifted\"", "\"higher\"").replace("        \"scan\"", "// Why?\n \"scan\"");
    let renamed = renamed.replace("        \"mesh\": ReadMesh(path: \"doll/coarse.obj\"),\n", "");
    let renamed = renamed.replace(
        "        \"surface\": Nurbs",
        "        \"mesh\": ReadMesh(path: \"doll/coarse.obj\"),\n        \"surface\": Nurbs",
    );
    project.save(&renamed);
    assert_eq!(run(&project, &[]), outputs);
    assert_eq!(project.output_times(), times);
    let lifted = run(&project, &["--set", "height=11"]);
    for (name, bytes) in &lifted {
        assert_eq!(outputs[name] != *bytes, name.starts_with("lifted"), "{name}");
    }
}

#[test]
fn what_differs_is_named() {
    let project = project();
    run(&project, &[]);
    let text = std::fs::read_to_string(project.graph()).unwrap();
    project.save(&text.replace("translate: (0, ", "translate: (1, "));
    let (told, is_same) = replay(&project, "lifted.glb");
    assert!(!is_same && told.contains("out/lifted.glb differs"), "{told}");
    assert!(told.contains("  the graph changed\n"), "{told}");
    project.save(&text);
    project.copy_asset("mug.obj", "doll/coarse.obj");
    let (told, _) = replay(&project, "lifted.ply");
    assert!(told.contains("  file `doll/coarse.obj` was "), "{told}");
    assert!(!told.contains("the graph changed"), "{told}");
    std::fs::write(project.folder().join("out/net.json"), "{}").unwrap();
    let (told, _) = replay(&project, "net.json");
    assert!(told.contains("contains no provenance"), "{told}");
}

#[test]
fn files_tell_nothing_if_they_must_not() {
    let project = project();
    for (name, bytes) in run(&project, &["--no-provenance"]) {
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert!(!text.contains("\"made\":"), "{name}");
    }
    let (told, is_known) = replay(&project, "lifted.glb");
    assert!(!is_known && told.contains("contains no provenance"), "{told}");
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
fn what_a_patch_in_another_folder_made_is_made_again() {
    let project = project();
    let text = std::fs::read_to_string(project.graph()).unwrap();
    let path = "\"doll/coarse.obj\"";
    assert!(text.contains(path), "{text}");
    let text = text
        .replace(path, "Param(\"file\")")
        .replace("params: {", "params: { \"file\": Text(default: \"doll/coarse.obj\"),");
    project.save(&text);
    std::fs::create_dir(project.folder().join("sub")).unwrap();
    let patch = "Patch(format: 1, of: \"../doll.ron\", params: { \"height\": 7.0 })";
    std::fs::write(project.folder().join("sub/high.ron"), patch).unwrap();
    let ran = project.maquette(&["run", "sub/high.ron", "--out", "out"]);
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let again = project.maquette(&["replay", "out/lifted.glb", "--graph", "sub/high.ron"]);
    assert!(again.status.success(), "{}", text_of(&again));
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

#[test]
fn a_file_is_made_again_from_whatever_folder() {
    let project = project();
    run(&project, &[]);
    let file = project.folder().join("out/lifted.glb").display().to_string();
    let elsewhere = tempfile::tempdir().unwrap();
    let replayed = project.command(&["replay", &file]).current_dir(elsewhere.path()).output();
    let replayed = replayed.unwrap();
    assert!(replayed.status.success(), "{}", text_of(&replayed));
}
