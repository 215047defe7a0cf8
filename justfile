# Recipes for development. `ci` is exactly what CI runs; `nightly` runs all other checks.

test *args:
    cargo test {{args}}

# The tests of graphs, with a page that shows the differences.
graphs *args:
    cargo run --release -- test graphs --report target/graph-tests.html {{args}}

# Checks that the tests of graphs notice inserted faults: 60 faults, one build each, about half an hour.
mutations:
    python3 tests/mutations/run.py

# Checks that the law of memory notices inserted faults: 21 faults, one build each, about half an hour.
law-mutations sequences="20000":
    SEQUENCES={{sequences}} python3 tests/mutations/law.py

lint:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets --features maquette-program/s3,maquette-tests/oracles -- -D warnings

# The page of real captures, `docs/captures/README.md`, with its pictures. Needs ../shared/data.
captures:
    bash docs/captures/make

# The doll of the README, seen from the front.
doll:
    cargo run --release -- run graphs/doll.ron

bench *args:
    cargo bench --workspace {{args}}

# Benchmarks of maquette and other programs, alternating, with ratios; `just peers NURBS` for some rows. Needs ../shared/peers.
peers *args:
    python3 benches/peers/peers.py {{args}}

# Benchmarks with a bar: our figure, the peer's, the bar, the verdict. Most of an hour on an idle machine; `just bars FFD` for some.
bars *args:
    python3 benches/bars/bars.py {{args}}

# Compares our subdivision with OpenSubdiv and CGAL (from Debian), point by point. Needs ../shared/data.
oracles:
    bash tests/oracles/subdivision/run

# Four figures of plain English and ordinary Rust, by crate; then makes `docs/messages.txt`, the list of all messages, anew.
words:
    python3 tests/words/figures.py
    python3 tests/words/messages.py --write

# Opens every format that maquette writes with other programs (PyPI, Debian, npm; 2 GB): a table; `just readers Blender` for some.
readers *programs="all":
    bash tests/readers/run {{programs}}

# Checks that trimesh and Blender read the doll's files with the same axes, position and texture. Installs both from PyPI, about 400 MB.
files:
    bash tests/oracles/files/run

# Checks solids for printing by trimesh and PrusaSlicer (Debian: prusa-slicer), which slices those of examples and of ../shared/data.
solids:
    bash tests/oracles/solids/run

# Checks that older processors give the same bytes: all tests of graphs on two emulated processors (Debian: qemu-user), ten minutes.
processors *args:
    bash tests/oracles/processors/run {{args}}

# The law of memory, in one process: after random edits, results equal those of an evaluation without a cache.
law sequences="1000000":
    LAW_SEQUENCES={{sequences}} cargo test --release -p maquette-engine --lib law

# Checks golden comparisons: moves entries of each kind of value to just within and just beyond each tolerance.
verdicts places="100000":
    PLACES={{places}} cargo test --release -p maquette-golden --lib mutations

# The law of memory, by the program itself: random sequences of edits and commands.
sequences count="2000":
    SEQUENCES={{count}} cargo test --release -p maquette-program --test commands sequences

# Checks the types of the scripts of the live page and of the contact sheet. Installs the type checker from npm in target/.
page:
    bash tests/sheet/install
    target/sheet/node_modules/.bin/tsc --project src/preview/web
    target/sheet/node_modules/.bin/tsc --project src/cli/tasks/sheet

# Tests the contact sheet of a batch in a real Chromium. Its driver comes from npm.
sheet *args:
    bash tests/sheet/run {{args}}

# Builds the Python wheel and runs all of its tests.
python *args:
    bash hosts/python/test {{args}}

# Builds the Blender extension and tests it in two real Blenders, which come from PyPI, about 750 MB.
blender *args:
    bash hosts/blender/test {{args}}

# Tests the extension in a real VS Code, and the language server in two Neovims. They come from npm, Debian and PyPI.
editors:
    bash hosts/neovim/test
    bash hosts/vscode/test

# Runs batches with OpenJD, Slurm, HyperQueue, GNU parallel and make, and shares results by nginx and moto. They come from PyPI and Debian.
farm *args:
    bash tests/farm/run {{args}}

# Fuzzes every reader of files, for some seconds each.
fuzz seconds="5":
    bash .ci/fuzz {{seconds}}

# The checks that every change must pass.
ci:
    bash .ci/run

# All other checks, about 60 minutes: hosts, farms, oracles, fuzzing, and laws with new random cases; `just nightly blender` for some.
nightly *steps:
    bash .ci/nightly {{steps}}
