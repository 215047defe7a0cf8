use maquette_node::Progress;
use nalgebra::{Point3, Vector3};
use rayon::ThreadPoolBuilder;

use super::best_match::Match;
use super::compare::PatchSamples;
use super::completion::{Completion, CompletionResult, distances_to_missing};
use super::hole::Hole;
use super::orientations::Orientations;
use super::search::{Scene, Search};
use super::surface::{NONE, Surface};
use super::*;
use crate::triangles::filling::Filling;

mod relief;
mod shapes;

use shapes::{grid, plate, ridge, sphere};

fn run(filling: &mut Filling, options: &ExemplarOptions) -> CompletionResult {
    complete(filling, options, &CompletionInput::default(), &Progress::silent()).unwrap()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

/// Returns the root mean square distance of the fill's vertices from the unit sphere.
fn off_sphere(filling: &Filling) -> f64 {
    rms(filling.points[filling.n_data_vertices..].iter().map(|point| point.coords.norm() - 1.0))
}

/// Returns the root mean square distance of the fill's vertices from the surface given by `ridge`.
fn off_ridge(filling: &Filling) -> f64 {
    rms(filling.points[filling.n_data_vertices..].iter().map(|point| point.z - ridge(point.x)))
}

#[test]
fn a_plane_converges_at_once() {
    let tilt = nalgebra::Rotation3::new(Vector3::new(0.4, -0.7, 0.2));
    let mut filling = grid(25, |x, y| x * x + y * y < 0.06, |_, _| 0.0);
    filling.points.iter_mut().for_each(|point| *point = tilt * *point);
    // With the default start, the plane would be kept without any iteration.
    let options = ExemplarOptions { start: Start::Flat, ..ExemplarOptions::default() };
    let done = run(&mut filling, &options);
    assert!(!done.no_exemplar);
    for point in &filling.points {
        assert!((tilt.inverse() * point).z.abs() <= 1e-9);
    }
    for step in &done.trace {
        assert!(step.rms * step.rms <= 1e-18, "{step:?}");
    }
    let levels = done.trace.len() as u64;
    assert!(done.trace.last().unwrap().iteration < 2 * levels, "{:?}", done.trace);
}

/// Returns the setup of the reference measurement: a sphere in which a cap with a half angle of 28 degrees is missing and filled flat.
fn flat_cap() -> (Filling, ExemplarOptions) {
    let limit = libm::cos(28.0_f64.to_radians());
    let mut filling = sphere(3, |point| point.z > limit);
    let data = filling.n_data_vertices;
    filling.points[data..].iter_mut().for_each(|point| point.z = limit);
    let options = ExemplarOptions {
        start: Start::Flat,
        radii: vec![0.75, 0.5, 0.32],
        ..ExemplarOptions::default()
    };
    (filling, options)
}

#[test]
fn a_flat_cap_becomes_round_again_and_the_data_stay() {
    let (mut filling, options) = flat_cap();
    assert_eq!(filling.points.len() - filling.n_data_vertices, 37);
    let before = filling.points[..filling.n_data_vertices].to_vec();
    run(&mut filling, &options);
    assert!(off_sphere(&filling) <= 0.01, "{}", off_sphere(&filling));
    assert_eq!(filling.points[..filling.n_data_vertices], before);
}

#[test]
fn the_energy_of_kept_iterations_decreases() {
    let (mut filling, options) = flat_cap();
    let options = ExemplarOptions { levels: 1, radii: vec![0.5], ..options };
    let trace = run(&mut filling, &options).trace;
    assert!(trace.len() > 2);
    assert!(trace.windows(2).all(|pair| pair[1].rms <= pair[0].rms), "{trace:?}");
}

/// The trace has the measure by which iterates are compared. The iteration must keep the best iterate, and end near it.
#[test]
fn the_result_is_no_worse_than_any_iterate() {
    for update in [Update::Exact, Update::Published] {
        let (start, options) = flat_cap();
        let patience = Some(2);
        let options = ExemplarOptions { levels: 1, radii: vec![0.5], update, patience, ..options };
        fn finish(start: &Filling, options: &ExemplarOptions) -> (f64, f64) {
            let mut filling = start.clone();
            let last = run(&mut filling, options).trace.last().unwrap().rms;
            (last, off_sphere(&filling))
        }
        let (result, off) = finish(&start, &options);
        let iterates = [1, 4, 8].map(|iterations| {
            let (iterations, limited) = (Some(iterations), options.clone());
            finish(&start, &ExemplarOptions { iterations, ..limited })
        });
        assert!(iterates.windows(2).all(|pair| pair[1].0 <= pair[0].0), "{iterates:?}");
        assert!(iterates.iter().all(|iterate| result <= iterate.0), "{update:?} {iterates:?}");
        let nearest = iterates.iter().map(|iterate| iterate.1).fold(f64::INFINITY, f64::min);
        assert!(off <= nearest + 0.02 * iterates[0].1, "{update:?} {off} {iterates:?}");
    }
}

fn broken_ridge() -> Filling {
    let mut filling = grid(29, |x, y| x.abs() < 0.38 && y.abs() < 0.23, |x, _| ridge(x));
    plate(&mut filling);
    filling
}

#[test]
fn a_ridge_is_completed_better_than_by_a_plate() {
    let mut filling = broken_ridge();
    assert_eq!(filling.points.len() - filling.n_data_vertices, 77);
    let start = off_ridge(&filling);
    let options = ExemplarOptions {
        levels: 2,
        radii: vec![0.36, 0.24],
        up: [0.0, 1.0, 0.0],
        ..ExemplarOptions::default()
    };
    run(&mut filling, &options);
    let end = off_ridge(&filling);
    assert!(end < start && end <= 0.009, "{start} {end}");
}

/// Returns a surface with a hole and with bumps that do not repeat exactly.
fn bumps() -> Filling {
    let mut filling = grid(
        41,
        |x, y| x * x + y * y < 0.05,
        |x: f64, y: f64| {
            0.08 * libm::sin(9.0 * x + 0.3) * libm::cos(8.0 * y)
                + 0.03 * libm::sin(17.0 * x - 13.0 * y)
        },
    );
    plate(&mut filling);
    filling
}

#[test]
fn a_rigid_motion_with_its_up_vector_moves_the_fill() {
    let motion =
        nalgebra::Isometry3::new(Vector3::new(3.0, -1.0, 2.0), Vector3::new(0.5, 0.3, -0.8));
    let mut filling = bumps();
    let mut moved = filling.clone();
    moved.points.iter_mut().for_each(|point| *point = motion * *point);
    run(&mut filling, &ExemplarOptions::default());
    let up = motion * Vector3::y();
    run(&mut moved, &ExemplarOptions { up: up.into(), ..ExemplarOptions::default() });
    for (point, moved) in filling.points.iter().zip(&moved.points) {
        assert!((motion * point - moved).norm() < 1e-7);
    }
}

#[test]
fn without_exemplars_the_start_is_unchanged() {
    let mut filling = bumps();
    let start = filling.points.clone();
    let nowhere = CompletionInput {
        allowed: Some(vec![false; filling.n_data_vertices]),
        ..CompletionInput::default()
    };
    let options = ExemplarOptions::default();
    let done = complete(&mut filling, &options, &nowhere, &Progress::silent()).unwrap();
    assert!(done.no_exemplar && done.trace.is_empty());
    assert_eq!(filling.points, start);
    assert!(done.copies.exemplar.iter().all(|&vertex| vertex == NONE));
}

#[test]
fn exemplars_come_from_where_they_are_allowed() {
    let mut filling = bumps();
    let allowed: Vec<bool> =
        filling.points[..filling.n_data_vertices].iter().map(|p| p.x > 0.0).collect();
    let options = ExemplarOptions::default();
    let given = CompletionInput { allowed: Some(allowed.clone()), ..CompletionInput::default() };
    let done = complete(&mut filling, &options, &given, &Progress::silent()).unwrap();
    assert!(!done.no_exemplar);
    assert!(done.copies.exemplar.iter().all(|&vertex| vertex != NONE && allowed[vertex as usize]));
}

/// Returns two sums of squared distances to patches: of the matches that the fast search finds, and of the best matches.
fn found_and_best(filling: &mut Filling, options: &ExemplarOptions) -> [f64; 2] {
    let Filling { points, faces, n_data_vertices: data, n_data_faces: kept } = filling;
    let surface = Surface::new(points.len(), faces);
    let hole = Hole::new(&surface, points, *data).unwrap();
    let mut completion = Completion {
        surface: &surface,
        n_data_vertices: *data,
        n_data_faces: *kept,
        options,
        allowed: None,
        colors: Vec::new(),
        distances: distances_to_missing(&surface, points, *data, 10.0),
        orientations: Orientations::new(options.rotations.unwrap_or(1), options.mirror),
        areas: (0..points.len() as u32).map(|vertex| surface.area(points, vertex)).collect(),
        smooth_holes: vec![false; hole.count()],
        hole,
        sharp: &[],
        guides: Vec::new(),
    };
    let size = completion.size(completion.hole.smallest_radius(), 0);
    let exemplars = completion.exemplars(&size, points, &Progress::silent()).unwrap();
    let outcome = completion.level(&size, &exemplars, points, 0, &Progress::silent()).unwrap();
    let search = Search {
        surface: &surface,
        data: &points[..*data],
        colors: &[],
        patches: &outcome.patches,
        exemplars: &exemplars,
        orientations: &completion.orientations,
        radius: size.radius,
        seed: 0,
    };
    let normals = outcome.patches.normals(&completion.areas);
    let scene = Scene { points, normals: &normals, frames: &outcome.frames };
    let (mut fast, mut best) = (0.0, 0.0);
    for (center, found) in outcome.matches.iter().enumerate() {
        let mut patch = PatchSamples::default();
        search.load_patch(&scene, center, &mut patch);
        fn compare(
            exemplar: u32,
            orientation: u8,
            patch: &PatchSamples,
            exemplars: &exemplars::Exemplars,
            completion_turns: &Orientations,
        ) -> f64 {
            let mut view = Vec::new();
            patch.view(exemplars.lattice.step, completion_turns.get(orientation), &mut view);
            patch.compare(&view, exemplars.heights(exemplar), f64::INFINITY)
        }
        fast += compare(
            found.exemplar,
            found.orientation,
            &patch,
            &exemplars,
            &completion.orientations,
        );
        let orientations = completion.orientations.range_for(&outcome.frames[center]);
        let all = (0..exemplars.len() as u32)
            .flat_map(|k| orientations.clone().map(move |orientation| (k, orientation)));
        best += all
            .map(|(k, orientation)| {
                compare(k, orientation as u8, &patch, &exemplars, &completion.orientations)
            })
            .fold(f64::INFINITY, f64::min);
        assert!(*found != Match::NOTHING);
    }
    [fast, best]
}

#[test]
fn the_fast_search_finds_nearly_the_best() {
    let options = ExemplarOptions {
        iterations: Some(0),
        rotations: Some(2),
        mirror: true,
        ..Default::default()
    };
    let [fast, best] = found_and_best(&mut bumps(), &options);
    assert!(fast <= 1.05 * best, "{fast} {best}");
}

#[test]
fn the_fast_search_finds_nearly_the_best_among_sharp_edges() {
    // The surface has roofs of various widths, with steep sides and gable ends.
    let mut filling = grid(
        71,
        |x, y| x * x + y * y < 0.1,
        |x: f64, y: f64| {
            let along = 3.0 * x + 0.8 * libm::sin(2.0 * y);
            (0.12 * (along - along.round()).abs()).max(0.1 * (2.0 * y - (2.0 * y).round()).abs())
        },
    );
    plate(&mut filling);
    let options = ExemplarOptions { iterations: Some(0), ..ExemplarOptions::default() };
    let [fast, best] = found_and_best(&mut filling, &options);
    assert!(fast <= 1.05 * best, "{fast} {best}");
}

#[test]
fn the_number_of_threads_does_not_change_the_result() {
    fn complete(threads: usize) -> (Vec<Point3<f64>>, Vec<maquette_value::TraceStep>, Vec<u32>) {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut filling = bumps();
            let done = run(&mut filling, &ExemplarOptions::default());
            (filling.points, done.trace, done.copies.exemplar)
        })
    }
    assert!(complete(1) == complete(3));
}

#[test]
fn without_iterations_the_start_is_unchanged_but_has_exemplars() {
    for update in [Update::Exact, Update::Published] {
        let mut filling = bumps();
        let start = filling.points.clone();
        let options = ExemplarOptions { iterations: Some(0), update, ..ExemplarOptions::default() };
        let done = run(&mut filling, &options);
        assert_eq!(filling.points, start);
        assert!(
            done.copies.exemplar.iter().all(|&vertex| (vertex as usize) < filling.n_data_vertices)
        );
    }
}

#[test]
fn the_published_update_rounds_a_cap_too() {
    let (mut filling, options) = flat_cap();
    let start = off_sphere(&filling);
    run(&mut filling, &ExemplarOptions { update: Update::Published, ..options });
    assert!(off_sphere(&filling) < 0.5 * start, "{start} {}", off_sphere(&filling));
}

#[test]
fn a_filled_part_is_as_rough_as_what_is_around_it() {
    // The bumps are four edges wide; a thin plate across the hole has no bumps.
    let shared = grid(
        41,
        |x, y| x * x + y * y < 0.05,
        |x: f64, y: f64| 0.02 * libm::sin(40.0 * x) * libm::sin(40.0 * y),
    );
    let mut filling = shared.clone();
    plate(&mut filling);
    fn heights(filling: &Filling) -> f64 {
        rms(filling.points[filling.n_data_vertices..].iter().map(|p| p.z))
    }
    let (truth, start) = (heights(&shared), heights(&filling));
    run(&mut filling, &ExemplarOptions::default());
    let end = heights(&filling);
    assert!(start < 0.5 * truth && (end / truth - 1.0).abs() < 0.25, "{start} {end} {truth}");
}

/// Returns the 10th, 25th, 50th, 75th and 90th percentile of the absolute dihedral angles of the edges for whose corners `is_in` is true.
fn bends(filling: &Filling, is_in: impl Fn([u32; 4]) -> bool) -> [f64; 5] {
    let surface = Surface::new(filling.points.len(), &filling.faces);
    let edges = dihedral_angles::hinges(&surface).filter(|&corners| is_in(corners));
    let mut angles: Vec<f64> = edges
        .map(|corners| dihedral_angles::dihedral_angle(corners, &filling.points).abs())
        .collect();
    angles.sort_by(f64::total_cmp);
    [10, 25, 50, 75, 90].map(|fraction| angles[fraction * angles.len() / 100])
}

#[test]
fn filled_curls_have_the_angles_of_their_surroundings() {
    let mut filling = grid(
        41,
        |x, y| x * x + y * y < 0.06,
        |x: f64, y: f64| {
            let curl = libm::sin(22.0 * x + 3.0 * libm::sin(9.0 * y));
            0.04 * curl + 0.01 * libm::sin(31.0 * x - 27.0 * y)
        },
    );
    plate(&mut filling);
    let data = filling.n_data_vertices as u32;
    run(&mut filling, &ExemplarOptions::default());
    // The compared region extends as far from the hole as the hole is wide.
    fn is_near_hole(vertex: u32, filling_points: &[Point3<f64>]) -> bool {
        filling_points[vertex as usize].xy().coords.norm() < 0.74
    }
    let inside = bends(&filling, |[a, b, c, d]| data <= a.max(b).max(c.min(d)));
    let around = bends(&filling, |corners| {
        corners.iter().all(|&vertex| vertex < data && is_near_hole(vertex, &filling.points))
    });
    for (inside, around) in inside.iter().zip(around) {
        assert!((inside / around - 1.0).abs() < 0.15, "{inside} beside {around}");
    }
}

#[test]
fn angles_have_a_sign_and_gradients() {
    let points = [[0.0, 0.0, 0.0], [1.2, 0.1, 0.0], [0.4, 1.0, 0.3], [0.7, -0.9, 0.2]];
    let points = points.map(Point3::from);
    let corners = [0, 1, 2, 3];
    assert!(
        dihedral_angles::dihedral_angle(corners, &points) < 0.0,
        "both faces rise from the edge"
    );
    for (corner, slope) in dihedral_angles::angle_gradients(corners, &points).iter().enumerate() {
        for axis in 0..3 {
            let [above, below] = [1e-5, -1e-5].map(|step| {
                let mut points = points;
                points[corner][axis] += step;
                dihedral_angles::dihedral_angle(corners, &points)
            });
            let difference = (above - below) / 2e-5;
            assert!((difference - slope[axis]).abs() < 1e-8, "{difference} {slope}");
        }
    }
}

#[test]
fn votes_average_the_attributes_of_exemplars() {
    let mut filling = bumps();
    let done = run(&mut filling, &ExemplarOptions::default());
    // Copying an attribute that is constant must not change it.
    for mean in done.copies.votes.mean(|_| [0.25, 4.0]) {
        let [a, b] = mean.expect("every filled vertex has votes");
        assert!((a - 0.25).abs() < 1e-12 && (b - 4.0).abs() < 1e-12);
    }
    // An attribute with two values is mixed where the averaged exemplars differ in it.
    let sides = done
        .copies
        .votes
        .mean(|vertex| [f64::from(u8::from(filling.points[vertex as usize].x > 0.0))]);
    assert!(sides.iter().flatten().all(|[side]| (0.0..=1.0).contains(side)));
    assert!(sides.iter().flatten().any(|[side]| 0.1 < *side && *side < 0.9));
}

#[test]
fn a_lost_part_is_completed_from_its_mirror_image() {
    // The surface has two bumps, each steeper on the side away from the other.
    fn bump(u: f64, v: f64) -> f64 {
        0.2 * libm::exp(-(u * u + v * v) / 0.05) * (1.0 + 3.0 * u)
    }
    let shared = grid(
        41,
        |x, y| libm::hypot(x - 0.45, y) < 0.22,
        |x: f64, y: f64| bump(-0.45 - x, y) + bump(x - 0.45, y),
    );
    fn rms_error(mirror: bool, shared: &Filling) -> f64 {
        let mut filling = shared.clone();
        let data = filling.n_data_vertices;
        filling.points[data..].iter_mut().for_each(|point| point.z = 0.06);
        let allowed = filling.points[..data]
            .iter()
            .map(|point| libm::hypot(point.x + 0.45, point.y) < 0.3)
            .collect();
        let given = CompletionInput { allowed: Some(allowed), ..CompletionInput::default() };
        let options = ExemplarOptions { start: Start::Flat, mirror, ..ExemplarOptions::default() };
        complete(&mut filling, &options, &given, &Progress::silent()).unwrap();
        let pairs = filling.points[data..].iter().zip(&shared.points[data..]);
        rms(pairs.map(|(point, truth)| point.z - truth.z))
    }
    let (alike, turned) = (rms_error(false, &shared), rms_error(true, &shared));
    assert!(turned < 0.02 && turned < 0.8 * alike, "{alike} {turned}");
}
