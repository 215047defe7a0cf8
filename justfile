# The recipes of a working day; `ci` is exactly what CI runs.

test *args:
    cargo test --workspace {{args}}

lint:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets -- -D warnings

# The doll of the README, seen from the front.
doll:
    cargo run --release -- run graphs/doll.ron

bench *args:
    cargo bench --workspace {{args}}

ci:
    bash .ci/run
