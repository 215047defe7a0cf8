//! Random cuts of smooth surfaces: fills beside thin plates and the true surface.

use nalgebra::Vector3;

use super::super::exemplar::{Start, Update};
use super::*;

/// A lumpy ball, the cap that is cut out of it, and what is left.
struct Cut {
    waves: Vec<Wave>,
    edge: f64,
    whole: Mesh,
    is_lost: Vec<bool>,
    holed: Mesh,
}

/// A wave on the unit sphere.
struct Wave {
    height: f64,
    frequency: Vector3<f64>,
    phase: f64,
}

/// A sequence of pseudorandom numbers.
struct Sequence(u64);

impl Sequence {
    /// Returns a number from `low` to `high`.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 += 1;
        low + (high - low) * random(self.0)
    }

    fn direction(&mut self) -> Vector3<f64> {
        loop {
            let direction = Vector3::from_fn(|_, _| self.between(-1.0, 1.0));
            if (0.01..1.0).contains(&direction.norm_squared()) {
                return direction.normalize();
            }
        }
    }
}

impl Cut {
    /// Creates the cut with the number `seed`. One in four has no sampling noise, the others up to 2 % of the edge length. In two of three,
    /// the surface farther than two widths from the hole is rough: it has noise of `far_noise` edge lengths.
    fn new(seed: u64, far_noise: f64) -> Self {
        let mut sequence = Sequence(seed << 32);
        let ball = sphere(4);
        let edge = 0.1;
        let waves: Vec<Wave> = (0..4)
            .map(|_| Wave {
                height: sequence.between(0.02, 0.07),
                frequency: sequence.direction() * sequence.between(1.0, 3.5),
                phase: sequence.between(0.0, 6.0),
            })
            .collect();
        let noise = [0.0, 0.003, 0.01, 0.02][(seed % 4) as usize] * edge;
        let uneven = sequence.between(0.0, 0.25) * edge;
        let axis = sequence.direction();
        let angle = edge * sequence.between(3.0, 7.0);
        let far_noise = if seed.is_multiple_of(3) { 0.0 } else { far_noise * edge };
        let points = ball.positions().iter().map(|point| {
            let direction = (point.coords + sequence.direction() * uneven).normalize();
            let is_far = libm::acos(direction.dot(&axis)) > 3.0 * angle + edge;
            let mut height = sequence.between(-noise, noise);
            height += sequence.between(-1.0, 1.0) * if is_far { far_noise } else { 0.0 };
            Point3::from(direction * (radius(&waves, direction) + height))
        });
        let whole = ball.with_positions(points.collect()).unwrap();
        let positions = whole.positions().iter();
        let is_lost: Vec<bool> =
            positions.map(|p| p.coords.normalize().dot(&axis) > libm::cos(angle)).collect();
        let holed = super::super::border::regions::cut(&whole, &is_lost).unwrap().0;
        Self { waves, edge, whole, is_lost, holed }
    }

    fn fill(&self, method: FillMethod) -> FilledMesh {
        fill(&self.holed, HoleChoice::All, method).unwrap()
    }

    /// Returns the positions of the fill's vertices.
    fn filled<'a>(&self, filled: &'a FilledMesh) -> &'a [Point3<f64>] {
        &filled.mesh.positions()[self.holed.positions().len()..]
    }

    /// Returns the root mean square distance of a fill from the true surface, in edge lengths.
    fn rms(&self, filled: &FilledMesh) -> f64 {
        let points = self.filled(filled);
        let off = points
            .iter()
            .map(|point| point.coords.norm() - radius(&self.waves, point.coords.normalize()));
        (off.map(|off| off * off).sum::<f64>() / points.len() as f64).sqrt() / self.edge
    }

    /// Returns the largest dihedral angles in degrees: of the cut part, and of its fill.
    fn largest_bends(&self, filled: &FilledMesh) -> [f64; 2] {
        let data = self.holed.positions().len();
        let truth = largest_bend(&self.whole, |vertex| self.is_lost[vertex as usize]);
        [truth, largest_bend(&filled.mesh, |vertex| data <= vertex as usize)]
    }
}

/// Returns the distance between the center of a lumpy ball and its surface.
fn radius(waves: &[Wave], direction: Vector3<f64>) -> f64 {
    let heights = waves.iter().map(|w| w.height * libm::sin(w.frequency.dot(&direction) + w.phase));
    1.0 + heights.sum::<f64>()
}

/// Returns the largest dihedral angle, in degrees, of the edges with an end for which `is_in` is true.
fn largest_bend(mesh: &Mesh, is_in: impl Fn(u32) -> bool) -> f64 {
    let points = mesh.positions();
    let mut normals = std::collections::BTreeMap::new();
    let mut largest = 0.0_f64;
    for face in mesh.faces().as_triangles().unwrap() {
        let [a, b, c] = face.map(|vertex| points[vertex as usize]);
        let normal = (b - a).cross(&(c - a));
        for (a, b) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
            let other = normals.insert([a.min(b), a.max(b)], normal);
            if let Some(other) = other.filter(|_| is_in(a) || is_in(b)) {
                largest = largest.max(libm::atan2(normal.cross(&other).norm(), normal.dot(&other)));
            }
        }
    }
    largest.to_degrees()
}

#[test]
fn smooth_cuts_are_filled_as_smoothly_as_by_a_plate() {
    for seed in 0..40 {
        let cut = Cut::new(seed, 0.3);
        let plate_fill = cut.fill(FillMethod::ThinPlate);
        let filled = cut.fill(FillMethod::default());
        let [plate, own] = [&plate_fill, &filled].map(|filled| cut.rms(filled));
        assert!(own <= 1.1 * plate, "cut {seed}: {own} beside {plate}");
        let [truth, bend] = cut.largest_bends(&filled);
        let [_, plate_bend] = cut.largest_bends(&plate_fill);
        assert!(bend <= plate_bend.max(1.5 * truth), "cut {seed}: {bend} beside {truth}");
    }
}

#[test]
fn noise_farther_than_two_widths_changes_no_byte_of_a_smooth_fill() {
    for seed in 0..12 {
        let [calm, rough, other] = [0.0, 0.3, 1.0].map(|far_noise| {
            let cut = Cut::new(seed, far_noise);
            let filled = cut.fill(FillMethod::default());
            let bits = cut.filled(&filled).iter().map(|p| [p.x, p.y, p.z].map(f64::to_bits));
            bits.collect::<Vec<_>>()
        });
        assert!(calm == rough && calm == other, "cut {seed}");
    }
}

#[test]
fn an_ear_at_one_side_of_a_hole_is_no_relief() {
    for seed in 0..4 {
        let turn = 6.0 * random(seed);
        let (sine, cosine) = libm::sincos(turn);
        let height = |x: f64, y: f64| {
            let (u, v) = (x - 20.0 - 9.0 * cosine, y - 20.0 - 9.0 * sine);
            let smooth = libm::sin(0.11 * x + turn) * libm::cos(0.09 * y);
            2.0 * smooth + 4.0 * libm::exp(-(u * u + v * v) / 5.0)
        };
        let mesh =
            remove_vertices(&grid(41, 41, height), |p| libm::hypot(p.x - 20.0, p.y - 20.0) < 4.5);
        let [plate, own] = [FillMethod::ThinPlate, FillMethod::default()]
            .map(|method| fill(&mesh, HoleChoice::All, method).unwrap().mesh);
        assert!(plate == own, "{seed}");
    }
}

#[test]
fn the_published_completion_is_nearly_as_smooth_as_a_plate() {
    for seed in [3, 6, 10] {
        let cut = Cut::new(seed, 0.3);
        let published = ExemplarOptions {
            start: Start::Centroid,
            update: Update::Published,
            ..ExemplarOptions::default()
        };
        let [plate, own] = [FillMethod::ThinPlate, FillMethod::Exemplar(published)]
            .map(|method| cut.rms(&cut.fill(method)));
        assert!(own <= 1.3 * plate, "cut {seed}: {own} beside {plate}");
    }
}
