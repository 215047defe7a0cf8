//! The program `maquette` with the built-in packs and this one.

fn main() -> std::process::ExitCode {
    maquette::cli::main(&[maquette_nodes::PACKS, &[&maquette_third_party::PACK]].concat())
}
