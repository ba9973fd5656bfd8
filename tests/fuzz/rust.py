"""Fuzz the kernels with libFuzzer: ``python -m tests.fuzz.rust SECONDS [TARGET ...]``.

Each target runs for `SECONDS`, with coverage of the code as its guide. A target checks its laws on
every input; an input that violates one is written to the working folder and ends the run. Needs
cargo and a C++ compiler; the stable compiler of Rust suffices. The first inputs are in ``corpus``
beside each target, with those that failed in earlier versions.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
TARGETS = {
    "scan": ROOT / "rust/text/fuzz",
    "format": ROOT / "rust/text/fuzz",
    "tree": ROOT / "rust/linkage/fuzz",
}
# Bytes of an input: longer ones take more time and reach no other code.
MAX_BYTES = {"scan": 4096, "format": 4096, "tree": 512}
_COVERAGE = (
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
    "-Ccodegen-units=1",
    "-Cdebug-assertions",
    "--cfg=fuzzing",
)


def build(target):
    """Compile a target and return the path of its program."""
    crate = TARGETS[target]
    host = subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout
    triple = next(line.split()[1] for line in host.splitlines() if line.startswith("host:"))
    # With the option --target, build scripts are compiled without coverage.
    command = ["cargo", "build", "--release", "--bin", target, "--target", triple]
    environment = os.environ | {"RUSTFLAGS": " ".join(_COVERAGE)}
    subprocess.run(command, cwd=crate, env=environment, check=True)
    folder = Path(os.environ.get("CARGO_TARGET_DIR", crate / "target"))
    return folder / triple / "release" / target


def main(seconds, *targets):
    """Run the targets one after the other; return the number of those that failed."""
    n_failed = 0
    for target in targets or TARGETS:
        program, corpus = build(target), TARGETS[target] / "corpus" / target
        with tempfile.TemporaryDirectory() as found:
            words = [f"-max_total_time={seconds}", f"-max_len={MAX_BYTES[target]}"]
            words += ["-print_final_stats=1"]
            run = subprocess.run([program, *words, found, corpus], check=False)
        print(f"{target}: {'failed' if run.returncode else 'no finding'} in {seconds} s")
        n_failed += run.returncode != 0
    return n_failed


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
