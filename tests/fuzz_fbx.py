"""Read damaged FBX files for a given time: ``python -m tests.fuzz_fbx SECONDS [SEED] [FILE...]``.

Each input is a small generated file, or one of FILE, with one to six random changes. Reading must
raise `FormatError`, or give clips that are finite motions or raise `FormatError` when they are
accessed. It must take less than 10 seconds and 1 GiB, and must not end the process. For other
results the seed is printed; add seeds of generated files to `SEEDS`, which the tests run.
"""

import random
import resource
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np

import mograft as mg
from tests.io import fbx_scenes as fbx

# Seeds of files that failed in earlier versions.
SEEDS = ()

MAX_SECONDS, MAX_KIBIBYTES = 10.0, 1 << 20
FILES_PER_PROCESS = 400
NUMBERS = [
    bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f" + bytes(4), b"\xff" * 7 + b"\x7f", b"\1" + bytes(7),
    b"\0\0\0\0\0\0\xf0\x7f", b"\0\0\0\0\0\0\xf8\x7f", b"\xff" * 6 + b"\xef\x7f", b"\0\0\0\x80" * 2,
]  # fmt: skip
"""Extreme integers and floats, little-endian."""

TOKENS = [
    *b"0 -1 1 3 1e308 -1e309 nan inf 9223372036854775807 99999999999999999999 *2147483647".split(),
    *b'{ } "" "Model::hips" , : OO OP 1001 1002 L C U a: Properties70: Objects:'.split(),
    b"\0", b"\n", b";", b'"', b"\xff", b"",
]  # fmt: skip


@cache
def sources(files):
    """Return the contents that are damaged: generated files, and `files`."""
    rng = np.random.default_rng(0)
    nodes = (
        fbx.Node("hips", T=(0, 90, 0), pre=(10, 0, 20)),
        fbx.Node("spine", 0, T=(0, 20, 0), order=3, inherit=fbx.INHERIT_RRSS),
        fbx.Node("leg", 0, T=(10, 0, 0), post=(0, 45, 0), rotation_pivot=(1, 2, 3)),
        fbx.Node("foot", 2, T=(0, -40, 0), inherit=fbx.INHERIT_RRS),
    )
    tracks = {(n, key): rng.uniform(0.5, 30, (12, 3)) for n in range(4) for key in "TRS"}
    takes = (
        fbx.Take("walk", 12, (fbx.Layer(tracks),)),
        fbx.Take("run", 12, (fbx.Layer({(0, "T"): tracks[0, "T"]}),)),
    )
    scene = fbx.Scene(nodes, takes, bind={0: np.eye(4), 1: np.eye(4)})
    generated = [write(scene) for write in fbx.CONTAINERS.values()]
    return generated + [Path(file).read_bytes() for file in files]


def mutate(seed, files=()):
    """Return a damaged file."""
    rng = random.Random(seed)
    contents = sources(files)
    # Generated files change with their seed only, not with the number of further files.
    data = contents[rng.randrange(5)] if not files else rng.choice(contents)
    is_text = data.startswith(b";")
    for _ in range(rng.randint(1, 6)):
        data = _change_text(rng, data) if is_text and rng.random() < 0.7 else _change(rng, data)
    return data


def _change(rng, data):
    """Change bytes anywhere."""
    start = rng.randint(0, len(data))
    length = rng.choice([1, 1, 4, 8, 60, 900])
    kind = rng.randrange(7)
    if kind == 0:
        return data[:start] + rng.randbytes(length) + data[start + length :]
    if kind in (1, 2):
        number = rng.choice(NUMBERS)[: rng.choice([1, 4, 8])]
        return data[:start] + number + data[start + len(number) :]
    if kind == 3:
        return data[:start] + data[start + length :]
    if kind == 4:
        other = rng.randint(0, len(data))
        return data[:start] + data[other : other + length] + data[start:]
    if kind == 5:
        other = rng.randint(0, len(data))
        return data[:start] + data[other : other + length] + data[start + length :]
    return data[:start] if rng.random() < 0.3 else data[:start] + data[start : start + 1] * 2


def _change_text(rng, data):
    """Change words or lines."""
    kind = rng.randrange(3)
    if kind == 0:
        words = data.split(b" ")
        words[rng.randrange(len(words))] = rng.choice(TOKENS)
        return b" ".join(words)
    if kind == 1:
        numbers = data.split(b",")
        numbers[rng.randrange(len(numbers))] = rng.choice(TOKENS)
        return b",".join(numbers)
    lines = data.split(b"\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one : one + rng.randint(0, 3)] = lines[other : other + rng.randint(0, 30)]
    return b"\n".join(lines)


def outcome(function, argument):
    """Return the result of a function, or the `FormatError` that it raises."""
    try:
        return function(argument)
    except mg.FormatError as error:
        return error


def check(seed, folder, files=()):
    """Read a damaged file; return the number of motions that were read."""
    path = folder / "damaged.fbx"
    path.write_bytes(mutate(seed, files))
    start = time.monotonic()
    clips = outcome(mg.read, path)
    n_clips = 0 if isinstance(clips, mg.FormatError) else len(clips)
    n_motions = 0
    for index in range(min(n_clips, 20)):
        motion = outcome(clips.__getitem__, index)
        if isinstance(motion, mg.FormatError):
            assert "take" in motion.place, motion
            continue
        assert np.isfinite(motion.world_positions()).all()
        assert motion.n_frames == clips.lengths[index].n_frames
        n_motions += 1
    assert time.monotonic() - start < MAX_SECONDS, "too slow"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert peak < MAX_KIBIBYTES, f"{peak} KiB of memory"
    return n_motions


def run_range(first, stop, files):
    """Check seeds in this process, and print each before it is checked."""
    n_motions = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, stop):
            print(seed, n_motions, flush=True)
            n_motions += check(seed, Path(folder), files)
    print(stop, n_motions, flush=True)


def main(seconds, first, files):
    end, seed, n_motions = time.monotonic() + seconds, first, 0
    while time.monotonic() < end:
        words = ["--range", str(seed), str(seed + FILES_PER_PROCESS), *files]
        completed = subprocess.run(
            [sys.executable, "-m", "tests.fuzz_fbx", *words],
            capture_output=True,
            text=True,
            check=False,
        )
        last, count = completed.stdout.splitlines()[-1].split()
        if completed.returncode:
            print(completed.stderr, file=sys.stderr)
            sys.exit(f"seed {last} failed with exit code {completed.returncode}")
        seed, n_motions = int(last), n_motions + int(count)
    print(f"{seed - first} files from seed {first}: {n_motions} motions read")


if __name__ == "__main__":
    if sys.argv[1] == "--range":
        run_range(int(sys.argv[2]), int(sys.argv[3]), tuple(sys.argv[4:]))
    else:
        seed_argument = int(sys.argv[2]) if len(sys.argv) > 2 else 0
        main(float(sys.argv[1]), seed_argument, tuple(sys.argv[3:]))
