//! Tests of deformed objects (meshes, range images, points, curves and control nets), and of results with various numbers of threads.

use maquette_value::{Attribute, ControlNet, Curve, Faces, KnotVector, Mesh, RangeImage};

use super::super::Drag;
use super::super::free_form::object;
use super::*;

fn apply(
    object: &Movable,
    handles: &[Handle],
    (mode, options): (Mode, DeformOptions),
) -> (Movable, Report) {
    ffd(object, &in_world(handles), mode, options, &Progress::silent()).unwrap()
}

/// Returns a square sheet of quads over the unit square, at the z coordinate `height`, with normals along z.
fn sheet(sides: usize, height: f64) -> Mesh {
    fn corner(k: usize, sides: usize) -> u32 {
        (k / sides * (sides + 1) + k % sides) as u32
    }
    let next = sides as u32 + 1;
    let faces = Faces::uniform(
        4,
        (0..sides * sides)
            .flat_map(|k: usize| {
                [
                    corner(k, sides),
                    corner(k, sides) + 1,
                    corner(k, sides) + next + 1,
                    corner(k, sides) + next,
                ]
            })
            .collect::<Vec<_>>(),
    )
    .unwrap();
    let count = (sides + 1) * (sides + 1);
    let mesh = Mesh::new(
        (0..count)
            .map(|k: usize| {
                fn coordinate(k: usize, sides: usize) -> f64 {
                    k as f64 / sides as f64
                }
                Point3::new(
                    coordinate(k % (sides + 1), sides),
                    coordinate(k / (sides + 1), sides),
                    height,
                )
            })
            .collect::<Vec<_>>(),
        faces,
    )
    .unwrap();
    let normals = Attribute::Vector(vec![[0.0, 0.0, 1.0]; count].into());
    let corners = Attribute::Vector(vec![[0.0, 0.0, 1.0]; 4 * sides * sides].into());
    let uv = Attribute::Pair(vec![[0.25, 0.5]; count].into());
    mesh.with_vertex("normal", normals)
        .unwrap()
        .with_corner("normal", corners)
        .unwrap()
        .with_vertex("uv", uv)
        .unwrap()
}

fn mesh_of(object: Movable) -> Mesh {
    let Movable::Mesh(mesh) = object else { panic!("a mesh stays a mesh") };
    mesh
}

#[test]
fn normals_of_a_plane_under_an_affine_motion_are_those_of_its_image() {
    let linear = Matrix3::new(0.8, 0.3, -0.2, 0.1, 1.2, 0.4, 0.5, -0.1, 0.9);
    let handles: Vec<Handle> = corners([0.5; 3])
        .into_iter()
        .map(|handle| Handle { to: Some((linear * Vector3::from(handle.at)).into()), ..handle })
        .collect();
    let mesh =
        mesh_of(apply(&Movable::Mesh(sheet(4, 0.3)), &handles, options_in_unit(Mode::Affine)).0);
    let expected = (linear.column(0).cross(&linear.column(1))).normalize();
    let normals = mesh.vertex().vectors("normal").unwrap().iter();
    for normal in normals.chain(mesh.corner().vectors("normal").unwrap().iter()) {
        assert!((Vector3::from(*normal) - expected).norm() <= 1e-12, "{normal:?} {expected}");
    }
    assert_eq!(mesh.vertex().pairs("uv").unwrap()[3], [0.25, 0.5]);
    assert_eq!(mesh.faces(), sheet(4, 0.3).faces());
}

#[test]
fn normals_of_a_bent_sheet_are_near_those_of_its_faces() {
    let mut handles = corners([0.4; 3]);
    let at = Point3::new(0.5, 0.5, 0.5);
    handles.push(handle(at, at + Vector3::new(0.1, 0.0, 0.3), [0.25; 3]));
    let mesh = mesh_of(
        apply(&Movable::Mesh(sheet(100, 0.5)), &handles, options_in_unit(Mode::Displacement)).0,
    );
    let exact = mesh.vertex().vectors("normal").unwrap();
    for (vertex, faces) in mesh.vertex_normals().iter().enumerate() {
        let inside = (1..100).contains(&(vertex / 101)) && (1..100).contains(&(vertex % 101));
        let off = (Vector3::from(exact[vertex]) - faces).norm();
        assert!(!inside || off <= 2e-3, "{vertex}: {off}");
    }
}

#[test]
fn folds_are_counted_and_marked_and_old_marks_are_removed() {
    fn pulled_handles(distance: f64) -> Vec<Handle> {
        let mut handles = corners([0.5; 3]);
        let at = Point3::new(0.5, 0.5, 0.5);
        handles.push(handle(at, at + Vector3::new(distance, 0.0, 0.0), [0.15; 3]));
        handles
    }
    let options = (Mode::Displacement, DeformOptions { background: 0.01, ..in_unit() });
    let (calm, report) = apply(&Movable::Mesh(sheet(40, 0.5)), &pulled_handles(0.05), options);
    assert_eq!(report.folded, 0);
    assert!(
        0.0 < report.min_determinant && report.min_determinant < 1.0,
        "{}",
        report.min_determinant
    );
    assert_eq!(mesh_of(calm).vertex().get("folded"), None);
    let (folded, report) = apply(&Movable::Mesh(sheet(40, 0.5)), &pulled_handles(0.6), options);
    assert!(
        0 < report.folded && report.folded < 41 * 41 / 2 && report.min_determinant < 0.0,
        "{report:?}"
    );
    let mesh = mesh_of(folded.clone());
    let Some(Attribute::Flag(flags)) = mesh.vertex().get("folded") else { panic!("no marks") };
    assert_eq!(flags.iter().filter(|flag| **flag == 1).count(), report.folded);
    let (calm, _) = apply(&folded, &pulled_handles(0.01), options);
    assert_eq!(mesh_of(calm).vertex().get("folded"), None);
}

#[test]
fn unreached_points_are_unchanged() {
    let sheet = sheet(100, -0.0);
    let normals = sheet.vertex().get("normal").unwrap().clone();
    let sheet = sheet.without_attribute("normal").with_vertex("normal", normals.clone()).unwrap();
    let points = Points::new(sheet.positions().to_vec()).unwrap();
    let points = points.with_attribute("normal", normals).unwrap();
    let at = Point3::new(0.2, 0.3, 0.0);
    for (step, folds) in [(0.01, false), (0.4, true)] {
        let to = at + Vector3::new(step, 0.0, 0.01);
        let handles = [handle(at, to, [0.02; 3])];
        let exact = (Mode::Displacement, DeformOptions { background: 0.1, ..in_unit() });
        let near = (exact.0, DeformOptions { accuracy: 1e-6, ..exact.1 });
        for object in [Movable::Mesh(sheet.clone()), Movable::Points(points.clone())] {
            let ((all, of_all), (some, of_some)) =
                (apply(&object, &handles, exact), apply(&object, &handles, near));
            let (at, to) = (object::points(&all), object::points(&some));
            assert!(farthest(at, to) <= 1e-6 * 3_f64.sqrt());
            fn bits(position: &Point3<f64>) -> [u64; 3] {
                [position.x, position.y, position.z].map(f64::to_bits)
            }
            let rest = to.iter().zip(sheet.positions().iter());
            let rest = rest.filter(|(to, at)| bits(to) == bits(at)).count();
            assert!((6000..9900).contains(&rest), "{rest}");
            let turned = [&all, &some].map(|object| object::field_request(object).normals.unwrap());
            let off = turned[0].iter().zip(turned[1]);
            let off = off.map(|(a, b)| (Vector3::from(*a) - Vector3::from(*b)).norm());
            assert!(off.fold(0.0, f64::max) <= 1e-3);
            assert_eq!((of_some.folded > 0, of_some.folded), (folds, of_all.folded));
            assert!((of_some.min_determinant - of_all.min_determinant).abs() <= 1e-4);
        }
    }
}

fn pull() -> Vec<Handle> {
    let mut handles = corners([0.5; 3]);
    handles[0].to = Some([0.0, 0.1, -0.2]);
    handles
}

#[test]
fn a_range_image_keeps_its_holes_and_its_camera() {
    let hole = Point3::new(f64::NAN, 0.0, 0.0);
    let points = vec![Point3::origin(), hole, Point3::new(1.0, 1.0, 1.0), hole];
    let camera = maquette_value::Pinhole { focal: [1.0; 2], center: [0.0; 2] };
    let range = RangeImage::new(2, 2, points).unwrap().with_camera(Some(camera));
    let (result, _) =
        apply(&Movable::RangeImage(range), &pull(), options_in_unit(Mode::Displacement));
    let Movable::RangeImage(result) = result else { panic!("a range image stays one") };
    assert!((result.point(0).unwrap() - Point3::new(0.0, 0.1, -0.2)).norm() <= 1e-14);
    assert_eq!((result.n_valid(), result.point(1), result.camera()), (2, None, Some(&camera)));
}

#[test]
fn a_net_keeps_its_fixed_points_and_its_base() {
    let points = vec![Point3::origin(), Point3::origin(), Point3::new(1.0, 0.0, 0.0)];
    let net = ControlNet::new(1, 3, points).unwrap();
    let net = net.with_weights(vec![1., 2., 3.]).unwrap().with_fixed(vec![0, 1, 0]).unwrap();
    let (result, _) =
        apply(&Movable::ControlNet(net.clone()), &pull(), options_in_unit(Mode::Displacement));
    let Movable::ControlNet(result) = result else { panic!("a net stays a net") };
    assert!((result.points()[0] - Point3::new(0.0, 0.1, -0.2)).norm() <= 1e-14);
    assert_eq!((result.points()[1], result.base()), (Point3::origin(), net.base()));
    assert_eq!(result.weights(), net.weights());
}

#[test]
fn curves_and_points_are_deformed_with_their_attributes() {
    let positions = vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(1.0, 1.0, 0.0)];
    let knots = KnotVector::uniform(3, 3).unwrap();
    let curve = Curve::rational(positions.clone(), vec![1., 2., 1.], knots).unwrap();
    let (result, _) =
        apply(&Movable::Curve(curve.clone()), &pull(), options_in_unit(Mode::Displacement));
    let Movable::Curve(result) = result else { panic!("a curve stays a curve") };
    assert!((result.points()[0] - Point3::new(0.0, 0.1, -0.2)).norm() <= 1e-14);
    assert_eq!((result.weights(), result.knots()), (curve.weights(), curve.knots()));
    let normals = Attribute::Vector(vec![[0.0, 0.0, 1.0]; 3].into());
    let points = Points::new(positions).unwrap().with_attribute("normal", normals).unwrap();
    let (result, report) =
        apply(&Movable::Points(points), &pull(), options_in_unit(Mode::Displacement));
    let Movable::Points(result) = result else { panic!("points stay points") };
    let normal = Vector3::from(result.attributes().vectors("normal").unwrap()[1]);
    assert!((normal.norm() - 1.0).abs() <= 1e-14 && report.min_determinant.is_finite());
}

#[test]
fn the_box_is_that_of_the_object_or_of_another() {
    let points = [Point3::new(2.0, 2.0, 2.0), Point3::new(4.0, 6.0, 2.0)];
    let handles =
        [Handle { at: [1.0, 1.0, 0.0], to: Some([1.5, 1.0, 0.0]), sigma: None, weight: 1.0 }];
    let handles = Handles::new(HandleSpace::Box, &handles).unwrap();
    let object = Movable::Points(Points::new(points.to_vec()).unwrap());
    fn first_point(
        frame: Option<(Point3<f64>, Point3<f64>)>,
        object: &Movable,
        handles: &Handles,
    ) -> Point3<f64> {
        let options = DeformOptions { frame, ..DeformOptions::default() };
        let (moved, _) =
            ffd(object, handles, Mode::default(), options, &Progress::silent()).unwrap();
        let Movable::Points(moved) = moved else { panic!("points stay points") };
        moved.positions()[0]
    }
    assert_eq!(first_point(None, &object, &handles), Point3::new(3.0, 2.0, 2.0));
    assert_eq!(first_point(Some(UNIT), &object, &handles), Point3::new(2.5, 2.0, 2.0));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let mut random = Random(21);
    let handles = scattered_handles(&mut random, 3, 0.6);
    let mesh = Movable::Mesh(sheet(150, 0.4));
    for accuracy in [0.0, 1e-7] {
        let options = (Mode::Affine, DeformOptions { accuracy, ..in_unit() });
        fn run(
            threads: usize,
            mesh: &Movable,
            handles: &[Handle],
            options: &(Mode, DeformOptions),
        ) -> maquette_value::Hash {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (moved, _) = pool.install(|| apply(mesh, handles, *options));
            let mesh = mesh_of(moved);
            maquette_value::hash_of(&mesh)
        }
        assert!(
            [2, 8].iter().all(|&threads| run(threads, &mesh, &handles, &options)
                == run(1, &mesh, &handles, &options))
        );
    }
}

#[test]
fn a_drag_equals_a_deformation() {
    let mut random = Random(22);
    let handles = scattered_handles(&mut random, 3, 0.6);
    let at_rest: Vec<Handle> =
        handles.iter().map(|handle| Handle { to: Some(handle.at), ..*handle }).collect();
    let mesh = Movable::Mesh(sheet(20, 0.4));
    let dragged = [3, 20, 7, 11, 3];
    for (handles, mode) in
        [(&handles, MODES[0]), (&handles, MODES[1]), (&handles, MODES[2]), (&at_rest, MODES[0])]
    {
        let drag = Drag::new(&mesh, &in_world(handles), &dragged, mode, in_unit()).unwrap();
        let targets: Vec<_> = dragged.iter().map(|&k| (k, random.point())).collect();
        let (result, report) = drag.apply_targets(&targets, &Progress::silent()).unwrap();
        let mut now = handles.clone();
        targets.iter().for_each(|(k, to)| now[*k].to = Some((*to).into()));
        let (expected, direct) = apply(&mesh, &now, options_in_unit(mode));
        let (result, expected) = (mesh_of(result), mesh_of(expected));
        assert!(farthest(result.positions(), expected.positions()) <= 1e-12, "{mode:?}");
        fn normals(mesh: &Mesh) -> Vec<[f64; 3]> {
            mesh.vertex().vectors("normal").unwrap().to_vec()
        }
        for (a, b) in normals(&result).into_iter().zip(normals(&expected)) {
            assert!((Vector3::from(a) - Vector3::from(b)).norm() <= 1e-9);
        }
        assert_eq!(report.folded, direct.folded);
        assert!(
            (report.min_determinant - direct.min_determinant).abs()
                <= 1e-9 * direct.min_determinant.abs().max(1.0)
        );
        assert!(report.residual <= 1e-10);
    }
    let error = Drag::new(&mesh, &in_world(&handles), &[27], MODES[0], in_unit()).err().unwrap();
    let no_handle = "there is no handle 27 for a target: there are 27 handles, numbered from 0";
    assert_eq!(error.to_string(), no_handle);
}

#[test]
fn a_drag_without_motion_changes_nothing() {
    let mesh = Movable::Mesh(sheet(3, 0.4));
    let handles = corners([0.5; 3]);
    let drag = Drag::new(&mesh, &in_world(&handles), &[2], Mode::Displacement, in_unit()).unwrap();
    let (result, _) =
        drag.apply_targets(&[(2, Point3::from(handles[2].at))], &Progress::silent()).unwrap();
    assert_eq!(mesh_of(result), sheet(3, 0.4));
}
