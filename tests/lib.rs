//! Tests, benches and examples of maquette as a whole: what no crate can be asked alone. `engine/` is the engine as packs and hosts see it;
//! the tests of the program are those of `maquette-program`.
