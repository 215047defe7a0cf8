use super::*;

/// Returns the front half of a sphere of radius 50 mm as points of one color that changes slowly, reconstructed as a closed surface.
fn half_colored(color: impl Fn(&Point3<f64>) -> Rgb) -> Mesh {
    let points: Vec<_> = sphere(8000, 0.0).into_iter().filter(|point| point.z > 0.0).collect();
    let colors: Vec<Rgb> = points.iter().map(color).collect();
    let cloud = Points::new(points).unwrap();
    let cloud = cloud.with_attribute("color", Attribute::Color(colors.into())).unwrap();
    let sources = [Scattered::Points(cloud)];
    reconstruct(&sources, Poses::Auto, &Options::default(), &Progress::silent()).unwrap()
}

#[test]
fn colors_of_filled_vertices_are_between_those_of_the_points() {
    let mesh = half_colored(|point| if point.x > 0.0 { [200, 30, 60] } else { [40, 30, 180] });
    let colors = mesh.vertex().colors("color").unwrap();
    for color in colors.iter() {
        assert!((40..=200).contains(&color[0]), "{color:?}");
        assert_eq!(color[1], 30);
        assert!((60..=180).contains(&color[2]), "{color:?}");
    }
    // Away from the rim, both sides are mixed.
    let behind = mesh.positions().iter().zip(colors.iter());
    let mixed =
        behind.filter(|(at, _)| at.z < -3.0).filter(|(_, color)| (50..190).contains(&color[0]));
    assert!(mixed.count() > 20);
}

#[test]
fn neighbors_that_nobody_saw_differ_little() {
    let mesh = half_colored(|point| [0, 1, 2].map(|k| (128.0 + 0.5 * point[k]).round() as u8));
    let colors = mesh.vertex().colors("color").unwrap();
    let Some(Attribute::Flag(filled)) = mesh.vertex().get("filled") else {
        panic!("nothing is flagged")
    };
    let mut most = 0;
    for face in mesh.faces().iter() {
        for k in 0..3 {
            let [a, b] = [face[k], face[(k + 1) % 3]].map(|vertex| vertex as usize);
            if filled[a] == 1 && filled[b] == 1 {
                let steps = (0..3).map(|k| colors[a][k].abs_diff(colors[b][k]));
                most = steps.fold(most, u8::max);
            }
        }
    }
    assert!(most <= 4, "{most}");
}
