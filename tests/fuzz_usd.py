"""Read damaged USD files for a given time: ``python -m tests.fuzz_usd SECONDS [SEED]``.

Each input is a small valid text or binary file with one to six random changes. Reading must raise
`FormatError`, or give clips that are finite motions or raise `FormatError` when they are accessed.
Text files must take less than 10 seconds and 1 GiB, and must not end the process. For other results
the seed is printed; add such seeds to `SEEDS`, which the tests run. usd-core has no such limits for
binary files: those at which it exceeds the limits or ends the process are counted.
"""

import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

import mograft as mg

# Seeds of files that failed in earlier versions.
SEEDS = (15, 593, 761, 1000415, 2002924)

MAX_SECONDS, MAX_KIBIBYTES = 10.0, 1 << 20
FILES_PER_PROCESS = 400
JOINTS = ("hips", "hips/spine", "hips/leg")
TOKENS = [
    *(
        b"0",
        b"-1",
        b"nan",
        b"inf",
        b"-inf",
        b"1e300",
        b"1e-300",
        b"1e12",
        b"4294967296",
        b"99999999",
    ),
    *(
        b"None",
        b"[]",
        b"()",
        b"(0, 0, 0)",
        b"(0, 0, 0, 0)",
        b'""',
        b'"a/b"',
        b'"hips"',
        b'["hips"]',
    ),
    *(
        b"@../x.usda@",
        b"@./damaged.usda@",
        b"@damaged.usda@</figure>",
        b"</figure>",
        b"</figure/walk>",
    ),
    *(b"Skeleton", b"SkelAnimation", b"SkelRoot", b"Xform", b"def", b"over", b"class", b"{", b"}"),
    *(
        b"uniform",
        b"timeSamples",
        b"float",
        b"quatf[]",
        b"half3[]",
        b"matrix4d[]",
        b"token[]",
        b"=",
    ),
]
WORDS = [
    bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f" + bytes(4), b"\xff" * 7 + b"\x7f", b"\1" + bytes(7),
    b"\0\0\0\0\0\0\xf0\x7f", b"\0\0\0\0\0\0\xf8\x7f", b"\0\0\0\x80" * 2, b"\0\0\1" + bytes(5),
]  # fmt: skip


def make_stage(seed):
    """Return a stage with a skeleton and an animation of three joints."""
    rng = np.random.default_rng(seed)
    stage = Usd.Stage.CreateInMemory()
    root = UsdSkel.Root.Define(stage, "/figure")
    if seed % 2:
        turn = root.AddRotateXYZOp()
        for code in (0.0, 2.0):
            turn.Set(Gf.Vec3f(10 * code, 20, 0), code)
    skeleton = UsdSkel.Skeleton.Define(stage, "/figure/skel")
    skeleton.CreateJointsAttr(JOINTS)
    rest = [Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*rng.normal(size=3).tolist())) for _ in JOINTS]
    create = skeleton.CreateRestTransformsAttr if seed % 3 else skeleton.CreateBindTransformsAttr
    create(Vt.Matrix4dArray(rest))
    animation = UsdSkel.Animation.Define(stage, "/figure/walk")
    animation.CreateJointsAttr(JOINTS)
    for code in (0.0, 1.0, 2.0 + seed % 4):
        places, quats = rng.normal(size=(3, 3)), rng.normal(size=(3, 4))
        quats /= np.linalg.norm(quats, axis=1, keepdims=True)
        animation.CreateTranslationsAttr().Set(Vt.Vec3fArray.FromNumpy(np.float32(places)), code)
        animation.CreateRotationsAttr().Set(Vt.QuatfArray.FromNumpy(np.float32(quats)), code)
        animation.CreateScalesAttr().Set(Vt.Vec3hArray.FromNumpy(np.ones((3, 3), "f2")), code)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    UsdGeom.SetStageUpAxis(stage, "Y")
    return stage


@cache
def valid_files():
    """Return the suffix and the bytes of some valid files."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(6):
            for suffix in ("usda", "usdc"):
                path = Path(folder) / f"valid{seed}.{suffix}"
                stage = make_stage(seed)
                assert stage.GetRootLayer().Export(str(path))
                found.append((suffix, path.read_bytes()))
    return found


def mutate(seed):
    """Return the suffix and the bytes of a damaged file."""
    rng = random.Random(seed)
    suffix, data = rng.choice(valid_files())
    for _ in range(rng.randint(1, 6)):
        data = change_text(data, rng) if suffix == "usda" else change_bytes(data, rng)
    return suffix, data


def change_text(data, rng):
    """Change words, numbers or lines."""
    separator = rng.choice((b" ", b" ", b",", b"\n"))
    parts = data.split(separator)
    one, other = rng.randrange(len(parts)), rng.randrange(len(parts))
    if separator == b"\n":
        parts[one : one + rng.randint(0, 3)] = parts[other : other + rng.randint(0, 20)]
    else:
        parts[one] = rng.choice(TOKENS)
    return separator.join(parts)


def change_bytes(data, rng):
    """Change bytes, overwrite words, or cut the end."""
    data = bytearray(data)
    kind = rng.randrange(8)
    start = rng.randrange(len(data))
    if kind < 3:
        data[start] = rng.randrange(256)
    elif kind < 6:
        start -= start % 8
        data[start : start + 8] = rng.choice(WORDS)
    elif kind < 7:
        data[start : start + rng.randint(1, 64)] = data[: rng.randint(1, 64)]
    else:
        del data[start:]
    return bytes(data) or b"P"


def outcome(function, argument):
    """Return the result of a function, or the `FormatError` that it raises."""
    try:
        return function(argument)
    except mg.FormatError as error:
        return error


def check(seed, folder):
    """Read a damaged file; return the number of motions that were read."""
    suffix, data = mutate(seed)
    path = Path(folder) / f"damaged{seed}.{suffix}"  # usd-core keeps layers by name
    path.write_bytes(data)
    start = time.process_time()
    clips = outcome(mg.read, path)
    n_motions = 0
    for index in range(0 if isinstance(clips, mg.FormatError) else min(len(clips), 20)):
        motion = outcome(clips.__getitem__, index)
        if not isinstance(motion, mg.FormatError):
            assert np.isfinite(motion.world_positions()).all()
            n_motions += 1
        else:
            assert str(motion).startswith(f"{path}: "), motion
    if isinstance(clips, mg.FormatError):
        assert str(clips).startswith(f"{path}: "), clips
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    is_excessive = seconds >= MAX_SECONDS or peak >= MAX_KIBIBYTES
    if is_excessive and suffix == "usdc":
        signal.raise_signal(signal.SIGTERM)  # ends this process, whose peak would stay
    assert not is_excessive, f"{seconds:.1f} s, {peak} KiB of memory"
    path.unlink()
    return n_motions


def run_range(first, stop):
    """Check seeds in this process, and print each before it is checked."""
    n_motions = 0
    valid_files()
    # Memory and time at which the process ends, if usd-core does not return.
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, stop):
            print(seed, n_motions, flush=True)
            signal.setitimer(signal.ITIMER_PROF, 2 * MAX_SECONDS)
            n_motions += check(seed, folder)
    print(stop, n_motions, flush=True)


def main(seconds, first):
    end, seed, n_motions, ended = time.monotonic() + seconds, first, 0, []
    while time.monotonic() < end:
        words = ["--range", str(seed), str(seed + FILES_PER_PROCESS)]
        completed = subprocess.run(
            [sys.executable, "-m", "tests.fuzz_usd", *words],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        last, count = map(int, completed.stdout.splitlines()[-1].split())
        if completed.returncode > 0:
            print(completed.stderr, file=sys.stderr)
            sys.exit(f"seed {last} failed with exit code {completed.returncode}")
        if completed.returncode < 0:  # a signal
            if mutate(last)[0] == "usda":
                sys.exit(f"seed {last} ended the process: {completed.stderr}")
            ended.append(last)
            last += 1
        seed, n_motions = last, n_motions + count
    print(
        f"{seed - first} files from seed {first}: {n_motions} motions read; "
        f"usd-core exceeded the limits at {len(ended)}: {ended[:20]}"
    )


if __name__ == "__main__":
    if sys.argv[1] == "--range":
        run_range(int(sys.argv[2]), int(sys.argv[3]))
    else:
        main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
