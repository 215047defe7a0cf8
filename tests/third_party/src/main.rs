//! The program `maquette` with the built-in packs and the pack of this crate.

fn main() -> std::process::ExitCode {
    maquette_cli::main(&[maquette_nodes::PACKS, &[&maquette_third_party::PACK]].concat())
}
