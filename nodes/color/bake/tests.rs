use std::f64::consts::{PI, TAU};

use maquette_base::light::{channel, light};
use maquette_value::{Attribute, CaptureFrame, Faces, Pinhole};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Vector3};

use super::camera::Camera;
use super::*;

/// The radius in mm of the sphere that all cameras look at.
const RADIUS: f64 = 20.0;

/// Returns the color of the sphere's paint, as linear light, at a point in world coordinates.
fn paint(place: Point3<f64>) -> [f64; 3] {
    fn wave(x: f64) -> f64 {
        0.25 + 0.15 * libm::sin(x / 4.0)
    }
    [wave(place.x), wave(place.y + 3.0), wave(place.z - 5.0)]
}

/// Returns a sphere in world coordinates: rows of latitude, with a small hole at each pole.
fn ball() -> Mesh {
    let (n, m) = (96u32, 48u32);
    let places = (0..n * (m + 1)).map(|k| {
        let (s, c) = libm::sincos(TAU * f64::from(k % n) / f64::from(n));
        let (t, d) = libm::sincos(PI * (f64::from(k / n) / f64::from(m) * 0.98 + 0.01));
        Point3::new(RADIUS * t * c, -RADIUS * d, -RADIUS * t * s)
    });
    let faces = (0..n * m).flat_map(|k| {
        fn vertex(i: u32, j: u32, k: u32, n: u32) -> u32 {
            (k / n + j) * n + (k % n + i) % n
        }
        [
            [vertex(0, 0, k, n), vertex(1, 0, k, n), vertex(1, 1, k, n)],
            [vertex(0, 0, k, n), vertex(1, 1, k, n), vertex(0, 1, k, n)],
        ]
    });
    Mesh::new(places.collect::<Vec<_>>(), Faces::triangles(faces.collect())).unwrap()
}

/// Returns the capture of a camera that is rotated about y by `degrees` and looks at the sphere from 150 mm, in front of a distant wall.
/// The light is multiplied by `exposure`, and by a factor that differs from 1 by up to `slope` from left to right.
fn shot(degrees: f64, exposure: [f64; 3], slope: f64) -> Mesh {
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), degrees.to_radians());
    // A camera looks along its z axis, with y down. Therefore flip the camera, move it back from the sphere, and rotate it around the
    // sphere.
    let over = Rotation3::from_axis_angle(&Vector3::x_axis(), PI);
    let pose = Isometry3::from_parts(Translation3::identity(), (turn * over).into())
        * Translation3::new(0.0, 0.0, -150.0);
    let (size, cells) = ([160_usize; 2], 80_u32);
    let pinhole = Pinhole { focal: [480.0; 2], center: [79.5; 2] };
    fn hit(pixel: [f64; 2], pinhole: &Pinhole) -> Option<Point3<f64>> {
        let ray = pinhole.unproject(pixel, 1.0).coords.normalize();
        let center = Vector3::new(0.0, 0.0, 150.0);
        let along = ray.dot(&center);
        let below = along * along - center.norm_squared() + RADIUS * RADIUS;
        (below > 0.0).then(|| Point3::from(ray * (along - below.sqrt())))
    }
    let picture = Image::new(
        size[0],
        size[1],
        (0..size[0] * size[1])
            .map(|k: usize| {
                let pixel = [k % size[0], k / size[0]].map(|x| x as f64);
                let Some(place) = hit(pixel, &pinhole) else { return [255, 0, 255] };
                let light = paint(pose * place);
                let bright = 1.0 + slope * (pixel[0] / 80.0 - 1.0);
                color_of([0, 1, 2].map(|channel| light[channel] * exposure[channel] * bright))
            })
            .collect::<Vec<_>>(),
    );
    let grid: Vec<_> = (0..cells * cells)
        .map(|k| {
            let pixel = [k % cells, k / cells].map(|x| 2.0 * f64::from(x) + 0.5);
            (hit(pixel, &pinhole), pixel.map(|x| (x + 0.5) / 160.0))
        })
        .collect();
    let quads = (0..cells * (cells - 1)).filter(|k| k % cells + 1 < cells);
    let quads = quads.map(|a| [a, a + cells, a + cells + 1, a + 1]);
    let quads = quads.filter(|quad| quad.iter().all(|&it| grid[it as usize].0.is_some()));
    let quads: Vec<_> = quads.flatten().collect();
    // Cells without a face are left out by `select`.
    let places = grid.iter().map(|it| it.0.unwrap_or_default()).collect::<Vec<_>>();
    let uv = grid.iter().map(|it| [it.1[0], 1.0 - it.1[1]]).collect::<Vec<_>>();
    let mesh = Mesh::new(places, Faces::uniform(4, quads).unwrap()).unwrap();
    let mesh = mesh.with_vertex("uv", Attribute::Pair(uv.into())).unwrap();
    let all: Vec<_> = (0..mesh.faces().len() as u32).collect();
    let frame = CaptureFrame {
        camera: Some(pinhole),
        picture: size,
        depth: 135.0,
        world_from_camera: Some(pose.to_homogeneous()),
    };
    mesh.select(&all).with_texture(Some(picture.unwrap())).with_frame(Some(frame))
}

fn bake_captures(captures: &[Mesh], level: Level) -> BakedMesh {
    let layout = Layout { size: 256, ..Layout::default() };
    let mesh = lay_out(&ball(), &layout);
    let how = Baking { level, ..Baking::default() };
    bake(&mesh, &Vec::from_iter(captures), 256, &how, &Progress::silent()).unwrap()
}

fn lay_out(mesh: &Mesh, layout: &Layout) -> Mesh {
    with_atlas(mesh, Coordinates::New, layout, &|_| (), &Progress::silent()).unwrap()
}

/// Returns the difference between the colors of visible texels and the painted colors, in levels of 0 to 255, after scaling each channel by
/// one factor.
fn color_error(baked: &BakedMesh) -> f64 {
    let texels = Texels::new(&baked.mesh, [256; 2], &Progress::silent()).unwrap();
    let spots = Spot::of_all(&baked.mesh, &texels);
    let seen =
        texels.texels.iter().zip(&spots).filter(|it| baked.mask.pixels()[it.0.pixel as usize] == 0);
    let seen = Vec::from_iter(seen);
    fn light_at(pixel: u32, baked_picture: &Image) -> [f64; 3] {
        baked_picture.pixels()[pixel as usize].map(|x| light(f64::from(x)))
    }
    let factors = [0, 1, 2].map(|k| {
        let (sum, own) = seen.iter().fold((0.0, 0.0), |(sum, own), (texel, spot)| {
            (sum + light_at(texel.pixel, &baked.picture)[k], own + paint(spot.place)[k])
        });
        sum / own
    });
    (seen
        .iter()
        .map(|(texel, spot)| {
            let wanted = [0, 1, 2].map(|k| channel(paint(spot.place)[k] * factors[k]));
            let found = baked.picture.pixels()[texel.pixel as usize].map(f64::from);
            (0..3).map(|k| (found[k] - wanted[k]) * (found[k] - wanted[k])).sum::<f64>() / 3.0
        })
        .sum::<f64>()
        / seen.len() as f64)
        .sqrt()
}

const EQUAL: [f64; 3] = [1.0; 3];

#[test]
fn equal_captures_give_the_paint() {
    let captures = [0.0, 90.0, 180.0, 270.0].map(|angle| shot(angle, EQUAL, 0.0));
    let baked = bake_captures(&captures, Level::None);
    assert!(color_error(&baked) < 1.5, "{}", color_error(&baked));
    // All of the sphere except for its poles is visible.
    assert!(0.0 < baked.unseen && baked.unseen < 0.12, "{}", baked.unseen);
    assert!(baked.steps[0] < 1.5, "{:?}", baked.steps);
}

#[test]
fn captures_of_other_exposure_and_light_are_made_equal() {
    let exposures = [[1.0, 0.8, 1.3], [0.7, 1.0, 1.0], [1.4, 1.2, 0.8], [1.0, 1.0, 1.0]];
    fn shots(slope: f64, exposures: &[[f64; 3]; 4]) -> Vec<Mesh> {
        let angles = [0.0, 90.0, 180.0, 270.0].into_iter().zip(*exposures);
        angles.map(|(angle, exposure)| shot(angle, exposure, slope)).collect::<Vec<_>>()
    }
    let exposed = shots(0.0, &exposures);
    let plain = bake_captures(&exposed, Level::None);
    assert!(
        10.0 < color_error(&plain) && 15.0 < plain.steps[1],
        "{} {:?}",
        color_error(&plain),
        plain.steps
    );
    for level in [Level::Exposure, Level::Smooth] {
        let leveled = bake_captures(&exposed, level);
        assert!(
            color_error(&leveled) < 2.0 && leveled.steps[1] < 2.0,
            "{} {:?}",
            color_error(&leveled),
            leveled.steps
        );
    }
    // A lamp is beside the camera: no constant factor equalizes the captures, but a slowly changing one does.
    let lit = shots(0.4, &exposures);
    let [exposure, smooth] =
        [Level::Exposure, Level::Smooth].map(|level| bake_captures(&lit, level).steps[1]);
    assert!(20.0 < exposure && smooth < 6.0, "{exposure} {smooth}");
}

#[test]
fn the_camera_of_a_moved_capture_follows_from_its_texture_coordinates() {
    let known = shot(30.0, EQUAL, 0.0);
    let frame = known.frame().copied().unwrap();
    let motion = frame.world_from_camera.unwrap();
    let places = known.positions().iter().map(|at| motion.transform_point(at)).collect();
    let moved = known.with_positions(places).unwrap().with_frame(None);
    let found = Camera::from_texture_coordinates(&moved, [160; 2]).unwrap();
    let given = Camera::from_pinhole(&frame.camera.unwrap(), &motion).unwrap();
    for place in moved.positions().iter() {
        let [a, b] = [&found, &given].map(|it| it.pixel(*place).unwrap());
        assert!((0..2).all(|k| (a[k] - b[k]).abs() < 1e-6), "{a:?} {b:?}");
        assert!(
            (found.direction_to_camera(*place).dot(&given.direction_to_camera(*place)).abs() - 1.0)
                .abs()
                < 1e-9
        );
    }
    let [a, b] = [known, moved].map(|it| bake_captures(&[it], Level::None));
    let differ = a.picture.pixels().iter().zip(b.picture.pixels()).filter(|(a, b)| a != b).count();
    assert!(differ < 100, "{differ}");
}

#[test]
fn what_is_not_seen_has_the_colors_around_it() {
    let front = bake_captures(&[shot(0.0, EQUAL, 0.0)], Level::Smooth);
    assert!((0.5..0.75).contains(&front.unseen), "{}", front.unseen);
    // No texel has the color of the background, and none is darker or lighter than the paint.
    let range = [0.1, 0.4].map(channel);
    for pixel in front.picture.pixels() {
        assert!(
            pixel.iter().all(|&x| (range[0] - 2.0..range[1] + 2.0).contains(&f64::from(x))),
            "{pixel:?}"
        );
    }
    // At the border of the visible area there is no step: neighbors in the atlas have similar colors.
    let flags = front.mask.pixels();
    let texels = Texels::new(&front.mesh, [256; 2], &Progress::silent()).unwrap();
    let shown: Vec<_> = (0..256 * 256)
        .map(|k| texels.texels.binary_search_by_key(&k, |it| it.pixel).is_ok())
        .collect();
    let pairs = (0..256 * 256 - 1)
        .filter(|&k| k % 256 < 255 && shown[k] && shown[k + 1] && flags[k] != flags[k + 1]);
    let steps: Vec<_> = pairs
        .filter_map(|k: usize| {
            (0..3)
                .map(|c| front.picture.pixels()[k][c].abs_diff(front.picture.pixels()[k + 1][c]))
                .max()
        })
        .collect();
    assert!(steps.len() > 50 && steps.iter().all(|&step| step < 20), "{:?}", steps.iter().max());
}

#[test]
fn the_picture_is_the_same_on_any_number_of_threads() {
    let captures = [shot(0.0, EQUAL, 0.2), shot(60.0, [0.8; 3], 0.0)];
    fn bake_with(threads: usize, captures: &[Mesh; 2]) -> Image {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| bake_captures(captures, Level::Smooth).picture)
    }
    assert_eq!(bake_with(1, &captures), bake_with(3, &captures));
}

#[test]
fn poses_move_captures_to_the_mesh() {
    let capture = shot(70.0, EQUAL, 0.0);
    let own = capture.clone().with_texture(None);
    let layout = Layout { size: 128, ..Layout::default() };
    let run = |mesh: &Mesh, poses: Poses| {
        let mesh = lay_out(mesh, &layout);
        let how = Baking { poses, ..Baking::default() };
        bake(&mesh, &[&capture], 128, &how, &Progress::silent()).map(|it| it.unseen)
    };
    // Bake the mesh in the camera's frame and in world coordinates. In the camera's frame, a tenth of the half sphere is seen at less than
    // 6 degrees to its surface.
    let in_world = ball();
    assert!(run(&own, Poses::Auto).unwrap() < 0.15 && run(&own, Poses::Ignore).unwrap() < 0.15);
    assert!(run(&in_world, Poses::Auto).unwrap() < 0.75);
    let text = run(&in_world, Poses::Ignore).unwrap_err().to_string();
    let expected = "none of the 1 captures sees anything of the mesh: its vertices are 1";
    assert!(text.starts_with(expected), "{text}");
}

#[test]
fn unsuitable_captures_are_errors() {
    let mesh = lay_out(&ball(), &Layout { size: 64, ..Layout::default() });
    fn error(captures: &[&Mesh], how: Baking, mesh: &Mesh) -> String {
        bake(mesh, captures, 64, &how, &Progress::silent()).unwrap_err().to_string()
    }
    let how = Baking::default();
    assert_eq!(
        error(&[], how, &mesh),
        "the list `captures` is empty: there is nothing to take colors from"
    );
    let good = shot(0.0, EQUAL, 0.0);
    let bare = good.clone().with_texture(None);
    assert_eq!(
        error(&[&good, &bare], how, &mesh),
        "capture 2 has no picture: add its picture with `Texture`"
    );
    let lost = good.clone().with_frame(None);
    assert_eq!(
        error(&[&lost.clone().without_attribute("uv")], how, &mesh),
        "the camera of capture 1 is unknown and cannot be computed from its texture coordinates (there are none): give a camera file, or leave the \
         capture where it was taken"
    );
    let flat = lost
        .with_positions(good.positions().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect())
        .unwrap();
    assert!(error(&[&flat], how, &mesh).contains("(all vertices lie in a plane)"));
    let curled = good
        .positions()
        .iter()
        .map(|p| Point3::new(p.x + 5.0 * libm::sin(p.y), p.y, p.z))
        .collect();
    let curled = good.clone().with_frame(None).with_positions(curled).unwrap();
    assert!(
        error(&[&curled], how, &mesh).contains("the best one is off by"),
        "{}",
        error(&[&curled], how, &mesh)
    );
    let apply = Baking { poses: Poses::Apply, ..how };
    let nowhere = good.clone().with_frame(None);
    assert!(error(&[&good, &nowhere], apply, &mesh).starts_with("capture 2 has no pose: "));
    assert_eq!(
        error(&[&good], Baking { tolerance: f64::NAN, ..how }, &mesh),
        "`tolerance` is NaN, but must be a length, or 0"
    );
    let many = vec![&good; 201];
    assert!(error(&many, how, &mesh).contains("at most 200 are made: bake fewer at once"));
}
