//! The program `maquette` with the built-in packs: copy this file to make one with yours.

fn main() -> std::process::ExitCode {
    maquette_cli::main(maquette_nodes::PACKS)
}
