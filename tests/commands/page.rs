//! The live page in a real browser.

use crate::browser::Browser;
use crate::preview::Served;
use crate::project::Project;

/// A page of the doll that shows its first values; none without a browser.
fn doll() -> Option<(Project, Served, Browser)> {
    let mut browser = Browser::start()?;
    let project = Project::doll();
    let mut served = Served::new(&project);
    served.watch.run_until_ok();
    browser.open(&served.link());
    browser.wait(SEEN);
    Some((project, served, browser))
}

/// A picture of a value is there.
const SEEN: &str = "document.querySelector('.frame img')?.naturalWidth > 100";

const CAPTION: &str = "document.querySelector('.caption').textContent";

#[test]
fn a_page_shows_the_graph_and_its_last_node_and_keeps_to_itself() {
    let Some((_project, served, mut browser)) = doll() else { return };
    assert_eq!(browser.ask("document.title"), "doll.ron - maquette");
    assert_eq!(browser.ask("document.querySelector('#link').textContent"), "live");
    let boxes = browser.ask("document.querySelectorAll('svg .node').length").as_u64().unwrap();
    assert!(boxes > 15, "{boxes}");
    let address = browser.ask("location.href");
    let address = address.as_str().unwrap().to_owned();
    assert!(!address.contains(&served.token) && address.contains("view=model"), "{address}");
    let asked = "performance.getEntriesByType('resource').every((it) => new URL(it.name).origin === location.origin)";
    assert_eq!(browser.ask(asked), true);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn a_value_is_typed_seen_and_taken_back() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    let before = std::fs::read_to_string(project.graph()).unwrap();
    let source = "document.querySelector('.frame img').src";
    let old = browser.ask(source);
    browser.write("#parameter-growth", "20");
    // The wheel over a field scrolls; it changes nothing.
    let wheel = "(() => { const field = document.querySelector('#parameter-growth'); const event = \
                 new WheelEvent('wheel', { deltaY: 100, cancelable: true, bubbles: true }); field.dispatchEvent(event); \
                 return [field.value, event.defaultPrevented].join(); })()";
    assert_eq!(browser.ask(wheel), "20,true");
    browser.press("Enter", 0);
    browser.wait(&format!("{source} !== {old}"));
    let after = std::fs::read_to_string(project.graph()).unwrap();
    assert_eq!(after, before.replace("default: 12.0", "default: 20"));
    browser.wait("document.querySelector('.parameter input[type=range]').value === '20'");
    browser.ask("document.activeElement.blur()");
    browser.press("z", 2);
    browser.wait("document.querySelector('#parameter-growth').value === '12'");
    assert_eq!(std::fs::read_to_string(project.graph()).unwrap(), before);
    browser.wait(&format!("{source} === {old}"));
    // What is being typed stays while the file changes, and can still be given up.
    browser.write("#parameter-growth", "33");
    project.save(&project.doll_text(14.0));
    browser.wait("document.querySelector('.caption').textContent.endsWith('run 4')");
    assert_eq!(browser.ask("document.querySelector('#parameter-growth').value"), "33");
    browser.press("Escape", 0);
    assert_eq!(browser.ask("document.querySelector('#parameter-growth').value"), "14");
    served.watch.end();
}

#[test]
fn a_page_opened_during_an_error_shows_it_and_the_last_good_value() {
    let Some((project, served, mut browser)) = doll() else { return };
    project.save(&project.doll_text(12.0).replace("Nurbs(", "Nurb("));
    browser.wait("document.querySelector('#problems [data-severity=error]')");
    browser.wait(&format!("{CAPTION}.includes('behind')"));
    let first = browser.ask("document.querySelector('.frame img').src.split('?')[0]");
    browser.open("about:blank");
    browser.open(&served.link());
    browser.wait("document.querySelector('#problems [data-severity=error]')");
    assert_eq!(browser.ask("document.querySelector('#run').dataset.state"), "failed");
    let text = browser.ask("document.querySelector('#problems').textContent");
    assert!(text.as_str().unwrap().contains("doll.ron:"), "{text}");
    browser.wait(&format!("document.querySelector('.frame img').src.split('?')[0] === {first}"));
}

#[test]
fn the_camera_stays_and_the_address_brings_it_back() {
    let Some((project, mut served, mut browser)) = doll() else { return };
    browser.ask("document.querySelector('.frame img').focus()");
    browser.press("ArrowRight", 0);
    browser.press("ArrowRight", 0);
    browser.wait("location.hash.endsWith('camera=30,0,1')");
    project.save(&project.doll_text(16.0));
    browser.wait(&format!("{CAPTION}.endsWith('run 2')"));
    browser.wait("document.querySelector('.frame img').src.includes('yaw=30')");
    let address = browser.ask("location.href");
    browser.call("Page.reload", serde_json::json!({}));
    browser.wait(SEEN);
    assert_eq!(browser.ask("location.href"), address);
    browser.wait("document.querySelector('.frame img').src.includes('yaw=30')");
    served.watch.end();
}

#[test]
fn all_is_there_without_a_mouse() {
    let Some((_project, _served, mut browser)) = doll() else { return };
    browser.ask("document.querySelector('svg .node[aria-label^=\"nose,\"]').focus()");
    browser.press("Enter", 0);
    browser.wait(&format!("{CAPTION}.startsWith('nose.region of')"));
    let is_box = "document.activeElement.getAttribute('role') === 'button'";
    browser.press("Tab", 0);
    assert_eq!(browser.ask(is_box), true);
    browser.press("?", 0);
    browser.wait("document.querySelector('#help').open");
    for output in ["range", "color"] {
        browser.ask("document.querySelector('#help').close()");
        browser.ask("document.querySelector('svg .node[aria-label^=\"scan,\"]').focus()");
        browser.press("Enter", 0);
        let tab = format!(
            "[...document.querySelectorAll('.tabs button')].find((tab) => tab.textContent.startsWith('{output}:'))"
        );
        browser.wait(&tab);
        browser.ask(&format!("{tab}.click()"));
        browser.wait(&format!("{CAPTION}.startsWith('scan.{output} of')"));
        browser.wait(SEEN);
    }
}
