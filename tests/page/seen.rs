//! What is seen of a value on the live page, as pixels, and what `render` makes of the same value.

use maquette::format::png;
use maquette::value::Image;
use serde_json::json;

use crate::browser::Browser;
use crate::preview::Served;
use crate::project::Project;

/// The width and height at which values are seen: whole pixels, and so are their halves and their blocks.
pub(crate) const SIZE: [usize; 2] = [480, 360];

/// The side of the blocks whose means are compared: the edges of thin lines are softened in another way on the page.
const BLOCK: usize = 8;

/// A channel that differs by more than this is another color.
const OTHER: u8 = 40;

/// A page on which values are seen at a known size, with nothing over them.
pub(crate) struct Seen {
    pub(crate) project: Project,
    pub(crate) served: Served,
    pub(crate) browser: Browser,
}

impl Seen {
    /// A page of a project that shows its first values; none without a browser.
    pub(crate) fn of(project: Project) -> Option<Self> {
        let browser = Browser::start()?;
        let mut served = Served::new(&project);
        served.watch.run_until_ok();
        let link = served.link();
        let mut seen = Self { project, served, browser };
        seen.open(&link);
        Some(seen)
    }

    /// Opens a link.
    pub(crate) fn open(&mut self, link: &str) {
        self.browser.open(link);
        self.put();
    }

    /// Loads the page again.
    pub(crate) fn reload(&mut self) {
        self.browser.reload();
        self.put();
    }

    /// Puts the canvas where it is to be, with nothing over it.
    fn put(&mut self) {
        self.browser.wait("document.querySelector('.frame canvas')?.dataset.shown");
        let [width, height] = SIZE;
        self.resize(width, height);
        self.browser.ask(
            "[...document.querySelectorAll('.frame :is(.wipe, .pin, .legend)')].forEach((over) => { over.style.visibility = 'hidden'; }), \
             document.querySelector('.frame canvas').style.outline = 'none'",
        );
        self.drawn();
    }

    /// Gives the canvas another size.
    pub(crate) fn resize(&mut self, width: usize, height: usize) {
        self.browser.ask(&format!(
            "Object.assign(document.querySelector('.frame').style, {{ position: 'fixed', left: 0, top: 0, width: '{width}px', height: '{height}px', zIndex: 9 }}), 0"
        ));
        let canvas = "document.querySelector('.frame canvas')";
        self.browser.wait(&format!("{canvas}.width === {width} && {canvas}.height === {height}"));
    }

    /// Waits till all that was asked for is drawn, if nothing has to be fetched for it.
    pub(crate) fn drawn(&mut self) {
        self.browser.ask(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())))",
        );
        self.browser.wait("document.querySelector('.frame canvas').dataset.shown");
    }

    /// Waits till the value of a run is drawn.
    pub(crate) fn drawn_of(&mut self, run: usize) {
        self.browser
            .wait(&format!("document.querySelector('.frame canvas').dataset.run === '{run}'"));
        self.drawn();
    }

    /// Looks at an output of a node.
    pub(crate) fn view(&mut self, node: &str, output: &str) {
        let tab = format!(
            "[...document.querySelectorAll('.tabs button')].find((tab) => tab.textContent.startsWith('{output}:'))"
        );
        self.browser.ask(&format!(
            "document.querySelector('svg .node[data-name=\"{node}\"]').dispatchEvent(new MouseEvent('click'))"
        ));
        self.browser.wait(&tab);
        self.browser.ask(&format!("{tab}.click()"));
        self.drawn();
        self.browser.wait(&format!(
            "document.querySelector('.caption').textContent.startsWith('{node}.{output} of run ')"
        ));
    }

    /// Presses keys while the canvas has the focus.
    pub(crate) fn press(&mut self, keys: &[&str]) {
        self.browser.ask("document.querySelector('.frame canvas').focus()");
        for key in keys {
            self.browser.press(key, 0);
        }
        self.drawn();
    }

    /// Does something with the mouse at a place of the canvas: `mouseMoved`, `mousePressed` or `mouseReleased`.
    pub(crate) fn mouse(&mut self, what: &str, [x, y]: [f64; 2], clicks: u32) {
        let button = if what == "mouseMoved" && clicks == 0 { "none" } else { "left" };
        let buttons = u32::from(button == "left" && what != "mouseReleased");
        let event = json!({ "type": what, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": clicks });
        self.browser.call("Input.dispatchMouseEvent", event);
    }

    /// Clicks twice.
    pub(crate) fn double_click(&mut self, at: [f64; 2]) {
        self.mouse("mouseMoved", at, 0);
        for clicks in [1, 2] {
            self.mouse("mousePressed", at, clicks);
            self.mouse("mouseReleased", at, clicks);
        }
    }

    /// The canvas.
    pub(crate) fn canvas(&mut self) -> Image {
        let [width, height] = SIZE;
        let clip = json!({ "x": 0, "y": 0, "width": width, "height": height, "scale": 1 });
        let told =
            self.browser.call("Page.captureScreenshot", json!({ "format": "png", "clip": clip }));
        png::read(&bytes(told["data"].as_str().unwrap())).unwrap()
    }

    /// The canvas as soon as it is another than this.
    pub(crate) fn canvas_after(&mut self, before: &Image) -> Image {
        for _ in 0..200 {
            let now = self.canvas();
            if now != *before {
                return now;
            }
            self.drawn();
        }
        panic!("the canvas stays as it is");
    }

    /// Waits till the canvas is this, but for what is rounded.
    pub(crate) fn becomes(&mut self, wanted: &Image) {
        let mut now = self.canvas();
        for _ in 0..200 {
            if Apart::of(&now, wanted).within(ROUNDED) {
                return;
            }
            self.drawn();
            now = self.canvas();
        }
        panic!("the canvas is another: {:?}", Apart::of(&now, wanted));
    }

    /// Chooses what faces are painted with, and gives the canvas as soon as it is another.
    pub(crate) fn paint(&mut self, paint: &str) -> Image {
        let before = self.canvas();
        self.browser.ask(&format!(
            "(() => {{ const paint = document.querySelector('[data-key=paint]'); paint.value = '{paint}'; \
             paint.dispatchEvent(new Event('change')); }})()"
        ));
        self.canvas_after(&before)
    }

    /// Puts fingers on the canvas, moves them, or, without any, takes them away.
    pub(crate) fn touch(&mut self, what: &str, fingers: &[[f64; 2]]) {
        let points = fingers.iter().enumerate();
        let points = points.map(|(id, [x, y])| json!({ "id": id, "x": x, "y": y }));
        let event = json!({ "type": what, "touchPoints": Vec::from_iter(points) });
        self.browser.call("Input.dispatchTouchEvent", event);
    }

    /// What `render` makes of the value that the canvas shows, seen from `aside` degrees farther right.
    pub(crate) fn rendered(&mut self, aside: f64) -> Image {
        let shown = self.browser.ask("document.querySelector('.frame canvas').dataset.shown");
        let camera = self.word("camera");
        let angles: Vec<_> = camera.split(',').map(|word| word.parse::<f64>().unwrap()).collect();
        let [yaw, pitch, zoom] = [angles[0] + aside, angles[1], angles[2]];
        let in_space = "document.querySelector('[data-key=m]')?.ariaPressed === 'true'";
        let flat = self.browser.ask(in_space) != true;
        let ([width, height], shown) = (SIZE, shown.as_str().unwrap());
        let path = format!(
            "/picture/{shown}?width={width}&height={height}&yaw={yaw}&pitch={pitch}&zoom={zoom}&flat={flat}"
        );
        let (head, body) = self.served.ask(&path, &[("Host", &self.served.host)]);
        assert!(head.starts_with("HTTP/1.1 200"), "{path}: {head}");
        png::read(&body).unwrap()
    }

    /// What the address says under a name; nothing if it does not.
    pub(crate) fn word(&mut self, name: &str) -> String {
        let word = self
            .browser
            .ask(&format!("new URLSearchParams(location.hash.slice(1)).get('{name}') ?? ''"));
        word.as_str().unwrap().to_owned()
    }
}

/// Pictures that differ by this are the same: the camera's place in the address is rounded.
pub(crate) const ROUNDED: Apart = Apart { mean: 0.01, other: 0.0001 };

/// How far two pictures of one size are apart.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Apart {
    /// The mean difference of a channel between the means of blocks.
    pub(crate) mean: f64,
    /// The share of pixels of another color.
    pub(crate) other: f64,
}

impl Apart {
    pub(crate) fn of(a: &Image, b: &Image) -> Self {
        assert_eq!([a.width(), a.height()], [b.width(), b.height()]);
        let (a_means, b_means) = (means(a), means(b));
        let differences = a_means.iter().zip(&b_means).map(|(a, b)| (a - b).abs());
        let others = a
            .pixels()
            .iter()
            .zip(b.pixels())
            .filter(|(a, b)| (0..3).any(|k| a[k].abs_diff(b[k]) > OTHER))
            .count();
        Self {
            mean: differences.sum::<f64>() / a_means.len() as f64,
            other: others as f64 / a.pixels().len() as f64,
        }
    }

    /// Whether they are no farther apart than this.
    pub(crate) fn within(self, limit: Self) -> bool {
        self.mean <= limit.mean && self.other <= limit.other
    }
}

/// The mean of each channel of each block.
fn means(image: &Image) -> Vec<f64> {
    let columns = image.width().div_ceil(BLOCK);
    let mut means = vec![0.0; 3 * columns * image.height().div_ceil(BLOCK)];
    for (at, pixel) in image.pixels().iter().enumerate() {
        let (x, y) = (at % image.width(), at / image.width());
        let block = y / BLOCK * columns + x / BLOCK;
        for k in 0..3 {
            means[3 * block + k] += f64::from(pixel[k]) / (BLOCK * BLOCK) as f64;
        }
    }
    means
}

/// The columns of a picture from one to another.
pub(crate) fn columns(image: &Image, from: usize, to: usize) -> Image {
    let rows = image.pixels().chunks(image.width());
    let pixels: Vec<_> = rows.flat_map(|row| row[from..to].iter().copied()).collect();
    Image::new(to - from, image.height(), pixels).unwrap()
}

/// The bytes that a text in base 64 stands for.
fn bytes(text: &str) -> Vec<u8> {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits = text.trim_end_matches('=').bytes();
    let digits = digits.map(|it| DIGITS.iter().position(|&digit| digit == it).unwrap() as u32);
    let digits = Vec::from_iter(digits);
    digits
        .chunks(4)
        .flat_map(|digits| {
            let number =
                digits.iter().enumerate().map(|(k, digit)| digit << (18 - 6 * k)).sum::<u32>();
            let bytes = number.to_be_bytes();
            bytes[1..digits.len()].to_vec()
        })
        .collect()
}
