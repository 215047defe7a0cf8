//! The page lists and marks the properties that a port requires but its value lacks.

use maquette::value::Image;

use crate::project::Project;
use crate::visible_page::VisiblePage;

/// Returns the number of pixels that have the red color of the marks.
fn red(picture: &Image) -> usize {
    picture.pixels().iter().filter(|[r, g, b]| 120 < *r && *g < r / 3 && *b < r / 3).count()
}

#[test]
fn a_page_lists_and_marks_them_too_and_looks_at_one_that_is_clicked() {
    let project = Project::with_a_hole();
    let wanted = std::fs::read_to_string(project.graph()).unwrap();
    project.save(&wanted.replace("Lib(skin", "Transform(mesh"));
    let Some(mut seen) = VisiblePage::open(project) else { return };
    seen.view("open", "mesh");
    let before = seen.canvas();
    assert_eq!(red(&before), 0);
    seen.project.save(&wanted);
    seen.browser.wait("document.querySelectorAll('#broken ul li').length === 3");
    let marked = seen.canvas_after(&before);
    assert!(200 < red(&marked), "{}", red(&marked));
    let words = seen.browser.ask("document.querySelector('#broken b').textContent");
    let words = words.as_str().unwrap();
    let expected = "is not Closed, as required by input `skin` of `whole`: it has 3 edges";
    assert!(words.starts_with(expected), "{words}");
    // Clicks the third listed element: the view is centered on it.
    seen.browser.ask("document.querySelectorAll('#broken button')[2].click()");
    seen.canvas_after(&marked);
    seen.browser.wait("/camera=0,0,1,0,0.5,0.5,/.test(location.hash)");
    // After the graph is repaired, nothing is marked.
    seen.project.save(&wanted.replace("Lib(skin", "Transform(mesh"));
    seen.browser.wait("document.querySelectorAll('#broken li').length === 0");
    seen.served.watch.end();
}
