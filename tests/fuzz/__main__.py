"""Read damaged files for a given time: ``python -m tests.fuzz FORMAT SECONDS [SEED]``.

The formats are bvh, fbx, gltf, npz, robots and usd, and vmc, whose packets are not files. Child
processes check seeds one after the other; a violated law, or a signal that ends a process, ends the
run and prints the seed. Add a test of such a seed. ``python -m tests.fuzz.rust`` fuzzes the
kernels.
"""

import importlib
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SEEDS_PER_PROCESS = 400


def run_range(module, first, stop):
    """Check seeds in this process, and print each before it is checked."""
    n_motions = 0
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, stop):
            print(seed, n_motions, flush=True)
            signal.setitimer(signal.ITIMER_PROF, 20.0)  # ends the process
            n_motions += module.check(seed, Path(folder))
    print(stop, n_motions, flush=True)


def main(name, seconds, first=0):
    module = importlib.import_module(f"tests.fuzz.{name}")
    end, seed, n_motions, excused = time.monotonic() + float(seconds), int(first), 0, []
    while time.monotonic() < end:
        words = ["--range", name, str(seed), str(seed + SEEDS_PER_PROCESS)]
        command = [sys.executable, "-m", "tests.fuzz", *words]
        run = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        seed, count = map(int, run.stdout.splitlines()[-1].split())
        n_motions += count
        if run.returncode:
            if not getattr(module, "is_excused", lambda *_: False)(seed, run.returncode):
                print(run.stderr, file=sys.stderr)
                sys.exit(f"seed {seed} failed with exit code {run.returncode}")
            excused.append(seed)
            seed += 1
    print(f"{seed - int(first)} files from seed {first}: {n_motions} motions read")
    if excused:
        print(f"the foreign library exceeded the limits at {len(excused)}: {excused[:20]}")


if __name__ == "__main__":
    if sys.argv[1] == "--range":
        run_range(importlib.import_module(f"tests.fuzz.{sys.argv[2]}"), *map(int, sys.argv[3:]))
    else:
        main(*sys.argv[1:])
