//! Edits that link and unlink ports.

use super::*;

#[test]
fn ports_are_linked_and_left_free() {
    let u = ", u: \"knots-u\"";
    check_edit(DOLL, link("surface.u", "knots-v"), &[(u, ", u: \"knots-v\"")]);
    check_edit(DOLL, unlink("surface.u"), &[(u, "")]);
    let text = DOLL.replace(u, "");
    check_edit(
        &text,
        link("surface.u", "knots-u"),
        &[("\"knots-v\")", "\"knots-v\", u: \"knots-u\")")],
    );
    check_refused(
        DOLL,
        link("skin.mesh", "model"),
        expect![
            "G008 30:9 cycle: skin <- model <- skin (a node cannot need its own result: break one of these links)"
        ],
    );
    check_refused(
        DOLL,
        link("skin.mesh", "scan.color"),
        expect![
            "G012 30:33 port `mesh` of Subdivide wants a Mesh, but `scan.color` is an Image ()"
        ],
    );
    check_refused(
        DOLL,
        link("skin.levels", "grid"),
        expect!["G004 30:17 `skin` has no port `levels` (its ports: mesh)"],
    );
    check_refused(
        DOLL,
        link("scan.color", "red"),
        expect!["G004 10:17 `scan` has no port `color` ()"],
    );
    check_refused(
        DOLL,
        link("skin.msh", "grid"),
        expect!["G004 30:17 `skin` has no port `msh` (did you mean `mesh`?)"],
    );
    check_refused(
        DOLL,
        link("skn.mesh", "grid"),
        expect!["G007 1:1 the graph has no node `skn` (did you mean `skin`?)"],
    );
    check_refused(
        DOLL,
        link("skin", "grid"),
        expect!["G004 1:1 `skin` is not a port (write NODE.PORT)"],
    );
    check_refused(
        DOLL,
        unlink("skin.mesh"),
        expect![
            "G005 30:33 port `mesh` of `skin` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        DOLL,
        unlink("scan.color"),
        expect!["G004 10:36 port `color` of `scan` has no link ()"],
    );
    check_refused(
        DOLL,
        unlink("surface.order"),
        expect!["G004 25:20 port `order` of `surface` has no link ()"],
    );
}

#[test]
fn a_port_for_many_links_has_a_list() {
    let beside = include_str!("../../../graphs/nodes/Merge.ron");
    let list = "[\"doll\", \"beside\"]";
    check_edit(beside, link("both.meshes", "doll"), &[(list, "[\"doll\", \"beside\", \"doll\"]")]);
    check_edit(
        beside,
        link("both.meshes.2", "doll"),
        &[(list, "[\"doll\", \"beside\", \"doll\"]")],
    );
    check_edit(beside, link("both.meshes.0", "beside"), &[(list, "[\"beside\", \"beside\"]")]);
    check_edit(beside, unlink("both.meshes.0"), &[(list, "[\"beside\"]")]);
    check_refused(
        beside,
        link("both.meshes.3", "doll"),
        expect!["G004 7:31 port `meshes` of `both` has no link 3 (the next one has the number 2)"],
    );
    check_refused(
        beside,
        unlink("both.meshes.2"),
        expect!["G004 7:31 there is no item `2` (its items are numbered from 0 to 1)"],
    );
    check_refused(
        beside,
        unlink("both.meshes"),
        expect![
            "G005 7:31 port `meshes` of `both` cannot be left without a link (link it to something else)"
        ],
    );
    let one = beside.replace(list, "\"doll\"");
    check_edit(
        &one,
        link("both.meshes", "beside"),
        &[("meshes: \"doll\"", "meshes: [\"doll\", \"beside\"]")],
    );
    check_edit(
        &one,
        link("both.meshes.0", "beside"),
        &[("meshes: \"doll\"", "meshes: \"beside\"")],
    );
}

#[test]
fn the_ports_of_repeated_nodes_and_choices_are_linked() {
    let crowd = include_str!("../../../graphs/crowd.ron");
    check_edit(crowd, link("copies.mesh", "smooth"), &[("(mesh: \"doll\")", "(mesh: \"smooth\")")]);
    check_edit(
        crowd,
        link("doll.fine", "coarse"),
        &[("\"fine\": \"smooth\"", "\"fine\": \"coarse\"")],
    );
    check_edit(
        crowd,
        link("doll.third", "coarse"),
        &[("\"fine\": \"smooth\"", "\"fine\": \"smooth\", \"third\": \"coarse\"")],
    );
    check_refused(
        crowd,
        unlink("copies.mesh"),
        expect![
            "G005 17:27 port `mesh` of `copies` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        crowd,
        unlink("doll.fine"),
        expect![
            "G005 9:60 port `fine` of `doll` cannot be left without a link (link it to something else)"
        ],
    );
    check_refused(
        crowd,
        remove("smooth", true),
        expect![
            "G005 9:60 port `fine` of `doll` cannot be left without a link (link it to something else)"
        ],
    );
}
