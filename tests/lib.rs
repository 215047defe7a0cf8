//! Tests, benches and examples that use several crates of maquette. `engine/` tests the engine as packs and hosts see it. The tests of the
//! program belong to the package `maquette-program`.
