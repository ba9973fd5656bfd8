"""Compare the outputs of two versions of mograft, byte for byte.

    python -m release.same_outputs --old PYTHON_A --new PYTHON_B [--cache FOLDER]

Both interpreters have a version of mograft. Each case of `output_cases` runs with both in an empty
folder; files, standard output and exit codes are compared. `EXPECTED` names the rules that were
changed on purpose. The exit code is 1 if another difference is found. `--cache` keeps the results
of the old version, so that it runs once. `--only` selects cases by a glob, such as ``data/*``.
"""

import argparse
import fcntl
import gzip
import hashlib
import json
import os
import re
import shlex
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from release.expected_outputs import EXPECTED
from release.output_cases import PREAMBLE, Case, all_cases

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
PLACE = Path(tempfile.gettempdir()) / f"mograft-outputs-{os.getuid()}"  # paths may be in outputs
MAX_TEXT = 4 * 2**20
STEP_SECONDS = 300
MESSAGES = "messages"  # stderr: warnings and progress, compared for information
CODE = re.compile(r"<script.*?</script>|<style>.*?</style>|<meta http-equiv[^>]*>", re.S)
SCRIPT = re.compile(r"<script(?: type=\"application/json\" id=\"([\w-]+)\")?>(.*?)</script>", re.S)

FIXTURES = """
import json
from pathlib import Path
import numpy as np
import mograft as mg
from mograft.dancer import dance
from mograft.cli import main
write = getattr(getattr(mg, "formats", mg), "write_bvh")
for folder in ("clips", "amass"):
    Path(folder).mkdir()
motions = [dance(seed=seed, strides=1).motion for seed in range(2)]
for seed, motion in enumerate(motions):
    write(motion, f"clips/take{seed}.bvh")
Path("clips/tags.csv").write_text("take0,licence:CC BY 4.0\\n")
cuts = {f"take{seed}": list(range(15, 1480, 12 + seed)) for seed in range(2)}
Path("clips/cuts.json").write_text(json.dumps(cuts))
groups = mg.JointGroups.preset("lower_upper", motions[0].skeleton).to_toml()
Path("clips/upper_base.toml").write_text(groups.replace('base = "lower"', 'base = "upper"'))
main(["demo", "-o", "demo"])
rng = np.random.default_rng(0)
for name in ("walk", "wave"):
    time = np.arange(400)[:, None] / 60
    poses = 0.4 * np.sin(rng.uniform(1, 6, 156) * time + rng.uniform(0, 6, 156))
    poses[:, :3] = np.array([np.pi / 2, 0, 0]) + 0.1 * poses[:, :3]
    trans = np.column_stack([time[:, 0], 0.1 * np.sin(time[:, 0]), np.full(400, 0.93)])
    other = {"gender": "female", "betas": rng.normal(size=16), "mocap_framerate": 60.0}
    np.savez(f"amass/{name}_poses.npz", poses=poses, trans=trans, **other)
skeleton = mg.read("amass/walk_poses.npz")[0].skeleton
offsets, still = 1.1 * skeleton.offsets, np.tile([0, 0, 0, 1.0], (1, skeleton.n_joints, 1))
body = mg.Motion(skeleton.with_offsets(offsets), 1.0, still, offsets[None])
mg.write_bvh(body, "amass/body.bvh")
"""


@dataclass
class Outcome:
    """What the steps of a case left behind in one version."""

    steps: tuple[str, ...]
    codes: list[int] = field(default_factory=list)
    digests: dict[str, str] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, content: bytes) -> None:
        """Add a file; its text is kept if it is short enough."""
        self.digests[name] = hashlib.sha256(content).hexdigest()
        if len(content) <= MAX_TEXT:
            try:
                self.texts[name] = content.decode()
            except UnicodeDecodeError:
                return


@dataclass
class Runner:
    """Runs cases with one interpreter."""

    python: str
    data: Path
    fixtures: Path
    is_old: bool = False
    cache: Path | None = None

    def run(self, case: Case) -> Outcome:
        """Return what a case leaves behind; that of a cached case is read."""
        steps = case.for_version(is_old=self.is_old)
        stem = hashlib.sha256(f"{case.name}{steps}".encode()).hexdigest()[:24]
        path = self.cache / f"{stem}.json.gz" if self.cache else None
        if path and path.exists():
            return Outcome(**json.loads(gzip.decompress(path.read_bytes())))
        with empty_place() as place:
            for need in case.needs:
                copy_input(need, self.fixtures, self.data, place)
            known = set(files_in(place))
            outcome = Outcome(steps)
            for number, step in enumerate(steps):
                self.run_step(step, number, outcome, place)
            for name in sorted(set(files_in(place)) - known):
                add_file(outcome, name, (place / name))
        if path:
            path.write_bytes(gzip.compress(json.dumps(asdict(outcome)).encode(), 1))
        return outcome

    def run_step(self, step: str, number: int, outcome: Outcome, place: Path) -> None:
        """Run one step, and add its exit code, output and messages."""
        words = shlex.split(step) if step.startswith("mograft ") else []
        arguments = ["-m", *words] if words else ["-c", PREAMBLE + step]
        code, output, messages = execute([self.python, *arguments], place)
        outcome.codes.append(code)
        outcome.add(f"<output {number}>", output)
        outcome.add(f"<{MESSAGES} {number}>", messages)


def execute(command: list[str], place: Path) -> tuple[int, bytes, bytes]:
    """Run a command in a folder; return the exit code, the output and the messages."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("MOGRAFT_")}
    environment = kept | {"MPLBACKEND": "agg", "NO_COLOR": "1", "COLUMNS": "100"}
    try:
        process = subprocess.run(
            command,
            cwd=place,
            env=environment,
            capture_output=True,
            timeout=STEP_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return -1, b"", b"timeout"
    return process.returncode, process.stdout, process.stderr


@contextmanager
def empty_place() -> Iterator[Path]:
    """Give an empty folder that has the same path in every run; other runs wait."""
    PLACE.mkdir(exist_ok=True)
    with (PLACE / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        shutil.rmtree(PLACE / "run", ignore_errors=True)
        (PLACE / "run").mkdir()
        yield PLACE / "run"


def copy_input(need: str, fixtures: Path, data: Path, place: Path) -> None:
    """Copy a fixture, or a file or folder of the data to ``data``, with its times."""
    is_fixture = (fixtures / need).exists()
    source = fixtures / need if is_fixture else data / need
    target = place / need if is_fixture else place / "data" / need
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copy2(source, target)


def make_fixtures(python: str, folder: Path) -> None:
    """Make the clips of the built-in dancer with the old version, with fixed times."""
    if folder.exists():
        return
    with empty_place() as place:
        code, _, messages = execute([python, "-c", FIXTURES], place)
        if code:
            raise RuntimeError(messages.decode())
        for path in place.rglob("*"):
            os.utime(path, (1_600_000_000, 1_600_000_000))
        shutil.copytree(place, folder)


def files_in(folder: Path) -> list[str]:
    """Return the relative paths of all files of a folder."""
    return [p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()]


def add_file(outcome: Outcome, name: str, path: Path) -> None:
    """Add a written file: a database as its statements, the data of a page apart."""
    content = path.read_bytes()
    if path.suffix == ".sqlite":
        with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as connection:
            content = "\n".join(connection.iterdump()).encode()
    outcome.add(name, content)


def split_pages(outcome: Outcome) -> None:
    """Add the data and the body of each page, which must stay when its code changes."""
    for name in [name for name in outcome.texts if name.endswith(".html")]:
        page = outcome.texts[name]
        for number, (label, text) in enumerate(SCRIPT.findall(page)):
            if label:
                outcome.add(f"{name}#{number}-{label}.json", text.encode())
        outcome.add(f"{name}#body", CODE.sub("", page).encode())


@dataclass(frozen=True)
class Difference:
    """A difference between the versions in one file of a case."""

    case: str
    file: str
    detail: str
    keys: tuple[str, ...] = ()  # JSON only: where the values differ

    def reason(self) -> str | None:
        """Return the changed rule that explains the difference, or None."""
        for rule in EXPECTED:
            if not (fnmatchcase(self.case, rule.case) and fnmatchcase(self.file, rule.file)):
                continue
            if not rule.keys or (
                self.keys and all(any(fnmatchcase(k, p) for p in rule.keys) for k in self.keys)
            ):
                return rule.reason
        return None

    @property
    def kind(self) -> str:
        """Return the class of the file: page, messages or output."""
        if self.file.endswith(".html"):
            return "page"
        return MESSAGES if self.file.startswith(f"<{MESSAGES}") else "output"


def compare(case: Case, old: Outcome, new: Outcome) -> list[Difference]:
    """Return the differences of a case."""
    found = []
    for outcome in (old, new):
        split_pages(outcome)
    for number, (a, b) in enumerate(zip(old.codes, new.codes, strict=True)):
        if a != b:
            failed = "failed in new" if a == 0 else "failed in old" if b == 0 else "exit code"
            text = new.texts.get(f"<{MESSAGES} {number}>" if b else "", "").strip()[-300:]
            step = new.steps[number].strip().splitlines()[0]
            found.append(
                Difference(case.name, f"<code {number}>", f"{failed}: {a}, {b}: {step} {text}")
            )
    for name in sorted({*old.digests, *new.digests}):
        if old.digests.get(name) == new.digests.get(name):
            continue
        if name not in old.digests or name not in new.digests:
            missing = "only in new" if name not in old.digests else "only in old"
            found.append(Difference(case.name, name, missing))
            continue
        keys = differing_keys(old.texts.get(name), new.texts.get(name))
        detail = first_difference(old.texts.get(name), new.texts.get(name), keys)
        found.append(Difference(case.name, name, detail, keys))
    return found


def differing_keys(old: str | None, new: str | None) -> tuple[str, ...]:
    """Return the places at which two JSON documents differ; none for other texts."""
    try:
        pair = json.loads(old or ""), json.loads(new or "")
    except ValueError:
        return ()
    return tuple(walk_json(*pair, ""))


def walk_json(old: object, new: object, place: str) -> Iterator[str]:
    """Yield the places of different values, such as ``clips.0.name``."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            here = f"{place}.{key}".strip(".")
            if (key in old) != (key in new):
                yield here
            else:
                yield from walk_json(old.get(key), new.get(key), here)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for number, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from walk_json(a, b, f"{place}.{number}".strip("."))
    elif old != new or type(old) is not type(new):
        yield place or "."


def first_difference(old: str | None, new: str | None, keys: tuple[str, ...]) -> str:
    """Return the first different line of two texts, or the different JSON keys."""
    if keys:
        return f"keys {', '.join(keys[:6])}{f' and {len(keys) - 6} more' * (len(keys) > 6)}"
    if old is None or new is None:
        return "binary"
    pairs = zip([*old.splitlines(), "<end>"], [*new.splitlines(), "<end>"], strict=False)
    for number, (a, b) in enumerate(pairs):
        if a != b:
            same = next(
                (i for i, pair in enumerate(zip(a, b, strict=False)) if len({*pair}) > 1), 0
            )
            start = max(0, same - 30)
            parts = [line[start : same + 90] for line in (a, b)]
            return f"line {number + 1}: {parts[0]!r} became {parts[1]!r}"
    return "layout"


def report_case(case: Case, old: Outcome, differences: list[Difference]) -> str:
    """Print the result of a case and return it in one word."""
    outputs = [d for d in differences if d.kind == "output"]
    unexplained = [d for d in outputs if d.reason() is None]
    word = "DIFFERS" if unexplained else "expected" if outputs else "identical"
    failures = f" (exit {max(old.codes)} in both)" if any(old.codes) and not unexplained else ""
    others = Counter(d.kind for d in differences if d.kind != "output" and not d.reason())
    note = "".join(f", {count} {kind} differ" for kind, count in others.items())
    print(f"{word:10} {case.name}{failures}{note}", flush=True)
    for reason, count in Counter(d.reason() for d in outputs if d.reason()).items():
        print(f"             {count} files: {reason}")
    for difference in unexplained[:8]:
        print(f"             {difference.file}: {difference.detail}")
    if len(unexplained) > 8:
        print(f"             and {len(unexplained) - 8} more files")
    return word


def parse_arguments(words: list[str] | None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--old", required=True, help="interpreter with the old version")
    parser.add_argument("--new", required=True, help="interpreter with the new version")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of recordings")
    parser.add_argument("--only", action="append", default=[], help="glob of cases")
    parser.add_argument("--cache", type=Path, help="folder of the results of the old version")
    parser.add_argument("--json", type=Path, help="file for all differences")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    """Run all cases with both versions, and return 1 if an unexplained difference is found."""
    options = parse_arguments(words)
    cache = options.cache.resolve() if options.cache else Path(tempfile.mkdtemp())
    cache.mkdir(parents=True, exist_ok=True)
    make_fixtures(options.old, cache / "fixtures")
    old = Runner(options.old, options.data, cache / "fixtures", is_old=True, cache=cache)
    new = Runner(options.new, options.data, cache / "fixtures", is_old=options.new == options.old)
    cases = [c for c in all_cases(options.data) if not options.only or selects(options.only, c)]
    words_found: Counter[str] = Counter()
    every: list[Difference] = []
    n_files = 0
    for case in cases:
        before, after = old.run(case), new.run(case)
        differences = compare(case, before, after)
        words_found[report_case(case, before, differences)] += 1
        n_files += len(before.digests)
        every += differences
    if not options.cache:
        shutil.rmtree(cache)
    counts = ", ".join(f"{count} {word}" for word, count in sorted(words_found.items()))
    kinds = Counter(d.kind for d in every if not d.reason())
    print(f"{len(cases)} cases with {n_files} files: {counts}")
    print("unexplained:", dict(kinds) or "none")
    if options.json:
        rows = [asdict(d) | {"reason": d.reason(), "kind": d.kind} for d in every]
        options.json.write_text(json.dumps(rows, indent=1))
    return int("DIFFERS" in words_found)


def selects(globs: list[str], case: Case) -> bool:
    """Return whether a glob selects a case."""
    return any(fnmatchcase(case.name, glob) for glob in globs)


if __name__ == "__main__":
    sys.exit(main())
