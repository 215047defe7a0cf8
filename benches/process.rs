//! Measures the time of a whole run of the program, from the start of the process until the last output file is written.
//!
//! There is no performance target.

use std::process::Command;

fn main() {
    divan::main();
}

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

/// Runs `maquette run doll.ron` with two threads and the default cache folder.
#[divan::bench(sample_count = 21, sample_size = 1)]
fn run_doll(bencher: divan::Bencher<'_, '_>) {
    let out = tempfile::tempdir().expect("a temporary folder");
    bencher.bench(|| {
        let status = Command::new(env!("CARGO_BIN_EXE_maquette"))
            .args(["run", "doll.ron", "--threads", "2", "--json", "--out"])
            .arg(out.path())
            .current_dir(GRAPHS)
            .output()
            .expect("the program runs")
            .status;
        assert!(status.success());
    });
}
