//! Merges the edits of two people in one graph. The result contains the edits of both. A conflict is only a part that both have changed
//! differently.

use maquette::{Catalog, Files, Graph, Merge, Options, Source};

/// A shortened version of the example graph `doll.ron`.
const BASE: &str = r##"// A doll's nose, grown from one scan.
Graph(
    format: 1,
    doc: "Lets the nose grow.",
    params: {
        "growth": Number(default: 12.0, min: 0.0, max: 40.0, unit: "mm", doc: "How far."),
        "levels": Integer(default: 1, min: 0, max: 4, doc: "Steps."),
    },
    nodes: {
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),

        // Where is the nose?
        "red": Threshold(image: "scan.color", select: Near(color: "#c33923", distance: 30.0)), // bright
        "spots": Label(mask: "red", connectivity: Eight),
        "nose": ExtractRegion(labels: "spots", range: "scan.range", pick: Largest),

        // Let it grow.
        "normal": AverageNormal(region: "nose", range: "scan.range"),
        "net": ControlNet(region: "nose", range: "scan.range"),
        "raised": OffsetNet(net: "net", normal: "normal", steps: [(distance: Param("growth"))]),
        "surface": Nurbs(net: "raised"),
        "blended": Blend(range: "scan.range", region: "nose", surface: "surface"),
        "grid": Triangulate(range: "blended"),
        "skin": Subdivide(mesh: "grid", scheme: Loop, levels: Param("levels")),
    },
    outputs: {
        "model.glb": "skin",
        "nose-mask.png": "red",
    },
    expect: [Closed("skin")],
)
"##;

/// Replaces parts of a text. Each part must occur exactly once.
fn replace_each(text: &str, edits: &[(&str, &str)]) -> String {
    let mut text = text.to_owned();
    for (old, new) in edits {
        assert_eq!(text.matches(old).count(), 1, "{old:?} in\n{text}");
        text = text.replacen(old, new, 1);
    }
    text
}

fn merge(base: &str, ours: &str, theirs: &str) -> Merge {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let [base, ours, theirs] =
        [base, ours, theirs].map(|text| Source { name: "graph.ron".into(), text: text.to_owned() });
    maquette::edit::merge("graph.ron".as_ref(), [&base, &ours, &theirs], &catalog)
}

type Edits = &'static [(&'static str, &'static str)];

/// The name of a case, the edits of one side, the edits of the other side, and the expected edits in the result. All edits are relative to
/// [`BASE`]. `None` means that the result contains the edits of both sides.
struct Case(&'static str, Edits, Edits, Option<Edits>);

const RED: &str = "color: \"#c33923\"";
const FAR: &str = "distance: 30.0";
const EIGHT: &str = "connectivity: Eight";
const GRID: &str = "        \"grid\": Triangulate(range: \"blended\"),\n";
const SKIN: &str =
    "        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n";
const MASK: &str = "        \"nose-mask.png\": \"red\",\n";
const LEVELS: &str = "        \"levels\": Integer(default: 1, min: 0, max: 4, doc: \"Steps.\"),\n";

#[rustfmt::skip] // One case a line, or nearly.
const CASES: &[Case] = &[
    // Cases of changed values.
    Case("values of two nodes", &[(FAR, "distance: 25.0")], &[(EIGHT, "connectivity: Four")], None),
    Case("two fields of a choice", &[(FAR, "distance: 25.0")], &[(RED, "color: \"#c34030\"")], None),
    Case("two fields of a node", &[("scheme: Loop", "scheme: CatmullClark")], &[("mesh: \"grid\", scheme", "mesh: \"grid\", limit: true, scheme")],
        Some(&[("scheme: Loop", "limit: true, scheme: CatmullClark")])),
    Case("a field each, added to one node", &[("range: \"blended\")", "range: \"blended\", jump: 5.0)")], &[("range: \"blended\")", "range: \"blended\", grazing: 80.0)")],
        Some(&[("range: \"blended\")", "range: \"blended\", grazing: 80.0, jump: 5.0)")])),
    Case("two parameters", &[("default: 12.0", "default: 9.0")], &[("default: 1,", "default: 2,")], None),
    Case("two fields of a parameter", &[("default: 12.0", "default: 9.0")], &[("max: 40.0", "max: 50.0")], None),
    Case("a parameter and a node", &[("default: 12.0", "default: 9.0")], &[(FAR, "distance: 25.0")], None),
    Case("the same value", &[(FAR, "distance: 25.0")], &[(FAR, "distance: 25.0")], Some(&[(FAR, "distance: 25.0")])),
    Case("the same value, written otherwise", &[(FAR, "distance: 25.0")], &[(FAR, "distance: 25")], Some(&[(FAR, "distance: 25.0")])),
    Case("only one changed something", &[], &[(FAR, "distance: 25.0")], None),
    Case("the other one did", &[(FAR, "distance: 25.0")], &[], None),
    Case("a link and a value of one node", &[("range: \"scan.range\", pick", "range: \"blended\", pick")], &[("pick: Largest", "pick: Smallest")], None),
    Case("what it is for, and an output", &[("Lets the nose", "Lets a nose")], &[("\"nose-mask.png\": \"red\"", "\"nose-mask.png\": \"spots\"")], None),
    Case("a choice of another kind, and a value elsewhere", &[("pick: Largest", "pick: Rank(2)")], &[(FAR, "distance: 25.0")], None),
    // Cases of added and removed nodes.
    Case("a node each, at different places", &[(GRID, "        \"grid\": Triangulate(range: \"blended\"),\n        \"fine\": Subdivide(mesh: \"grid\", scheme: Loop),\n")], &[("        \"spots\": L", "        \"edges\": Edges(image: \"scan.color\"),\n        \"spots\": L")], None),
    Case("a node each, at one place", &[(SKIN, "        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n        \"one\": Label(mask: \"red\"),\n")], &[(SKIN, "        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n        \"two\": Outline(mask: \"red\"),\n")],
        Some(&[(SKIN, "        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n        \"two\": Outline(mask: \"red\"),\n        \"one\": Label(mask: \"red\"),\n")])),
    Case("both add the same node", &[(GRID, "        \"grid\": Triangulate(range: \"blended\"),\n        \"one\": Label(mask: \"red\"),\n")], &[(SKIN, "        \"one\": Label(mask: \"red\"),\n        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n")],
        Some(&[(GRID, "        \"grid\": Triangulate(range: \"blended\"),\n        \"one\": Label(mask: \"red\"),\n")])),
    Case("both add the same node, written otherwise", &[(SKIN, "        \"one\": Label(mask: \"red\", connectivity: Eight),\n        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n")], &[(SKIN, "        \"one\": Label(connectivity: Eight, mask: \"red\"),\n        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n")],
        Some(&[(SKIN, "        \"one\": Label(mask: \"red\", connectivity: Eight),\n        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n")])),
    Case("a node is removed and another one changed", &[("    expect: [Closed(\"skin\")],\n", ""), (MASK, "")], &[(EIGHT, "connectivity: Four")], None),
    Case("both remove the same output", &[(MASK, "")], &[(MASK, "")], Some(&[(MASK, "")])),
    Case("one removes what the other only wrote otherwise", &[(MASK, "")], &[(MASK, "        \"nose-mask.png\":  \"red\",\n")], Some(&[(MASK, "")])),
    Case("outputs, one each", &[(MASK, "        \"nose-mask.png\": \"red\",\n        \"a.png\": \"red\",\n")], &[("        \"model.glb\"", "        \"b.png\": \"red\",\n        \"model.glb\"")], None),
    Case("parameters, one each", &[(LEVELS, "        \"levels\": Integer(default: 1, min: 0, max: 4, doc: \"Steps.\"),\n        \"a\": Toggle(default: true, doc: \"A.\"),\n")], &[("        \"growth\": N", "        \"b\": Toggle(default: true, doc: \"B.\"),\n        \"growth\": N")], None),
    Case("expectations, one each", &[("Closed(\"skin\")]", "Closed(\"skin\"), Closed(\"grid\")]")], &[("[Closed(\"skin\")", "[Closed(\"model.glb\"), Closed(\"skin\")")], None),
    Case("a section that was not there", &[("    params: {", "    inputs: {\"a\": Mesh(doc: \"A.\")},\n    params: {")], &[(FAR, "distance: 25.0")], None),
    Case("both add a section, with the same", &[("    params: {", "    packs: {\"a\": \"1\"},\n    params: {")], &[("    params: {", "    packs: {\"a\": \"1\"},\n    params: {")], Some(&[("    params: {", "    packs: {\"a\": \"1\"},\n    params: {")])),
    Case("both add a section, with different entries", &[("    params: {", "    packs: { \"a\": \"1\" },\n    params: {")], &[("    params: {", "    packs: { \"b\": \"1\" },\n    params: {")], Some(&[("    params: {", "    packs: { \"b\": \"1\", \"a\": \"1\" },\n    params: {")])),
    // Cases of changed names.
    Case("one renames a node, the other adds a link to it", &[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")], &[(MASK, "        \"nose-mask.png\": \"red\",\n        \"spots.png\": \"spots\",\n")],
        Some(&[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\""), (MASK, "        \"nose-mask.png\": \"red\",\n        \"spots.png\": \"patches\",\n")])),
    Case("the same the other way round", &[(MASK, "        \"nose-mask.png\": \"red\",\n        \"spots.png\": \"spots\",\n")], &[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")],
        Some(&[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\""), (MASK, "        \"nose-mask.png\": \"red\",\n        \"spots.png\": \"patches\",\n")])),
    Case("one renames a node, the other changes it", &[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")], &[(EIGHT, "connectivity: Four")], None),
    Case("both rename the same node alike", &[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")], &[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")], Some(&[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")])),
    Case("each renames another node", &[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")], &[("\"net\": C", "\"mesh\": C"), ("net: \"net\"", "net: \"mesh\"")], None),
    Case("one renames a parameter, the other uses it", &[("\"levels\": I", "\"steps\": I"), ("Param(\"levels\")", "Param(\"steps\")")], &[("pick: Largest", "pick: Rank(Param(\"levels\"))")],
        Some(&[("\"levels\": I", "\"steps\": I"), ("Param(\"levels\")", "Param(\"steps\")"), ("pick: Largest", "pick: Rank(Param(\"steps\"))")])),
    Case("one renames a parameter, the other has it in an expression", &[("pick: Largest", "pick: Rank(Expr(\"levels + 1\"))")], &[("\"levels\": I", "\"steps\": I"), ("Param(\"levels\")", "Param(\"steps\")")],
        Some(&[("\"levels\": I", "\"steps\": I"), ("Param(\"levels\")", "Param(\"steps\")"), ("pick: Largest", "pick: Rank(Expr(\"steps + 1\"))")])),
    // Cases of changed comments, formatting and order.
    Case("a comment and the node below it", &[("// Where is the nose?", "// Which is the nose?")], &[(FAR, "distance: 25.0")], None),
    Case("a comment behind a node and the node", &[("// bright", "// very bright")], &[(FAR, "distance: 25.0")], None),
    Case("a comment each, above one node", &[("// Where is the nose?\n", "// Where is the nose?\n        // In the middle.\n")], &[("// Where is the nose?\n", "// Where is the nose?\n        // It is red.\n")],
        Some(&[("// Where is the nose?\n", "// Where is the nose?\n        // In the middle.\n        // It is red.\n")])),
    Case("a comment above the graph, and a value", &[("// A doll's nose, grown", "// The nose of a doll, grown")], &[(FAR, "distance: 25.0")], None),
    Case("a comment above the graph, each", &[("from one scan.\n", "from one scan.\n// By A.\n")], &[(FAR, "distance: 25.0"), ("from one scan.\n", "from one scan.\n// By B.\n")],
        Some(&[(FAR, "distance: 25.0"), ("from one scan.\n", "from one scan.\n// By A.\n// By B.\n")])),
    Case("lines broken on one side", &[("Label(mask: \"red\", connectivity: Eight)", "Label(\n            mask: \"red\",\n            connectivity: Eight,\n        )")], &[(FAR, "distance: 25.0")], None),
    Case("lines broken on one side, a value of the same on the other", &[("Label(mask: \"red\", connectivity: Eight)", "Label(\n            mask: \"red\",\n            connectivity: Eight,\n        )")], &[(EIGHT, "connectivity: Four")],
        Some(&[("Label(mask: \"red\", connectivity: Eight)", "Label(\n            mask: \"red\",\n            connectivity: Four,\n        )")])),
    Case("reordering of fields is no change", &[("mask: \"red\", connectivity: Eight", "connectivity: Eight, mask: \"red\"")], &[(EIGHT, "connectivity: Four")],
        Some(&[("mask: \"red\", connectivity: Eight", "connectivity: Four, mask: \"red\"")])),
    Case("reordering of nodes is no change", &[(GRID, ""), (SKIN, "        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n        \"grid\": Triangulate(range: \"blended\"),\n")], &[("range: \"blended\")", "range: \"blended\", jump: 5.0)")],
        Some(&[(GRID, ""), (SKIN, "        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n        \"grid\": Triangulate(range: \"blended\", jump: 5.0),\n")])),
    Case("their reordering moves nothing", &[("range: \"blended\")", "range: \"blended\", jump: 5.0)")], &[(GRID, ""), (SKIN, "        \"skin\": Subdivide(mesh: \"grid\", scheme: Loop, levels: Param(\"levels\")),\n        \"grid\": Triangulate(range: \"blended\"),\n")],
        Some(&[("range: \"blended\")", "range: \"blended\", jump: 5.0)")])),
    Case("a number written otherwise is no change", &[(FAR, "distance: 30")], &[(FAR, "distance: 25.0")], Some(&[(FAR, "distance: 25.0")])),
    Case("a length in another unit is no change", &[("max: 40.0", "max: cm(4)")], &[("max: 40.0", "max: 50.0")], Some(&[("max: 40.0", "max: 50.0")])),
    Case("the same length in two units", &[("(distance: Param(\"growth\"))", "(distance: cm(0.4))")], &[("(distance: Param(\"growth\"))", "(distance: 4)")], Some(&[("(distance: Param(\"growth\"))", "(distance: cm(0.4))")])),
    Case("the same vector in two units", &[(SKIN, "        \"skin\": Transform(mesh: \"grid\", translate: (0, 0, 10)),\n")], &[(SKIN, "        \"skin\": Transform(mesh: \"grid\", translate: cm(0, 0, 1)),\n")],
        Some(&[(SKIN, "        \"skin\": Transform(mesh: \"grid\", translate: (0, 0, 10)),\n")])),
    Case("the same vector, a part of it in another unit", &[(SKIN, "        \"skin\": Transform(mesh: \"grid\", translate: cm(0, 0, 1)),\n")], &[(SKIN, "        \"skin\": Transform(mesh: \"grid\", translate: (0, 0, cm(1))),\n")],
        Some(&[(SKIN, "        \"skin\": Transform(mesh: \"grid\", translate: cm(0, 0, 1)),\n")])),
    // Cases of conflicts.
    Case("a value, differently", &[(FAR, "distance: 25.0")], &[(FAR, "distance: 20.0")],
        Some(&[("        \"red\": Threshold(image: \"scan.color\", select: Near(color: \"#c33923\", distance: 30.0)), // bright\n", "<<<<<<< ours\n        \"red\": Threshold(image: \"scan.color\", select: Near(color: \"#c33923\", distance: 25.0)), // bright\n=======\n        \"red\": Threshold(image: \"scan.color\", select: Near(color: \"#c33923\", distance: 20.0)), // bright\n>>>>>>> theirs\n")])),
    Case("a value, differently, with another value of the node", &[(FAR, "distance: 25.0")], &[(FAR, "distance: 20.0"), (RED, "color: \"#c34030\"")],
        Some(&[("        \"red\": Threshold(image: \"scan.color\", select: Near(color: \"#c33923\", distance: 30.0)), // bright\n", "<<<<<<< ours\n        \"red\": Threshold(image: \"scan.color\", select: Near(color: \"#c34030\", distance: 25.0)), // bright\n=======\n        \"red\": Threshold(image: \"scan.color\", select: Near(color: \"#c34030\", distance: 20.0)), // bright\n>>>>>>> theirs\n")])),
    Case("an output that one removes and the other changes", &[(MASK, "")], &[("\"nose-mask.png\": \"red\"", "\"nose-mask.png\": \"spots\"")],
        Some(&[(MASK, "<<<<<<< ours\n=======\n        \"nose-mask.png\": \"spots\",\n>>>>>>> theirs\n")])),
    Case("what it is for, differently", &[("Lets the nose", "Lets a nose")], &[("nose grow.", "nose shrink.")],
        Some(&[("    doc: \"Lets the nose grow.\",\n", "<<<<<<< ours\n    doc: \"Lets a nose grow.\",\n=======\n    doc: \"Lets the nose shrink.\",\n>>>>>>> theirs\n")])),
    Case("a node of one name, differently", &[(GRID, "        \"grid\": Triangulate(range: \"blended\"),\n        \"one\": Label(mask: \"red\"),\n")], &[(GRID, "        \"grid\": Triangulate(range: \"blended\"),\n        \"one\": Outline(mask: \"red\"),\n")],
        Some(&[(GRID, "        \"grid\": Triangulate(range: \"blended\"),\n<<<<<<< ours\n        \"one\": Label(mask: \"red\"),\n=======\n        \"one\": Outline(mask: \"red\"),\n>>>>>>> theirs\n")])),
    Case("a node that both rename, differently", &[("\"spots\": L", "\"patches\": L"), ("labels: \"spots\"", "labels: \"patches\"")], &[("\"spots\": L", "\"areas\": L"), ("labels: \"spots\"", "labels: \"areas\"")],
        Some(&[("        \"spots\": Label(mask: \"red\", connectivity: Eight),\n", "<<<<<<< ours\n        \"patches\": Label(mask: \"red\", connectivity: Eight),\n=======\n        \"areas\": Label(mask: \"red\", connectivity: Eight),\n>>>>>>> theirs\n"), ("labels: \"spots\"", "labels: \"areas\"")])),
];

#[test]
fn fifty_pairs_of_edits_give_what_both_meant() {
    assert!(CASES.len() >= 50, "{} cases", CASES.len());
    let mut wrong = Vec::new();
    for Case(name, by_us, by_them, result) in CASES {
        let (ours, theirs) = (replace_each(BASE, by_us), replace_each(BASE, by_them));
        let all = [*by_us, *by_them].concat();
        let expected = replace_each(BASE, result.unwrap_or(&all));
        let merged = merge(BASE, &ours, &theirs);
        let is_conflict = expected.contains("<<<<<<<");
        if merged.text != expected || merged.conflicts.is_empty() == is_conflict {
            wrong.push(format!("{name}: {:?}\n{}\n", merged.conflicts, merged.text));
        }
        assert!(merged.diagnostics.is_empty(), "{name}: {:?}", merged.diagnostics);
    }
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), CASES.len(), wrong.join("\n"));
}

#[test]
fn what_both_mean_is_the_same_whoever_merges() {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    fn source(text: String) -> Source {
        Source { name: "graph.ron".into(), text }
    }
    for Case(name, by_us, by_them, _) in CASES {
        let (ours, theirs) = (replace_each(BASE, by_us), replace_each(BASE, by_them));
        let (one, other) = (merge(BASE, &ours, &theirs), merge(BASE, &theirs, &ours));
        assert_eq!(one.conflicts, other.conflicts, "{name}");
        // Do not compare cases about expectations: their order has no meaning, but the two merged texts may have them in different orders.
        if one.conflicts.is_empty() && !name.starts_with("expectations") {
            let found = Graph::differences(&source(one.text), &source(other.text), &catalog);
            assert_eq!(found, Ok(vec![]), "{name}");
        }
    }
}

#[test]
fn a_problem_that_neither_side_had_is_told() {
    let ours = replace_each(
        BASE,
        &[(MASK, "        \"nose-mask.png\": \"red\",\n        \"a.png\": \"spots\",\n")],
    );
    let theirs = replace_each(
        BASE,
        &[
            ("        \"spots\": Label(mask: \"red\", connectivity: Eight),\n", ""),
            ("labels: \"spots\"", "labels: \"other\""),
            (
                "        \"nose\": E",
                "        \"other\": Label(mask: \"red\", connectivity: Four),\n        \"nose\": E",
            ),
        ],
    );
    // A node with a new name and new content does not count as a renamed node.
    let theirs =
        theirs.replace("Label(mask: \"red\", connectivity: Four)", "Outline(mask: \"red\")");
    let merged = merge(BASE, &ours, &theirs);
    assert_eq!(merged.conflicts, [""; 0]);
    let told: Vec<_> = merged.diagnostics.iter().map(|problem| &problem.message[..]).collect();
    assert_eq!(told, ["there is no node `spots`"]);
}

#[test]
fn texts_with_any_ends_of_lines_are_merged() {
    fn windows(text: &str) -> String {
        text.replace('\n', "\r\n")
    }
    let (ours, theirs) = (
        replace_each(BASE, &[(FAR, "distance: 25.0")]),
        replace_each(BASE, &[(EIGHT, "connectivity: Four")]),
    );
    let both = replace_each(BASE, &[(FAR, "distance: 25.0"), (EIGHT, "connectivity: Four")]);
    assert_eq!(merge(&windows(BASE), &windows(&ours), &windows(&theirs)).text, windows(&both));
}

#[test]
fn marks_end_their_lines_as_the_text_does() {
    fn windows(text: &str) -> String {
        text.replace('\n', "\r\n")
    }
    let (ours, theirs) = (
        replace_each(BASE, &[(FAR, "distance: 25.0")]),
        replace_each(BASE, &[(FAR, "distance: 20.0")]),
    );
    let marked = merge(BASE, &ours, &theirs).text;
    assert!(marked.contains("\n=======\n"), "{marked}");
    let merged = merge(&windows(BASE), &windows(&ours), &windows(&theirs));
    assert_eq!(merged.text, windows(&marked));
    // The result must have the line endings of the side that has changed them.
    let far =
        windows(&replace_each(BASE, &[(FAR, "distance: 25.0"), (EIGHT, "connectivity: Four")]));
    let four = replace_each(BASE, &[(EIGHT, "connectivity: Four")]);
    assert_eq!(merge(BASE, &windows(&ours), &four).text, far);
    assert_eq!(merge(BASE, &ours, &windows(&four)).text, far);
}

#[test]
fn an_expression_that_both_together_would_turn_into_another_is_a_conflict() {
    let named = "        \"growth-levels\": Number(default: 1.0, doc: \"Another.\"),\n";
    let ours = replace_each(BASE, &[("    params: {\n", &format!("    params: {{\n{named}"))]);
    let theirs = replace_each(BASE, &[(FAR, "distance: Expr(\"growth-levels\")")]);
    for (ours, theirs) in [(&ours, &theirs), (&theirs, &ours)] {
        let merged = merge(BASE, ours, theirs);
        assert_eq!(merged.conflicts, ["nodes.red"], "{}", merged.text);
        let [problem] = &merged.diagnostics[..] else { panic!("{:?}", merged.diagnostics) };
        assert_eq!(problem.code, "G011");
        let place = &merged.text[problem.span.start..problem.span.end];
        assert_eq!(place, "\"growth-levels\"", "{}", merged.text);
        assert_eq!(merged.text.matches(FAR).count(), 1, "{}", merged.text);
    }
    // There is no conflict: with spaces, `growth - levels` is a difference of two parameters, not the new name `growth-levels`.
    // `growth*levels` does not contain the new name at all.
    for other in ["growth - levels", "growth*levels"] {
        let theirs = replace_each(BASE, &[(FAR, &format!("distance: Expr(\"{other}\")"))]);
        assert_eq!(merge(BASE, &ours, &theirs).conflicts, [""; 0]);
    }
    // If the same side adds the parameter `growth-levels` and uses it in an expression, this is intended, so there is no conflict.
    let both = replace_each(&ours, &[(FAR, "distance: Expr(\"growth-levels\")")]);
    let theirs = replace_each(BASE, &[(EIGHT, "connectivity: Four")]);
    assert_eq!(merge(BASE, &both, &theirs).conflicts, [""; 0]);
}

#[test]
fn a_default_that_is_written_out_or_left_out_is_no_change() {
    let far = replace_each(BASE, &[(FAR, "distance: 20.0"), (EIGHT, "connectivity: Four")]);
    let written = replace_each(BASE, &[("range: \"blended\")", "range: \"blended\", jump: 6.0)")]);
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let path = "graph.ron".as_ref();
    let short = maquette::edit::minimal(path, &written, &catalog, &Options::default()).unwrap();
    assert!(!short.contains("jump"), "the default has another value now: {short}");
    let changed = replace_each(&written, &[("jump: 6.0", "jump: 5.0")]);
    for (ours, theirs) in [(&short, &changed), (&changed, &short)] {
        let merged = merge(&written, ours, theirs);
        assert_eq!(merged.conflicts, [""; 0], "{}", merged.text);
        assert_eq!(merged.text.matches("jump: 5.0").count(), 1, "{}", merged.text);
    }
    let merged = merge(
        BASE,
        &written,
        &replace_each(&far, &[("range: \"blended\")", "range: \"blended\", jump: 5.0)")]),
    );
    assert_eq!((&merged.conflicts[..], merged.text.contains("jump: 5.0")), (&[][..], true));
}

#[test]
fn a_comment_that_they_reword_in_what_we_take_away_is_a_conflict() {
    let ours = replace_each(BASE, &[(MASK, "")]);
    let theirs = replace_each(BASE, &[("\"red\",\n", "\"red\", // where it is red\n")]);
    for (ours, theirs) in [(&ours, &theirs), (&theirs, &ours)] {
        let merged = merge(BASE, ours, theirs);
        assert_eq!(merged.conflicts, ["outputs.nose-mask.png"]);
        assert_eq!(merged.text.matches("// where it is red").count(), 1, "{}", merged.text);
    }
}

#[test]
fn what_cannot_be_read_is_merged_by_lines_and_nothing_is_lost() {
    let catalog = Catalog::new(maquette_nodes::PACKS);
    fn merge(texts: [&str; 3], catalog: &Catalog) -> Merge {
        let names = ["base.ron", "ours.ron", "theirs.ron"];
        let [base, ours, theirs] =
            [0, 1, 2].map(|k| Source { name: names[k].into(), text: texts[k].to_owned() });
        maquette::edit::merge("graph.ron".as_ref(), [&base, &ours, &theirs], catalog)
    }
    let ours = replace_each(BASE, &[(FAR, "distance: 25.0")]);
    let broken = replace_each(BASE, &[(FAR, "distance: (20.0")]);
    let merged = merge([BASE, &ours, &broken], &catalog);
    assert!(merged.by_lines && merged.conflicts == [""], "{merged:?}");
    let told: Vec<_> =
        merged.diagnostics.iter().map(|it| it.source.name.to_str().unwrap()).collect();
    assert_eq!(told, ["theirs.ron"]);
    for part in ["<<<<<<< ours", "25.0", "||||||| original", "=======", "(20.0", ">>>>>>> theirs"] {
        assert!(merged.text.contains(part), "{part} in\n{}", merged.text);
    }
    // Both sides added the file, so there is no base.
    let theirs = replace_each(BASE, &[(EIGHT, "connectivity: Four")]);
    let merged = merge(["", &ours, &theirs], &catalog);
    assert!(merged.by_lines && merged.conflicts == [""] && merged.diagnostics.is_empty());
    assert!(merged.text.contains("distance: 25.0") && merged.text.contains("connectivity: Four"));
    assert_eq!(merge(["", &ours, &ours], &catalog).text, ours);
    // The base cannot be parsed, but both sides have fixed it in the same way.
    assert_eq!(merge([&broken, &ours, &ours], &catalog).conflicts, [""; 0]);
}

#[test]
fn marks_of_a_merge_are_one_mistake_at_the_first_of_them() {
    let (ours, theirs) = (
        replace_each(BASE, &[(FAR, "distance: 25.0")]),
        replace_each(BASE, &[(FAR, "distance: 20.0")]),
    );
    let catalog = Catalog::new(maquette_nodes::PACKS);
    let options = Options { files: Files::Ignored, ..Options::default() };
    fn problems(text: &str, catalog: &Catalog, options: &Options) -> Vec<maquette::Diagnostic> {
        Graph::load_text("a.ron".as_ref(), text.to_owned(), catalog, options).diagnostics
    }
    let marked = merge(BASE, &ours, &theirs).text;
    for text in [marked.replace('\n', "\r\n"), marked] {
        let told = problems(&text, &catalog, &options);
        let [problem] = &told[..] else { panic!("{told:?}") };
        assert_eq!(problem.message, "this file contains merge conflict markers");
        assert_eq!(&text[problem.span.start..problem.span.end], "<<<<<<< ours");
    }
    // Conflict markers in a string or comment do not count.
    let told = replace_each(BASE, &[("    nodes: {\n", "    /*\n=======\n    */\n    nodes: {\n")]);
    assert_eq!(problems(&told, &catalog, &options), []);
    let told = problems(&replace_each(&told, &[(FAR, "distance: (20.0")]), &catalog, &options);
    assert!(told[0].message.starts_with("this `(` is not closed"), "{told:?}");
}

#[test]
fn a_list_alone_is_merged_as_a_whole() {
    fn handles(at: &str) -> String {
        format!("[(at: ({at}, 0, 0), to: (1, 0, 0))]\n")
    }
    let merged = merge(&handles("0"), &handles("1"), &handles("2"));
    assert_eq!(merged.conflicts, [""]);
    let marked = format!("<<<<<<< ours\n{}=======\n{}>>>>>>> theirs\n", handles("1"), handles("2"));
    assert_eq!(merged.text, marked);
}

#[test]
fn a_new_name_that_the_other_side_gave_to_something_new_is_a_conflict() {
    let spots = "\"spots\": Label(mask: \"red\", connectivity: Eight)";
    let ours = BASE.replace("\"red\"", "\"blue\"");
    let new = format!(
        "\"blue\": Threshold(image: \"scan.color\", select: Near({RED}, distance: 9.0)),\n        {spots}"
    );
    let theirs = replace_each(BASE, &[(spots, &new)]);
    for (ours, theirs) in [(&ours, &theirs), (&theirs, &ours)] {
        let merged = merge(BASE, ours, theirs);
        assert!(!merged.conflicts.is_empty(), "{}", merged.text);
        assert!(merged.text.contains("<<<<<<< ours") && merged.text.contains("distance: 9.0"));
    }
    // Both sides use the new name `blue` for different items. This is a conflict if both items are nodes.
    let theirs = BASE.replace("\"spots\"", "\"blue\"");
    assert!(!merge(BASE, &ours, &theirs).conflicts.is_empty());
    let theirs = BASE.replace("\"growth\"", "\"blue\"");
    assert_eq!(merge(BASE, &ours, &theirs).conflicts, [""; 0], "a parameter is no node");
    assert_eq!(merge(BASE, &ours, &ours).conflicts, [""; 0]);
}
