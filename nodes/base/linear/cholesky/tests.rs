use super::*;

/// Returns the Laplace matrix of a grid, with `spring` added to the diagonal.
fn grid(width: usize, height: usize, spring: f64) -> Symmetric {
    let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
    for k in 0..width * height {
        let (row, column) = (k / width, k % width);
        let mut around = Vec::new();
        if row > 0 {
            around.push(k - width);
        }
        if column > 0 {
            around.push(k - 1);
        }
        if column + 1 < width {
            around.push(k + 1);
        }
        if row + 1 < height {
            around.push(k + width);
        }
        matrix.indices.extend(around.iter().map(|&k| k as u32));
        matrix.entries.extend(around.iter().map(|_| -1.0));
        matrix.indices.push(k as u32);
        matrix.entries.push(around.len() as f64 + spring);
        matrix.starts.push(matrix.indices.len() as u32);
    }
    matrix
}

#[test]
fn a_solution_solves() {
    for [width, height] in [[1, 1], [3, 2], [40, 31], [1, 300], [200, 7]] {
        let matrix = grid(width, height, 0.01);
        let expected: Vec<[f64; 3]> = (0..width * height)
            .map(|k| [k as f64, libm::sin(k as f64), 1.0 / (1.0 + k as f64)])
            .collect();
        let mut x: Vec<[f64; 3]> = (0..expected.len())
            .map(|row| {
                matrix.row(row).fold([0.0; 3], |sum, (k, entry)| {
                    [0, 1, 2].map(|axis| sum[axis] + entry * expected[k][axis])
                })
            })
            .collect();
        Cholesky::new(&matrix).unwrap().solve(&mut x);
        for (x, expected) in x.iter().zip(&expected) {
            for axis in 0..3 {
                let scale = (width * height) as f64;
                assert!((x[axis] - expected[axis]).abs() <= 1e-11 * scale, "{width} {height}");
            }
        }
    }
}

#[test]
fn the_order_contains_every_unknown_of_disconnected_matrices() {
    let mut matrix = grid(30, 20, 1.0);
    // The matrix has two grids that are not linked to each other, and an isolated unknown.
    let other = grid(25, 25, 1.0);
    let (rows, entries) = (600u32, matrix.indices.len() as u32);
    matrix.starts.extend(other.starts[1..].iter().map(|start| start + entries));
    matrix.indices.extend(other.indices.iter().map(|index| index + rows));
    matrix.entries.extend(other.entries);
    matrix.indices.push(600 + 625);
    matrix.entries.push(2.0);
    matrix.starts.push(matrix.indices.len() as u32);
    let links = Links { starts: &matrix.starts, neighbors: &matrix.indices };
    let mut order = Dissection::new(links, 1).order;
    order.sort_unstable();
    assert!(order.into_iter().eq(0..1226));
    assert!(Cholesky::new(&matrix).is_some());
}

#[test]
fn dissection_gives_much_less_fill_than_the_given_order() {
    let factors = Cholesky::new(&grid(100, 100, 1.0)).unwrap();
    // With the rows in the given order, the factor would be a full band: 100 entries in each of 10 000 columns.
    let entries: usize = factors.factors.iter().map(|factor| factor.columns.entries.len()).sum();
    assert!(entries < 500_000, "{entries}");
}

#[test]
fn unknowns_around_one_hub_give_little_fill() {
    let count = 1000;
    let mut matrix = Symmetric { starts: vec![0], indices: vec![], entries: vec![] };
    for k in 0..count {
        matrix.indices.extend([k, count]);
        matrix.entries.extend([2.0, -1.0]);
        matrix.starts.push(matrix.indices.len() as u32);
    }
    matrix.indices.extend(0..=count);
    matrix.entries.extend((0..count).map(|_| -1.0));
    matrix.entries.push(f64::from(count));
    matrix.starts.push(matrix.indices.len() as u32);
    let factors = Cholesky::new(&matrix).unwrap();
    let entries: usize = factors.factors.iter().map(|factor| factor.columns.entries.len()).sum();
    // Each column of the factor has two entries, except in one small group. If the hub were eliminated first, the factor would have
    // half a million entries.
    assert!(entries < 3000, "{entries}");
    // The solution is 1 for all unknowns: the row of a leaf gives 2 - 1 = 1, and the row of the hub gives 1000 - 1000 = 0.
    let mut x = vec![[1.0; 3]; count as usize];
    x.push([0.0; 3]);
    factors.solve(&mut x);
    assert!(x.iter().flatten().all(|x| (x - 1.0).abs() < 1e-12));
}

#[test]
fn equations_that_no_level_divides_are_solved() {
    let count = 150;
    let matrix = Symmetric {
        starts: (0..=count).map(|k| k * count).collect(),
        indices: (0..count * count).map(|k| k % count).collect(),
        entries: (0..count)
            .flat_map(|k| (0..count).map(move |other| if other == k { 150.0 } else { -0.5 }))
            .collect(),
    };
    let mut x = vec![[150.0 - 0.5 * 149.0; 3]; count as usize];
    Cholesky::new(&matrix).unwrap().solve(&mut x);
    assert!(x.iter().flatten().all(|x| (x - 1.0).abs() < 1e-12));
}

#[test]
fn factors_do_not_depend_on_the_number_of_threads() {
    let matrix = grid(60, 50, 0.01);
    fn solve_with_threads(threads: usize, matrix: &Symmetric) -> Vec<[f64; 3]> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut x = vec![[1.0, 2.0, 3.0]; 3000];
        pool.install(|| Cholesky::new(matrix).unwrap().solve(&mut x));
        x
    }
    assert_eq!(solve_with_threads(1, &matrix), solve_with_threads(3, &matrix));
}

#[test]
fn tasks_solve_like_one_group_after_the_other() {
    for [width, height] in [[100, 90], [1500, 6]] {
        let matrix = grid(width, height, 0.01);
        let mut factors = Cholesky::new(&matrix).unwrap();
        assert!(factors.schedule.tasks.len() > 2);
        let mut x: Vec<_> = (0..width * height).map(|k| [k as f64, 1.0]).collect();
        let mut expected = x.clone();
        factors.solve(&mut x);
        let groups = 0..factors.factors.len() as u32;
        factors.schedule.steps = groups.map(Step::Group).collect();
        factors.schedule.tasks.clear();
        factors.solve(&mut expected);
        assert_eq!(x, expected);
    }
}

#[test]
fn a_matrix_that_is_not_positive_definite_has_no_factors() {
    assert!(Cholesky::new(&grid(20, 20, 0.0)).is_none());
    assert!(Cholesky::new(&grid(20, 20, -1.0)).is_none());
    assert!(Cholesky::new(&grid(4, 4, f64::NAN)).is_none());
}
