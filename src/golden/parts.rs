//! A value as named columns of numbers: what goldens keep of it, and what comparisons compare.

use nalgebra::Point3;

use crate::value::{
    AnyValue, Attribute, Attributes, CaptureFrame, ControlNet, Curve, Direction, Field, Handles,
    Image, KnotVector, Labels, Mask, Mesh, Points, RangeImage, Region, Surface, Trace,
};

/// What the numbers of a column mean, and so how two of them are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Class {
    /// Places in mm: by their distance.
    Place,
    /// Directions: by their angle.
    Normal,
    /// Numbers and vectors of any other kind: by the length of their difference.
    Number,
    /// Channels of colors, 0 to 255: by the largest difference of a channel.
    Level,
    /// Whole numbers that are equal or not.
    Exact,
}

/// One column: `width` numbers for each element.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    pub(crate) name: String,
    pub(crate) class: Class,
    pub(crate) width: usize,
    /// Elements of the value; the column holds every `stride`-th of them.
    pub(crate) count: usize,
    pub(crate) stride: usize,
    pub(crate) numbers: Vec<f64>,
}

impl Part {
    pub(crate) fn new(name: &str, class: Class, width: usize, numbers: Vec<f64>) -> Self {
        let count = numbers.len() / width;
        Self { name: name.to_owned(), class, width, count, stride: 1, numbers }
    }

    /// The numbers of the element at this place of the column.
    pub(crate) fn element(&self, place: usize) -> &[f64] {
        &self.numbers[place * self.width..][..self.width]
    }

    /// Every `stride`-th element.
    pub(crate) fn every(&self, stride: usize) -> Self {
        let elements = self.numbers.chunks(self.width).step_by(stride).flatten();
        Self { numbers: elements.copied().collect(), stride, ..self.clone() }
    }

    /// Least and greatest finite number of each component.
    pub(crate) fn ranges(&self) -> Vec<Option<(f64, f64)>> {
        let mut ranges = vec![None; self.width];
        for element in self.numbers.chunks(self.width) {
            for (range, &x) in ranges.iter_mut().zip(element) {
                if x.is_finite() {
                    let (low, high) = range.unwrap_or((x, x));
                    *range = Some((f64::min(low, x), f64::max(high, x)));
                }
            }
        }
        ranges
    }

    /// The length of the diagonal of the box around all elements; 0 without any.
    pub(crate) fn diagonal(&self) -> f64 {
        let sides =
            self.ranges().into_iter().flatten().map(|(low, high)| (high - low) * (high - low));
        sides.sum::<f64>().sqrt()
    }
}

/// The columns of a value, and what must be equal before they are looked at.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Parts {
    /// Counts, sizes and kinds.
    pub(crate) facts: Vec<(String, String)>,
    pub(crate) columns: Vec<Part>,
    /// Elements in a row, where the elements are pixels or control points.
    pub(crate) row: Option<usize>,
}

impl Parts {
    /// The parts of a value; none for a type that only its pack knows.
    pub(crate) fn of(value: &AnyValue) -> Option<Self> {
        let mut parts = Self::default();
        if let Some(mesh) = value.get::<Mesh>() {
            parts.mesh(mesh);
        } else if let Some(surface) = value.get::<Surface>() {
            parts.net(surface.net());
            parts.knots("knots u", surface.u());
            parts.knots("knots v", surface.v());
        } else if let Some(net) = value.get::<ControlNet>() {
            parts.net(net);
        } else if let Some(range) = value.get::<RangeImage>() {
            parts.range(range);
        } else if let Some(region) = value.get::<Region>() {
            parts.region(region);
        } else if let Some(points) = value.get::<Points>() {
            parts.fact("points", points.positions().len());
            parts.places("position", points.positions());
            parts.attributes("", points.attributes());
        } else if let Some(curve) = value.get::<Curve>() {
            parts.curve(curve);
        } else if let Some(image) = value.get::<Image>() {
            parts.grid(image.width(), image.height());
            let levels = image.pixels().as_flattened().iter().map(|&level| f64::from(level));
            parts.push("color", Class::Level, 3, levels.collect());
        } else {
            return parts.of_few_numbers(value);
        }
        Some(parts)
    }

    fn of_few_numbers(mut self, value: &AnyValue) -> Option<Self> {
        if let Some(mask) = value.get::<Mask>() {
            self.grid(mask.width(), mask.height());
            self.push("inside", Class::Exact, 1, whole(mask.pixels()));
        } else if let Some(labels) = value.get::<Labels>() {
            self.grid(labels.width(), labels.height());
            self.fact("components", labels.statistics().len());
            self.push("label", Class::Exact, 1, whole(labels.pixels()));
        } else if let Some(field) = value.get::<Field>() {
            self.grid(field.width(), field.height());
            let numbers = field.pixels().iter().map(|&x| f64::from(x));
            self.push("number", Class::Number, 1, numbers.collect());
        } else if let Some(direction) = value.get::<Direction>() {
            self.push("direction", Class::Normal, 3, direction.vector().as_slice().to_vec());
            self.push("resultant", Class::Number, 1, vec![direction.resultant()]);
        } else if let Some(knots) = value.get::<KnotVector>() {
            self.knots("knots", knots);
        } else if let Some(handles) = value.get::<Handles>() {
            self.handles(handles);
        } else if let Some(trace) = value.get::<Trace>() {
            let steps = trace.steps();
            self.fact("steps", steps.len());
            let iterations = steps.iter().map(|step| step.iteration as f64);
            self.push("iteration", Class::Exact, 1, iterations.collect());
            self.push("max", Class::Number, 1, steps.iter().map(|step| step.max).collect());
            self.push("rms", Class::Number, 1, steps.iter().map(|step| step.rms).collect());
        } else {
            return None;
        }
        Some(self)
    }

    /// Attributes alone.
    pub(crate) fn of_attributes(attributes: &Attributes) -> Vec<Part> {
        let mut parts = Self::default();
        parts.attributes("", attributes);
        parts.columns
    }

    /// The column of this name.
    pub(crate) fn column(&self, name: &str) -> Option<&Part> {
        self.columns.iter().find(|column| column.name == name)
    }

    fn fact(&mut self, name: &str, fact: impl ToString) {
        self.facts.push((name.to_owned(), fact.to_string()));
    }

    fn grid(&mut self, width: usize, height: usize) {
        self.fact("size", format!("{width} x {height}"));
        self.row = Some(width);
    }

    fn push(&mut self, name: &str, class: Class, width: usize, numbers: Vec<f64>) {
        self.columns.push(Part::new(name, class, width, numbers));
    }

    fn places(&mut self, name: &str, points: &[Point3<f64>]) {
        let numbers: &[f64] = bytemuck::cast_slice(points);
        self.push(name, Class::Place, 3, numbers.to_vec());
    }

    fn attributes(&mut self, of: &str, attributes: &Attributes) {
        for (name, attribute) in attributes.iter() {
            let full = format!("{of}{name}");
            match attribute {
                Attribute::Number(column) => self.push(&full, Class::Number, 1, column.to_vec()),
                Attribute::Index(column) => self.push(&full, Class::Exact, 1, whole(column)),
                Attribute::Flag(column) => self.push(&full, Class::Exact, 1, whole(column)),
                Attribute::Pair(column) => {
                    self.push(&full, Class::Number, 2, column.as_flattened().to_vec());
                }
                Attribute::Vector(column) => {
                    let class = if name == "normal" { Class::Normal } else { Class::Number };
                    self.push(&full, class, 3, column.as_flattened().to_vec());
                }
                Attribute::Color(column) => {
                    self.push(&full, Class::Level, 3, whole(column.as_flattened()));
                }
            }
        }
    }

    fn mesh(&mut self, mesh: &Mesh) {
        self.fact("vertices", mesh.positions().len());
        self.fact("faces", mesh.faces().len());
        let sides = mesh.faces().sides();
        self.fact("corners of a face", sides.map_or("mixed".into(), |sides| sides.to_string()));
        self.fact(
            "texture",
            mesh.texture().map_or("none".into(), |texture| {
                let pixels: &[u8] = texture.pixels().as_flattened();
                format!(
                    "{} x {}, {}",
                    texture.width(),
                    texture.height(),
                    crate::Hash::of(pixels).short()
                )
            }),
        );
        self.frame(mesh.frame());
        self.places("position", mesh.positions());
        if sides.is_none() {
            let sides = mesh.faces().iter().map(|face| face.len() as f64);
            self.push("sides", Class::Exact, 1, sides.collect());
        }
        let corners = whole(mesh.faces().corners());
        self.push("corners", Class::Exact, sides.unwrap_or(1), corners);
        self.attributes("", mesh.vertex());
        self.attributes("corner ", mesh.corner());
        self.attributes("face ", mesh.face());
        let creases = mesh.creases();
        if creases.len() > 0 {
            let creases = creases.flat_map(|([a, b], sharp)| [f64::from(a), f64::from(b), sharp]);
            self.push("creases", Class::Number, 3, creases.collect());
        }
    }

    fn frame(&mut self, frame: Option<&CaptureFrame>) {
        let Some(frame) = frame else { return };
        let picture = frame.picture.map(|size| size as f64);
        let camera = frame.camera.map_or([f64::NAN; 4], |camera| {
            let ([fx, fy], [cx, cy]) = (camera.focal, camera.center);
            [fx, fy, cx, cy]
        });
        let numbers = [&camera[..], &picture[..], &[frame.depth]].concat();
        self.push("frame", Class::Number, 7, numbers);
    }

    fn net(&mut self, net: &ControlNet) {
        self.frame(net.frame());
        self.fact("control points", format!("{} x {}", net.rows(), net.columns()));
        self.row = Some(net.columns());
        self.places("point", net.points());
        self.places("base", net.base());
        self.push("weight", Class::Number, 1, net.weights().to_vec());
        self.push("fixed", Class::Exact, 1, whole(net.fixed()));
        if let Some(chart) = net.chart() {
            self.fact("chart", format!("{} of {:?} cells", chart.cells.len(), chart.grid));
            self.push("chart cell", Class::Exact, 1, whole(&chart.cells));
            let coordinates = chart.coordinates.as_flattened().to_vec();
            self.push("chart coordinate", Class::Number, 2, coordinates);
        }
    }

    fn knots(&mut self, name: &str, knots: &KnotVector) {
        self.fact(&format!("degree of {name}"), knots.degree());
        self.push(name, Class::Number, 1, knots.knots().to_vec());
    }

    fn handles(&mut self, handles: &Handles) {
        self.fact("handles", handles.len());
        self.fact("space", format!("{:?}", handles.space()));
        self.places("at", handles.at());
        self.places("to", handles.to());
        self.push("sigma", Class::Number, 3, handles.sigma().as_flattened().to_vec());
        self.push("weight", Class::Number, 1, handles.weight().to_vec());
    }

    fn range(&mut self, range: &RangeImage) {
        self.grid(range.width(), range.height());
        self.fact("valid cells", range.n_valid());
        self.places("point", range.points());
        let filled =
            (0..range.points().len()).map(|cell| f64::from(u8::from(range.is_filled(cell))));
        self.push("filled", Class::Exact, 1, filled.collect());
        if let Some(colors) = range.colors() {
            self.push("color", Class::Level, 3, whole(colors.as_flattened()));
        }
        let registration = range.registration();
        let numbers = [registration.scale, registration.offset].concat();
        self.push("registration", Class::Number, 4, numbers);
        if let Some(camera) = range.camera() {
            self.push("camera", Class::Number, 4, [camera.focal, camera.center].concat());
        }
        if let Some(pose) = range.world_from_camera() {
            self.push("pose", Class::Number, 16, pose.as_slice().to_vec());
        }
    }

    fn region(&mut self, region: &Region) {
        self.grid(region.width(), region.height());
        self.fact("cells", region.cells().len());
        self.fact("contours", region.contours().len());
        self.places("point", region.points());
        self.push("cell", Class::Exact, 1, whole(region.cells()));
        self.push("filled", Class::Exact, 1, whole(region.filled()));
        let contour = region.contours().iter().flat_map(|contour| whole(&contour.cells));
        self.push("contour", Class::Exact, 1, contour.collect());
    }

    fn curve(&mut self, curve: &Curve) {
        self.fact("points", curve.points().len());
        self.fact("closed", curve.is_closed());
        self.places("point", curve.points());
        if let (Some(knots), Some(weights)) = (curve.knots(), curve.weights()) {
            self.knots("knots", knots);
            self.push("weight", Class::Number, 1, weights.to_vec());
        }
    }
}

fn whole<T: Copy + Into<f64>>(numbers: &[T]) -> Vec<f64> {
    numbers.iter().map(|&number| number.into()).collect()
}
