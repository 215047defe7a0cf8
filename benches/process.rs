//! How long does a whole run take, from the start of the process to the last file?
//!
//! There is no bar.

use std::process::Command;

fn main() {
    divan::main();
}

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

/// `maquette run graphs/doll.ron` with two threads, nothing cached.
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
