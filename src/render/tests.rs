use maquette_value::{
    Attribute, Axes, BACKGROUND, CaptureFrame, Faces, Image, Layer, Lines, MATERIAL_ATTRIBUTE, Map,
    MapKind, Material, Mesh, Picture, Registration, Rgb, TYPES, Wrap,
};
use nalgebra::Point3;

use super::*;

fn mesh(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
    let positions: Vec<Point3<f64>> = points.iter().map(|&point| point.into()).collect();
    Mesh::new(positions, Faces::triangles(faces.to_vec())).unwrap()
}

fn view(width: usize, height: usize) -> View {
    View { size: [width, height], projection: Projection::Orthographic, ..View::front() }
}

/// Converts a picture to letters, one per pixel: r, g or b for the dominant channel, w for light gray, and `.` for the background.
fn draw(image: &Image) -> String {
    let rows = image.pixels().chunks(image.width());
    rows.map(|row| {
        row.iter()
            .map(|&[r, g, b]| match [r, g, b].map(i32::from) {
                [r, g, b] if r > g + 25 && r > b + 25 => 'r',
                [r, g, b] if g > r + 25 && g > b + 25 => 'g',
                [r, g, b] if b > r + 25 && b > g + 25 => 'b',
                [r, ..] if r > 90 => 'w',
                _ => '.',
            })
            .chain(['\n'])
            .collect::<String>()
    })
    .collect()
}

/// Creates a square of two triangles in one color, at the height z. Its outer side faces +z.
fn square(low: [f64; 2], high: [f64; 2], z: f64, color: Rgb) -> ([[f64; 3]; 4], Rgb) {
    let corners = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
    (corners.map(|[x, y]| [x, y, z]), color)
}

fn squares(squares: &[([[f64; 3]; 4], Rgb)]) -> Mesh {
    let points = squares.iter().flat_map(|(points, _)| *points).collect::<Vec<_>>();
    let faces = (0..squares.len() as u32)
        .flat_map(|i| [[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
    let colors = squares.iter().flat_map(|(_, color)| [*color; 4]).collect();
    mesh(&points, &faces.collect::<Vec<_>>())
        .with_vertex("color", Attribute::Color(colors))
        .unwrap()
}

const RED: Rgb = [255, 0, 0];
const GREEN: Rgb = [0, 255, 0];
const BLUE: Rgb = [0, 0, 255];

#[test]
fn a_triangle_covers_its_pixels() {
    let triangle = mesh(&[[0., 0., 0.], [8., 0., 0.], [0., 8., 0.]], &[[0, 1, 2]]);
    // The triangle begins 0.32 pixels from the border of the picture. The pixels on the longest edge of the triangle are half covered.
    let expected = concat!(
        "w.......\n",
        "ww......\n",
        "www.....\n",
        "wwww....\n",
        "wwwww...\n",
        "wwwwww..\n",
        "wwwwwww.\n",
        "wwwwwww.\n",
    );
    assert_eq!(draw(&render(&triangle, &view(8, 8))), expected);
}

#[test]
fn the_nearer_face_is_visible_in_any_order() {
    let far = square([0., 0.], [6., 6.], 0., RED);
    let near = square([2., 2.], [4., 4.], 1., GREEN);
    for faces in [[far, near], [near, far]] {
        for projection in [Projection::Orthographic, Projection::Perspective] {
            let view = View { projection, ..view(30, 30) };
            let image = render(&squares(&faces), &view);
            let picture = draw(&image);
            fn row(k: usize, picture: &str) -> String {
                picture.lines().nth(k).unwrap().trim_matches('.').to_owned()
            }
            assert!(
                row(15, &picture).starts_with('r')
                    && row(15, &picture).ends_with('r')
                    && row(15, &picture).contains("ggggg")
            );
            assert!(row(4, &picture).contains('r') && !row(4, &picture).contains('g'));
        }
    }
}

#[test]
fn inner_sides_are_red() {
    let points = [[0., 0., 0.], [8., 0., 0.], [0., 8., 0.]];
    let outer = draw(&render(&mesh(&points, &[[0, 1, 2]]), &view(8, 8)));
    let inner = draw(&render(&mesh(&points, &[[0, 2, 1]]), &view(8, 8)));
    // Skip the first row, which the triangle hardly covers.
    assert_eq!(outer.replace('w', "r")[9..], inner[9..]);
}

/// Three squares in the plane z = 0: red at the lower left, green at the lower right, and blue above both.
fn signpost() -> Mesh {
    squares(&[
        square([0., 0.], [4., 4.], 0., RED),
        square([4., 0.], [8., 4.], 0., GREEN),
        square([0., 4.], [8., 8.], 0., BLUE),
    ])
}

#[test]
fn a_mesh_has_x_right_and_y_up_and_a_capture_y_down() {
    // Returns the letters of the pixels in the middle of each quarter of the picture, row by row.
    fn quarters(mesh: &Mesh) -> [u8; 4] {
        let picture = draw(&render(mesh, &view(10, 10)));
        [(2, 2), (2, 7), (7, 2), (7, 7)].map(|(row, column)| picture.as_bytes()[11 * row + column])
    }
    assert_eq!(&quarters(&signpost()), b"bbrg");
    let frame = CaptureFrame { camera: None, picture: [1, 1], depth: 1.0, world_from_camera: None };
    // A sensor looks along +z with y down. To show this side of the faces to the sensor, reverse their orientation.
    let post = signpost();
    let turned = post.faces().as_triangles().unwrap().iter().map(|&[a, b, c]| [a, c, b]);
    let turned = Mesh::new(post.positions().clone(), Faces::triangles(turned.collect()))
        .unwrap()
        .with_vertex("color", post.vertex().get("color").unwrap().clone())
        .unwrap()
        .with_frame(Some(frame));
    assert_eq!(&quarters(&turned), b"rgbb");
}

#[test]
fn yaw_shows_the_right_side_and_pitch_the_top() {
    // Two sides of a cube: the right side is green and the top is blue.
    let right = [[1., 0., 1.], [1., 0., 0.], [1., 1., 0.], [1., 1., 1.]];
    let top = [[0., 1., 1.], [1., 1., 1.], [1., 1., 0.], [0., 1., 0.]];
    let cube = squares(&[(right, GREEN), (top, BLUE)]);
    fn middle(yaw: f64, pitch: f64, cube: &Mesh) -> char {
        let view = View { yaw, pitch, ..view(11, 11) };
        draw(&render(cube, &view)).chars().nth(12 * 5 + 5).unwrap()
    }
    assert_eq!(
        [middle(90., 0., &cube), middle(0., 90., &cube), middle(-90., 0., &cube)],
        ['g', 'b', 'r']
    );
}

#[test]
fn a_texture_is_upright_and_straight_across_the_diagonal() {
    let image = Image::new(2, 2, vec![RED, GREEN, BLUE, [255; 3]]).unwrap();
    let uv = vec![[0., 0.], [1., 0.], [1., 1.], [0., 1.]];
    let board =
        mesh(&[[0., 0., 0.], [4., 0., -9.], [4., 4., -9.], [0., 4., 0.]], &[[0, 1, 2], [0, 2, 3]]);
    let by_vertex = board.clone().with_vertex("uv", Attribute::Pair(uv.clone().into())).unwrap();
    let corners = [0, 1, 2, 0, 2, 3].map(|vertex: usize| uv[vertex]).to_vec();
    let by_corner = board.with_corner("uv", Attribute::Pair(corners.into())).unwrap();
    let [by_vertex, by_corner] = [by_vertex, by_corner].map(|mesh| {
        let view = View { projection: Projection::Perspective, ..view(60, 60) };
        render(&mesh.with_texture(Some(image.clone())), &view)
    });
    assert_eq!(by_vertex, by_corner);
    let picture = draw(&by_vertex);
    fn row(k: usize, picture: &str) -> String {
        picture.lines().nth(k).unwrap().trim_matches('.').to_owned()
    }
    assert!(row(24, &picture).starts_with('r') && row(24, &picture).ends_with('g'), "{picture}");
    assert!(row(35, &picture).starts_with('b') && row(35, &picture).ends_with('w'), "{picture}");
    // With perspective, the near half of the board looks wider than the far half.
    let red = row(24, &picture).chars().filter(|&c| c == 'r').count();
    let green = row(24, &picture).chars().filter(|&c| c == 'g').count();
    assert!(red > green, "{red} {green}");
}

/// Creates a wavy sheet of `n` x `n` squares.
fn waves(n: u32) -> Mesh {
    let points = (0..(n + 1) * (n + 1))
        .map(|k: u32| {
            let (x, y) =
                (f64::from(k % (n + 1)) / f64::from(n), f64::from(k / (n + 1)) / f64::from(n));
            [x, y, 0.1 * libm::sin(20.0 * x) * libm::cos(17.0 * y)]
        })
        .collect::<Vec<_>>();
    mesh(
        &points,
        &(0..n * n)
            .flat_map(|k: u32| {
                let a = k / n * (n + 1) + k % n;
                [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]
            })
            .collect::<Vec<_>>(),
    )
}

#[test]
fn a_sheet_has_no_cracks() {
    let image = render(&waves(90), &View { size: [70, 70], ..View::front() });
    let picture = draw(&image);
    for row in picture.lines().take(65).skip(5) {
        assert!(!row[6..64].contains('.'), "{picture}");
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let sheet = waves(150);
    fn render_with(threads: usize, sheet: &Mesh) -> Image {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(sheet, &View { size: [90, 83], yaw: 30.0, ..View::front() }))
    }
    let one = render_with(1, &sheet);
    assert_eq!([render_with(2, &sheet), render_with(8, &sheet)], [one.clone(), one]);
}

#[test]
fn an_empty_scene_gives_the_background() {
    let empty = render(&mesh(&[], &[]), &view(4, 3));
    let line = render(&mesh(&[[0.; 3], [1.; 3], [2.; 3]], &[[0, 1, 2]]), &view(4, 3));
    let point = render(&mesh(&[[5.; 3]; 3], &[[0, 1, 2]]), &View { size: [4, 3], ..View::front() });
    assert!(empty.pixels().iter().all(|pixel| pixel.iter().all(|&channel| channel < 90)));
    assert_eq!([&line, &point], [&empty, &empty]);
    assert_eq!(render(&signpost(), &view(0, 7)).pixels().len(), 0);
}

#[test]
fn extreme_numbers_cause_no_panic() {
    let huge = f64::MAX;
    let triangles = [
        [[-huge, 0., 0.], [huge, 0., 0.], [0., huge, 0.]],
        [[0.; 3], [1e-320, 0., 0.], [0., 1e-320, 0.]],
    ];
    for points in triangles {
        let wild = mesh(&points, &[[0, 1, 2]]);
        let wild = wild.with_vertex("normal", Attribute::Vector(vec![[huge; 3]; 3].into()));
        for zoom in [1.0, 1e300, f64::NAN] {
            let view = View { zoom, yaw: f64::INFINITY, ..View::front() };
            render(wild.as_ref().unwrap(), &view);
        }
    }
    let uv = Attribute::Pair(vec![[-huge, huge]; 3].into());
    let textured = mesh(&triangles[0], &[[0, 1, 2]]).with_vertex("uv", uv).unwrap();
    let image = Image::new(1, 1, vec![GREEN]).unwrap();
    render(&textured.with_texture(Some(image)), &view(9, 9));
}

#[test]
fn each_face_shows_the_picture_or_the_color_of_its_material() {
    fn point_xy(x: f64, y: f64) -> [f64; 3] {
        [x, y, 0.]
    }
    let points = [
        point_xy(0., 0.),
        point_xy(4., 0.),
        point_xy(8., 0.),
        point_xy(8., 8.),
        point_xy(4., 8.),
        point_xy(0., 8.),
    ];
    let mesh = mesh(&points, &[[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]]);
    // The left half of the texture is green, and the texture repeats beyond its border.
    let uv = points.map(|[x, ..]| [x / 4. + 1., 0.5]);
    let image = Image::new(2, 1, vec![GREEN, RED]).unwrap();
    let mut skin = Material::from_picture(image);
    let map = Map { wrap: [Wrap::Repeat; 2], ..Map::new("", vec![]) };
    skin.maps.insert(MapKind::BaseColor, map);
    let blue = Material { base_color: [0.0, 0.0, 1.0, 1.0], ..Material::default() };
    let mesh = mesh.with_vertex("uv", Attribute::Pair(uv.to_vec().into())).unwrap();
    let numbers = Attribute::Index(vec![0, 0, 1, 1].into());
    let mesh = mesh.with_face(MATERIAL_ATTRIBUTE, numbers).unwrap().with_materials([skin, blue]);
    let picture = render(&mesh, &view(80, 80));
    let dominant_channel = |column: usize| {
        let [r, g, b] = picture.pixel([column, 40]);
        if r > g && r > b {
            'r'
        } else if g > b {
            'g'
        } else {
            'b'
        }
    };
    assert_eq!([10, 30, 50, 70].map(dominant_channel), ['g', 'r', 'b', 'b']);
    let shapes = Shapes::from_layers(&[Layer::Triangles(Box::new(mesh))], &[]).unwrap();
    let shape = &shapes.shapes[0];
    assert_eq!(shape.material_runs, [(2, Some(0)), (2, None)]);
    let corner = shape.triangles[2][1] as usize;
    assert_eq!(shape.colors.as_ref().unwrap()[corner], [0, 0, 255, 255]);
}

/// A line between two points.
fn line(ends: [[f64; 3]; 2], axes: Axes) -> Layer {
    let points = Vec::from(ends.map(Point3::from));
    Layer::Lines(Lines { points: points.into(), chains: vec![vec![0, 1]], axes })
}

#[test]
fn lines_are_drawn_in_front_of_and_behind_faces() {
    let mesh = squares(&[square([0., 0.], [8., 8.], 0., RED)]);
    let faces = Layer::Triangles(Box::new(mesh.clone()));
    let view = view(400, 400);
    let alone = render_layers(std::slice::from_ref(&faces), &view).unwrap();
    assert_eq!(alone, render(&mesh, &view));
    // Draw three lines: in front of the square, behind the square, and in front of the square but given in a sensor's coordinate axes.
    fn line_at(z: f64, axes: Axes) -> Layer {
        line([[0., 4., z], [8., 4., z]], axes)
    }
    let seen = |line| {
        let picture = render_layers(&[faces.clone(), line], &view).unwrap();
        picture.pixels().iter().zip(alone.pixels()).filter(|(a, b)| a != b).count()
    };
    assert!(seen(line_at(1., Axes::Upright)) > 300);
    assert_eq!(seen(line_at(-1., Axes::Upright)), 0);
    assert!(seen(line([[0., -4., -1.], [8., -4., -1.]], Axes::Sensor)) > 300);
}

#[test]
fn a_view_aims_at_a_point_or_fits_a_box() {
    fn middle(view: &View) -> char {
        let picture = render(&signpost(), view);
        draw(&picture).chars().nth(31 * 15 + 15).unwrap()
    }
    fn count_pixels(view: &View, color: char) -> usize {
        let picture = draw(&render(&signpost(), view));
        picture.chars().filter(|&c| c == color).count()
    }
    for projection in [Projection::Orthographic, Projection::Perspective] {
        let whole = View { projection, ..view(30, 30) };
        fn aimed_view(aim: Aim, whole: &View) -> View {
            View { aim: Some(aim), ..*whole }
        }
        let aimed = aimed_view(Aim::Point(Point3::new(6., 2., 0.)), &whole);
        assert_eq!(middle(&aimed), 'g');
        assert!(
            count_pixels(&aimed, 'g').abs_diff(count_pixels(&whole, 'g')) < 20,
            "no larger than before"
        );
        let green = Aim::at_points([[4., 0., 0.], [f64::NAN; 3], [8., 4., 0.]].map(Point3::from));
        let fits = aimed_view(green.unwrap(), &whole);
        assert!(count_pixels(&fits, 'g') > 700, "{}", draw(&render(&signpost(), &fits)));
        assert!(
            count_pixels(&View { zoom: 0.5, ..fits }, 'g').abs_diff(count_pixels(&fits, 'g') / 4)
                < 30
        );
        // Cases: boxes behind the scene and in front of it, and an empty scene.
        for z in [-1e3, 1e3, 1e300, f64::NAN] {
            let (low, high) = (Point3::new(0., 0., z), Point3::new(1., 1., z));
            render(&signpost(), &aimed_view(Aim::Box(low, high), &whole));
            render(&mesh(&[], &[]), &aimed_view(Aim::Point(low), &whole));
        }
    }
    assert_eq!(Aim::at_points([Point3::new(0., f64::INFINITY, 0.)]), None);
}

/// Builds a picture layer from rows of letters: `.` is the background, w is white, and any other letter stands for a color.
fn layer_from_rows(rows: &[&str]) -> Layer {
    let pixels: Vec<_> = rows
        .iter()
        .flat_map(|row| {
            row.bytes().map(|letter: u8| match letter {
                b'.' => BACKGROUND,
                b'w' => [255; 3],
                _ => GREEN,
            })
        })
        .collect();
    let image = Image::new(rows[0].len(), rows.len(), pixels).unwrap();
    Layer::Picture(Picture { image, registration: None, has_false_colors: true })
}

#[test]
fn a_region_is_outlined_on_its_capture_and_the_rest_is_dark() {
    let capture = Image::new(8, 6, vec![[200, 100, 60]; 48]).unwrap();
    let registration = Some(Registration { scale: [2.0; 2], offset: [2.0; 2], picture: [8, 6] });
    fn draw_on(layer: Layer, registration: Option<Registration>, capture: &Image) -> Image {
        let below = Some(Backdrop { image: capture, registration });
        picture(&[layer], &Look { backdrop: below, ..Look::front() }).unwrap()
    }
    fn letters(image: &Image) -> String {
        let rows = image.pixels().chunks(image.width());
        rows.map(|row| {
            row.iter()
                .map(|pixel| match pixel {
                    [200, 100, 60] => '#',
                    [255, 220, 40] => 'o',
                    [70, 35, 21] => '.',
                    [0, 255, 0] => 'g',
                    _ => '?',
                })
                .chain(['\n'])
                .collect::<String>()
        })
        .collect::<String>()
    }
    let region = ["....", ".ww.", ".ww."];
    let expected = ["........", "........", "..oooo..", "..o##o..", "..o##o..", "..o##o.."];
    assert_eq!(
        letters(&draw_on(layer_from_rows(&region), None, &capture)),
        expected.join("\n") + "\n"
    );
    let expected = ["........", "........", "........", "...oooo.", "...o##o.", "...o##o."];
    assert_eq!(
        letters(&draw_on(layer_from_rows(&region), registration, &capture)),
        expected.join("\n") + "\n"
    );
    // An area of a label is outlined in its own color, and tints the backdrop inside.
    let label = letters(&draw_on(layer_from_rows(&["....", "gggg", "gggg"]), None, &capture));
    assert_eq!(label.lines().nth(2), Some("gggggggg"), "{label}");
    assert_eq!(label.lines().nth(4), Some("????????"), "{label}");
}

#[test]
fn a_flat_picture_fits_into_a_size() {
    fn scale_to(rows: &[&str], size: [usize; 2]) -> Image {
        let look = Look {
            view: View { size, ..View::front() },
            representation: Representation::Fitted,
            backdrop: None,
        };
        picture(&[layer_from_rows(rows)], &look).unwrap()
    }
    let wide = scale_to(&["wg", "gw"], [8, 4]);
    assert_eq!(["..wwgg..", "..wwgg..", "..ggww..", "..ggww.."], letters_of(&wide)[..]);
    let small = scale_to(&["ww....", "ww...."], [3, 3]);
    assert_eq!(["...", "w..", "..."], letters_of(&small)[..]);
    assert_eq!(scale_to(&["w"], [0, 5]).pixels().len(), 0);
}

fn letters_of(image: &Image) -> Vec<String> {
    image
        .pixels()
        .chunks(image.width())
        .map(|row| {
            row.iter()
                .map(|&pixel| match pixel {
                    BACKGROUND => '.',
                    GREEN => 'g',
                    _ => 'w',
                })
                .collect()
        })
        .collect()
}

#[test]
fn every_value_type_has_a_picture_and_no_edge_case_causes_a_panic() {
    let below = Image::new(3, 2, vec![GREEN; 6]).unwrap();
    let odd = Registration { scale: [f64::NAN, 0.0], offset: [1e300, -1.0], picture: [3, 2] };
    for kind in TYPES {
        let mut seen = 0;
        for value in kind.edge_cases() {
            let layers = value.show();
            let view = View { size: [12, 9], ..View::front() };
            let look = Look { view, representation: Representation::Fitted, backdrop: None };
            seen += usize::from(picture(&layers, &look).is_some());
            let below = Some(Backdrop { image: &below, registration: Some(odd) });
            picture(&layers, &Look { backdrop: below, ..look });
            let aim = Some(Aim::Point(Point3::new(1e308, -1.0, 0.0)));
            picture(
                &layers,
                &Look {
                    view: View { aim, ..view },
                    representation: Representation::Space,
                    backdrop: None,
                },
            );
        }
        assert!(seen > 0, "{} is never seen", kind.name);
    }
}
