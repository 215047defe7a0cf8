//! Screenshots of a value on the live page, and renderings of the same value by the server.

use maquette::format::png;
use maquette::value::Image;
use serde_json::json;

use crate::browser::Browser;
use crate::preview::Server;
use crate::project::Project;

/// Width and height of the view. Both are even and multiples of the block size.
pub(crate) const SIZE: [usize; 2] = [480, 360];

/// Side of the blocks whose mean colors are compared. Means are used because thin lines are antialiased differently on the page.
const BLOCK: usize = 8;

/// Pixels with a larger difference in a channel count as having another color.
const OTHER: u8 = 40;

/// A page that shows values at a known size, with nothing drawn over them.
pub(crate) struct VisiblePage {
    pub(crate) project: Project,
    pub(crate) served: Server,
    pub(crate) browser: Browser,
}

impl VisiblePage {
    /// Opens a page of a project and waits until it shows a value. Returns `None` without a browser.
    pub(crate) fn open(project: Project) -> Option<Self> {
        let browser = Browser::start()?;
        let mut served = Server::new(&project);
        served.watch.run_until_ok();
        let link = served.link();
        let mut seen = Self { project, served, browser };
        seen.go_to(&link);
        Some(seen)
    }

    pub(crate) fn go_to(&mut self, link: &str) {
        self.browser.open(link);
        self.put();
    }

    pub(crate) fn reload(&mut self) {
        self.browser.reload();
        self.put();
    }

    /// Moves the canvas to the top left corner and hides everything over it.
    fn put(&mut self) {
        self.browser.wait("document.querySelector('.frame canvas')?.dataset.shown");
        let [width, height] = SIZE;
        self.resize(width, height);
        self.browser.ask(
            "[...document.querySelectorAll('.frame :is(.wipe, .pin, .legend)')].forEach((over) => { over.style.visibility = 'hidden'; }), \
             document.querySelector('.frame canvas').style.outline = 'none'",
        );
        self.wait_for_frame();
    }

    pub(crate) fn resize(&mut self, width: usize, height: usize) {
        self.browser.ask(&format!(
            "Object.assign(document.querySelector('.frame').style, {{ position: 'fixed', left: 0, top: 0, width: '{width}px', height: '{height}px', zIndex: 9 }}), 0"
        ));
        let canvas = "document.querySelector('.frame canvas')";
        self.browser.wait(&format!("{canvas}.width === {width} && {canvas}.height === {height}"));
    }

    /// Waits until the last changes are drawn. Does not wait for data that must be fetched from the server.
    pub(crate) fn wait_for_frame(&mut self) {
        self.browser.ask(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())))",
        );
        self.browser.wait("document.querySelector('.frame canvas').dataset.shown");
    }

    /// Waits until the value that was computed by the run with this number is drawn.
    pub(crate) fn drawn_of(&mut self, run: usize) {
        self.browser
            .wait(&format!("document.querySelector('.frame canvas').dataset.run === '{run}'"));
        self.wait_for_frame();
    }

    /// Selects an output of a node and waits until it is drawn.
    pub(crate) fn view(&mut self, node: &str, output: &str) {
        let tab = format!(
            "[...document.querySelectorAll('.tabs button')].find((tab) => tab.textContent.startsWith('{output}:'))"
        );
        self.browser.ask(&format!(
            "document.querySelector('svg .node[data-name=\"{node}\"]').dispatchEvent(new MouseEvent('click'))"
        ));
        self.browser.wait(&tab);
        self.browser.ask(&format!("{tab}.click()"));
        self.wait_for_frame();
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
        self.wait_for_frame();
    }

    /// Sends a mouse event at a position of the canvas: `mouseMoved`, `mousePressed` or `mouseReleased`.
    pub(crate) fn mouse(&mut self, what: &str, [x, y]: [f64; 2], clicks: u32) {
        let button = if what == "mouseMoved" && clicks == 0 { "none" } else { "left" };
        let buttons = u32::from(button == "left" && what != "mouseReleased");
        let event = json!({ "type": what, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": clicks });
        self.browser.call("Input.dispatchMouseEvent", event);
    }

    /// Double-clicks at a position of the canvas.
    pub(crate) fn double_click(&mut self, at: [f64; 2]) {
        self.mouse("mouseMoved", at, 0);
        for clicks in [1, 2] {
            self.mouse("mousePressed", at, clicks);
            self.mouse("mouseReleased", at, clicks);
        }
    }

    /// Returns a screenshot of the canvas.
    pub(crate) fn canvas(&mut self) -> Image {
        let [width, height] = SIZE;
        let clip = json!({ "x": 0, "y": 0, "width": width, "height": height, "scale": 1 });
        let told =
            self.browser.call("Page.captureScreenshot", json!({ "format": "png", "clip": clip }));
        png::read(&bytes(told["data"].as_str().unwrap())).unwrap()
    }

    /// Waits until the canvas differs from `before` and returns its picture.
    pub(crate) fn canvas_after(&mut self, before: &Image) -> Image {
        for _ in 0..200 {
            let now = self.canvas();
            if now != *before {
                return now;
            }
            self.wait_for_frame();
        }
        panic!("the canvas stays as it is");
    }

    /// Waits until the canvas equals `wanted`, except for rounding.
    pub(crate) fn becomes(&mut self, wanted: &Image) {
        let mut now = self.canvas();
        for _ in 0..200 {
            if ImageDifference::between(&now, wanted).is_within(ROUNDED) {
                return;
            }
            self.wait_for_frame();
            now = self.canvas();
        }
        panic!("the canvas is another: {:?}", ImageDifference::between(&now, wanted));
    }

    /// Selects the coloring of faces and returns the canvas as soon as it has changed.
    pub(crate) fn paint(&mut self, paint: &str) -> Image {
        let before = self.canvas();
        self.browser.ask(&format!(
            "(() => {{ const paint = document.querySelector('[data-key=paint]'); paint.value = '{paint}'; \
             paint.dispatchEvent(new Event('change')); }})()"
        ));
        self.canvas_after(&before)
    }

    /// Sends a touch event: fingers touch the canvas or move on it; no fingers means that all are lifted.
    pub(crate) fn touch(&mut self, what: &str, fingers: &[[f64; 2]]) {
        let points = fingers.iter().enumerate();
        let points = points.map(|(id, [x, y])| json!({ "id": id, "x": x, "y": y }));
        let event = json!({ "type": what, "touchPoints": Vec::from_iter(points) });
        self.browser.call("Input.dispatchTouchEvent", event);
    }

    /// Returns the server's rendering of the drawn value from the camera of the page, rotated by `aside` degrees to the right.
    pub(crate) fn render_view(&mut self, aside: f64) -> Image {
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

    /// Returns a field of the page's address, or an empty string if it is missing.
    pub(crate) fn word(&mut self, name: &str) -> String {
        let word = self
            .browser
            .ask(&format!("new URLSearchParams(location.hash.slice(1)).get('{name}') ?? ''"));
        word.as_str().unwrap().to_owned()
    }
}

/// The maximum difference of pictures that count as equal. It is not 0, because the camera in the address is rounded.
pub(crate) const ROUNDED: ImageDifference = ImageDifference { mean: 0.01, other: 0.0001 };

/// The difference between two pictures of one size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImageDifference {
    /// The mean absolute difference of the blocks' mean colors, per channel.
    pub(crate) mean: f64,
    /// The fraction of pixels whose color differs by more than `OTHER`.
    pub(crate) other: f64,
}

impl ImageDifference {
    pub(crate) fn between(a: &Image, b: &Image) -> Self {
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

    /// Returns true if both differences are at most those of `limit`.
    pub(crate) fn is_within(self, limit: Self) -> bool {
        self.mean <= limit.mean && self.other <= limit.other
    }
}

/// Returns the mean of each channel in each block of a picture.
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

/// Returns the columns `from..to` of a picture.
pub(crate) fn columns(image: &Image, from: usize, to: usize) -> Image {
    let rows = image.pixels().chunks(image.width());
    let pixels: Vec<_> = rows.flat_map(|row| row[from..to].iter().copied()).collect();
    Image::new(to - from, image.height(), pixels).unwrap()
}

/// Decodes base64 text.
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
