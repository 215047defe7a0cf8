//! Edits that add and remove nodes.

use super::*;

#[test]
fn a_node_is_added_behind_another_one_as_its_neighbors_stand() {
    let spots = "        \"spots\": Label(mask: \"red\", connectivity: Eight),\n";
    let fields = [("image", "scan.color"), ("select", "Near( color:\"#236cba\" )")];
    let blue =
        "        \"blue\": Threshold(image: \"scan.color\", select: Near(color: \"#236cba\")),\n";
    let with_blue = [spots, blue].concat();
    check_edit(DOLL, add("blue", "Threshold", &fields, Some("spots")), &[(spots, &with_blue)]);
    let last = "        \"model\": Texture(mesh: \"skin\", image: \"scan.color\"),\n";
    check_edit(DOLL, add("blue", "Threshold", &fields, None), &[(last, &[last, blue].concat())]);
}

#[test]
fn a_word_is_meant_as_a_link_where_a_port_is() {
    let fields = [("labels", "spots"), ("range", "whole"), ("pick", "Smallest")];
    let text = apply_edits(DOLL, &[add("other", "ExtractRegion", &fields, None)]).unwrap();
    let node =
        "\"other\": ExtractRegion(labels: \"spots\", range: \"whole\", pick: Smallest),\n    },";
    assert!(text.contains(node), "{text}");
}

#[test]
fn words_of_a_list_are_meant_as_links_where_a_port_takes_many() {
    for list in ["[skin, model]", "[ skin,\"model\", ]", "[skin.mesh, model.mesh]"] {
        let text = apply_edits(DOLL, &[add("all", "Merge", &[("meshes", list)], None)]).unwrap();
        let links = if list.contains('.') {
            "\"skin.mesh\", \"model.mesh\""
        } else {
            "\"skin\", \"model\""
        };
        assert!(text.contains(&format!("\"all\": Merge(meshes: [{links}]),\n    }},")), "{text}");
    }
}

#[test]
fn a_long_node_is_broken_as_fmt_breaks_it() {
    let points = format!("[{}]", ["[(0, 0, 0), (100, 0, 0), (200, 0, 0)]"; 3].join(", "));
    let text = apply_edits(DOLL, &[add("points", "PointNet", &[("points", &points)], Some("red"))]);
    let text = text.unwrap();
    assert_eq!(maquette::edit::format_text(Path::new("x"), &text).unwrap(), text);
    let tabs = apply_edits(
        &DOLL.replace("    ", "\t").replace('\n', "\r\n"),
        &[add("points", "PointNet", &[("points", &points)], Some("red"))],
    );
    assert_eq!(tabs.unwrap(), text.replace("    ", "\t").replace('\n', "\r\n"));
}

#[test]
fn the_first_node_and_the_first_output_open_their_sections() {
    let empty = "Graph(\n    format: 1,\n    nodes: {},\n    outputs: {},\n)\n";
    let doll = add("doll", "ReadMesh", &[("path", "a.obj")], None);
    let text = apply_edits(empty, &[doll, output("a.ply", Some("doll"))]).unwrap();
    expect![[r#"
        Graph(
            format: 1,
            nodes: {
                "doll": ReadMesh(path: "a.obj"),
            },
            outputs: { "a.ply": "doll" },
        )
    "#]]
    .assert_eq(&text);
    assert_eq!(apply_edits(&text, &[output("a.ply", None), remove("doll", false)]).unwrap(), empty);
}

#[test]
fn what_cannot_be_added_is_refused() {
    let red = [("image", "scan.color")];
    check_refused(
        DOLL,
        add("red", "Threshold", &red, None),
        expect!["G006 32:9 there is already a node `red` (give one of them another name)"],
    );
    check_refused(
        DOLL,
        add("Red", "Threshold", &red, None),
        expect![
            "G006 1:1 `Red` cannot name a node (use a lower-case letter followed by lower-case letters, digits and hyphens)"
        ],
    );
    check_refused(
        DOLL,
        add("blue", "Treshold", &red, None),
        expect!["G003 32:17 there is no node type `Treshold` (did you mean `Threshold`?)"],
    );
    check_refused(
        DOLL,
        add("blue", "Solidify", &red, None),
        expect![
            "G003 32:17 there is no node type `Solidify` (`Shell` is described with this word; other types come in packs)"
        ],
    );
    check_refused(
        DOLL,
        add("blue", "Otsu(), \"x\": Label", &red, None),
        expect![[
            r#"G003 1:1 `Otsu(), "x": Label` cannot be the name of a node type (letters, digits and `_`, no digit first)"#
        ]],
    );
    check_refused(
        DOLL,
        add("blue", "Label", &[], None),
        expect![[
            r#"G005 32:17 Label needs a link at its port `mask` (write `mask: "node"` with a node that gives a Mask)"#
        ]],
    );
    check_refused(
        DOLL,
        add("blue", "Threshold", &red, Some("rde")),
        expect!["G007 1:1 the graph has no node `rde` (did you mean `red`?)"],
    );
}

#[test]
fn a_node_goes_with_its_lines_and_its_own_comments() {
    let knots = "        \"knots-u\": Knots(net: \"raised\", along: U, order: 3),\n";
    let text = DOLL.replace(", u: \"knots-u\"", "");
    check_edit(&text, remove("knots-u", false), &[(knots, "")]);
    let noted = text.replace("order: 3),\n", "order: 3), // along\n");
    check_edit(&noted, remove("knots-u", true), &[(&knots.replace(",\n", ", // along\n"), "")]);
    let lonely = "Graph(format: 1, nodes: { \"a\": ReadMesh(path: \"a.obj\"), \"b\": ReadMesh(path: \"b.obj\") }, outputs: {})";
    check_edit(lonely, remove("a", false), &[("\"a\": ReadMesh(path: \"a.obj\"), ", "")]);
    check_edit(lonely, remove("b", false), &[(", \"b\": ReadMesh(path: \"b.obj\")", "")]);
}

#[test]
fn no_blank_line_is_left_where_a_group_of_nodes_was() {
    let text = "Graph(\n    format: 1,\n    nodes: {\n        \"a\": ReadMesh(path: \"a.obj\"),\n\n        \"b\": ReadMesh(path: \"b.obj\"),\n\n        // Of c.\n        \"c\": ReadMesh(path: \"c.obj\") // c\n    },\n    outputs: {},\n)\n";
    check_edit(text, remove("a", false), &[("        \"a\": ReadMesh(path: \"a.obj\"),\n\n", "")]);
    check_edit(text, remove("b", false), &[("\n        \"b\": ReadMesh(path: \"b.obj\"),\n", "")]);
    let last = "        \"c\": ReadMesh(path: \"c.obj\") // c\n";
    check_edit(text, remove("c", false), &[(last, ""), ("b.obj\"),", "b.obj\")")]);
}

#[test]
fn what_something_hangs_on_is_not_removed() {
    check_refused(
        DOLL,
        remove("knots-u", false),
        expect![
            "G007 25:44 `knots-u` cannot be removed: port `u` of `surface` needs it (link it to something else, or remove optional links, too (--and-links))"
        ],
    );
    check_refused(
        DOLL,
        remove("red", true),
        expect![
            "G005 16:30 port `mask` of `spots` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        DOLL,
        remove("growth", true),
        expect![
            "G011 22:84 `growth` cannot be removed: `raised` needs it (replace the references to `growth` by values)"
        ],
    );
    check_refused(
        DOLL,
        remove("rde", true),
        expect!["G007 1:1 the graph has no node, input or parameter `rde` (did you mean `red`?)"],
    );
    let expects = DOLL.replace("    outputs: {", "    expect: [Closed(\"grid\")],\n    outputs: {");
    check_refused(
        &expects,
        remove("skin", false),
        expect![
            "G007 31:32 `skin` cannot be removed: port `mesh` of `model` needs it (link it to something else, or remove optional links, too (--and-links))"
        ],
    );
    check_refused(
        &expects,
        output("model.glb", Some("nothing")),
        expect![
            "G007 35:22 there is no node `nothing` (the graph's nodes: scan, whole, red, spots, nose, normal, net, raised, knots-u, knots-v, surface, blended, grid, skin, model)"
        ],
    );
}

#[test]
fn links_that_need_not_be_go_along() {
    let knots = "        \"knots-u\": Knots(net: \"raised\", along: U, order: 3),\n";
    check_edit(DOLL, remove("knots-u", true), &[(knots, ""), (", u: \"knots-u\"", "")]);
    let model = "        \"model\": Texture(mesh: \"skin\", image: \"scan.color\"),\n";
    let outputs = "        \"model.glb\": \"model\",\n        \"model.ply\": \"model\",\n";
    let expects = "    expect: [Closed(\"model\"), Closed(\"skin\"), Manifold(\"model.ply\")],\n)";
    let text = DOLL.replace("    },\n)", &format!("    }},\n{expects}"));
    assert_ne!(text, DOLL);
    check_edit(
        &text,
        remove("model", true),
        &[
            (model, ""),
            (outputs, ""),
            ("Closed(\"model\"), ", ""),
            (", Manifold(\"model.ply\")", ""),
        ],
    );
    let beside = include_str!("../../../graphs/nodes/Merge.ron");
    let node = "        \"beside\": Transform(mesh: \"doll\", translate: (100, 0, 0)),\n";
    check_edit(beside, remove("beside", true), &[(node, ""), (", \"beside\"", "")]);
}
