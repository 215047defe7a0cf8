# The recipes of a working day; `ci` is exactly what CI runs, `nightly` all the rest.

test *args:
    cargo test {{args}}

# The tests of graphs, and a page that shows what differs.
graphs *args:
    cargo run --release -- test graphs --report target/graph-tests.html {{args}}

# Do the tests of graphs notice faults? 60 are tried, one build each: about half an hour.
mutations:
    python3 tests/mutations/run.py

# Does the law of memory notice faults? 21 are tried, one build each: some half an hour.
law-mutations sequences="20000":
    SEQUENCES={{sequences}} python3 tests/mutations/law.py

lint:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets --features maquette-program/s3,maquette-tests/oracles -- -D warnings

# The doll of the README, seen from the front.
doll:
    cargo run --release -- run graphs/doll.ron

bench *args:
    cargo bench --workspace {{args}}

# Ours beside other programs, in turn, and the ratios; `just peers NURBS` for some rows. Needs ../shared/peers.
peers *args:
    python3 benches/peers/peers.py {{args}}

# Each figure that has a bar, for a quiet machine: ours, the peer's, the bar and the verdict; `just bars FFD` for some. Most of an hour.
bars *args:
    python3 benches/bars/bars.py {{args}}

# Our subdivision beside OpenSubdiv and CGAL (from Debian), point by point. Needs ../shared/data.
oracles:
    bash tests/oracles/subdivision/run

# Every format that we write, opened by the programs that people have: a table. They come from PyPI, Debian and npm, some 2 GB; `just readers
# Blender` for some.
readers *programs="all":
    bash tests/readers/run {{programs}}

# Do trimesh and Blender see the doll's files upright, facing, textured and in one place? Installs both from PyPI, some 400 MB.
files:
    bash tests/oracles/files/run

# Are printed solids solids for trimesh and PrusaSlicer (Debian: prusa-slicer)? Slices those of examples, and of ../shared/data.
solids:
    bash tests/oracles/solids/run

# Do processors with fewer instructions give the same bytes? All tests of graphs on two that are emulated (Debian: qemu-user), ten minutes.
processors *args:
    bash tests/oracles/processors/run {{args}}

# Random sequences of edits and commands against an evaluation without memory: in one process, and by the program itself.
law sequences="1000000":
    LAW_SEQUENCES={{sequences}} cargo test --release -p maquette-engine --lib law

# Moves each of so many entries of each kind of value by a little less and a little more than each bound of its golden.
verdicts places="100000":
    PLACES={{places}} cargo test --release -p maquette-golden --lib mutations

sequences count="2000":
    SEQUENCES={{count}} cargo test --release -p maquette-program --test commands sequences

# Are the types of the live page's scripts and of the contact sheet's right? Installs the checker from npm beside the build.
page:
    bash tests/sheet/install
    target/sheet/node_modules/.bin/tsc --project src/preview/web
    target/sheet/node_modules/.bin/tsc --project src/cli/tasks/sheet

# The contact sheet of a batch in a real Chromium. What drives it comes from npm.
sheet *args:
    bash tests/sheet/run {{args}}

# The Python module: its wheel, and all of its tests.
python *args:
    bash hosts/python/test {{args}}

# The Blender extension, built and tested in two real Blenders. They come from PyPI, some 750 MB.
blender *args:
    bash hosts/blender/test {{args}}

# The VS Code extension in a real VS Code, and the language server asked by two Neovims. They come from npm, Debian and PyPI.
editors:
    bash hosts/neovim/test
    bash hosts/vscode/test

# Batches handed to real engines: OpenJD, Slurm, HyperQueue, GNU parallel and make; results shared by nginx and moto. They come from PyPI and Debian.
farm *args:
    bash tests/farm/run {{args}}

# Every reader of files, for some seconds each.
fuzz seconds="5":
    bash .ci/fuzz {{seconds}}

# What every change must pass.
ci:
    bash .ci/run

# Everything else, too, some 60 minutes: hosts, farms, oracles, fuzzing, and laws with new random cases; `just nightly blender` for some.
nightly *steps:
    bash .ci/nightly {{steps}}
