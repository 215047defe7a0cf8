//! Edits that rename a node, input or parameter wherever the name is used.

use super::*;

#[test]
fn a_name_is_changed_wherever_it_is_named() {
    check_edit(
        DOLL,
        rename("scan", "capture"),
        &[
            ("\"scan\":", "\"capture\":"),
            ("\"scan.range\"", "\"capture.range\""),
            ("\"scan.color\"", "\"capture.color\""),
            ("\"scan.color\"", "\"capture.color\""),
        ],
    );
    let text = DOLL.replace("Param(\"growth\")", "Expr(\"growth*2-growth / 2\")");
    check_edit(
        &text,
        rename("growth", "grow-th"),
        &[("\"growth\"", "\"grow-th\""), ("growth*2-growth", "grow-th*2-grow-th")],
    );
    let face = include_str!("../../../graphs/face.ron");
    check_refused(
        face,
        rename("nose", "noses"),
        expect![
            "G006 7:9 both a node and a parameter have the name `nose` (write `nodes.nose` or `params.nose`)"
        ],
    );
}

#[test]
fn the_names_in_uses_and_lists_and_choices_follow() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs");
    fn check(file: &str, from: &str, to: &str, expected: &[(&str, &str)], folder: &Path) {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        let mut replaced = text.clone();
        for (old, new) in expected {
            assert!(replaced.contains(old), "{old}");
            replaced = replaced.replace(old, new);
        }
        assert_eq!(edit(&path, &text, &[rename(from, to)]).unwrap().text, replaced);
    }
    check(
        "face.ron",
        "nodes.nose",
        "first",
        &[("\"nose\": Feature", "\"first\": Feature"), ("\"nose.range\"", "\"first.range\"")],
        &folder,
    );
    check(
        "face.ron",
        "params.nose",
        "far",
        &[("\"nose\": Number", "\"far\": Number"), ("Param(\"nose\")", "Param(\"far\")")],
        &folder,
    );
    check(
        "face.ron",
        "nodes.eyes",
        "both",
        &[("\"eyes\": ForEach", "\"both\": ForEach"), ("\"eyes.range\"", "\"both.range\"")],
        &folder,
    );
    check("face.ron", "scan", "seen", &[("\"scan", "\"seen")], &folder);
    check("crowd.ron", "smooth", "fine", &[("\"smooth\"", "\"fine\"")], &folder);
    check(
        "crowd.ron",
        "doll",
        "one",
        &[("\"doll\": Switch", "\"one\": Switch"), ("(mesh: \"doll\")", "(mesh: \"one\")")],
        &folder,
    );
}

#[test]
fn an_expression_does_not_change_its_meaning_when_a_parameter_gets_another_name() {
    let text = DOLL.replace("Param(\"growth\")", "Expr(\"growth-levels\")");
    check_refused(
        &text,
        rename("levels", "a b"),
        expect![
            "G006 1:1 `a b` cannot name a parameter (use a lower-case letter followed by lower-case letters, digits and hyphens)"
        ],
    );
    let three = text.replace(
        "    params: {\n",
        "    params: {\n        \"far\": Number(default: 1.0, doc: \"x\"),\n",
    );
    check_refused(
        &three,
        rename("far", "growth-levels"),
        expect![
            "G011 23:83 this expression would change its meaning with the name `growth-levels` (put spaces around a minus sign)"
        ],
    );
}
