"""The commands that write, run as a user runs them, and the states that they may leave."""

import hashlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

PROGRAM = [sys.executable, "-m", "mograft"]
MEMORY_BYTES, SECONDS = 3 << 30, 60
_CODES = (0, 1, 2, 3, 4)


@dataclass(frozen=True)
class Command:
    """A command that writes to ``work``; ``{in}`` is the folder of the clips a.bvh and b.bvh."""

    name: str
    words: str
    prepare: str = ""  # the command that makes the old state
    needs: str = ""  # the package that it needs
    resumes: str = ""  # the folder that --resume continues after a failure

    def is_possible(self):
        return not self.needs or find_spec(self.needs) is not None

    def again(self, folder):
        """Return the words of the next start, after a failure."""
        if self.resumes:
            return self.words + (" --resume" if (folder / self.resumes).exists() else "")
        has_way = "--add" in self.words or "--force" in self.words
        return self.words if has_way else f"{self.words} --force"


_INDEX = "index in/a.bvh -o work/l"
_AUGMENT = "augment in/l -o work/s -n 4 --seconds 1 --format"
_GRAFT = "graft in/a.bvh -o work/out -n 2"
COMMANDS = [
    own
    for own in (
        Command("index", _INDEX),
        Command("index -j 2", "index in -o work/l -j 2"),
        Command("index --add", "index in -o work/l --add", _INDEX),
        Command("index --force", "index in/b.bvh -o work/l --force", _INDEX),
        Command("graft", _GRAFT),
        Command("graft --force", f"{_GRAFT} --force --seed 5", _GRAFT),
        Command("graft --report", "graft in/a.bvh -o work/g.bvh --report"),
        Command("graft --from", "graft --from in/g.json -o work/g.bvh"),
        Command("lib export csv", "lib export in/l --format csv -o work/t"),
        Command("lib export npz", "lib export in/l --format npz -o work/t.npz"),
        Command("lib export parquet", "lib export in/l --format parquet -o work/t", "", "pyarrow"),
        Command("demo", "demo -o work/d"),
        Command("find", "find in/a.bvh in/l --frames 0-40 -o work/f.html"),
        Command("augment npz", f"{_AUGMENT} npz", resumes="work/s"),
        Command("augment parquet", f"{_AUGMENT} parquet", "", "pyarrow", resumes="work/s"),
        Command("curate", "curate in/l -o work/chosen --keep 50% -q"),
        Command("groups", "groups in/a.bvh -o work/groups.toml"),
        Command("view", "view in/a.bvh -o work/a.html"),
        Command("plot png", "plot strip in/a.bvh -o work/a.png --force", needs="matplotlib"),
        Command("plot svg", "plot energy in/a.bvh -o work/a.svg", needs="matplotlib"),
        *(Command(f"export {own}", f"export in/a.bvh -o work/a.{own}") for own in ("bvh", "csv")),
        *(
            Command(f"export {own} --force", f"export in/a.bvh -o work/a.{own} --force",
                    f"export in/b.bvh -o work/a.{own}", needs)
            for own, needs in (("glb", ""), ("npz", ""), ("usda", "pxr"), ("usdc", "pxr"))
        ),
        *(
            Command(f"export {own}", f"export in/a.bvh -o work/a.{own} --size 64x64", "", needs)
            for own, needs in (("gif", "PIL"), ("mp4", "imageio_ffmpeg"))
        ),
    )
    if own.is_possible()
]  # fmt: skip


def start(words, folder, variables=None, **options):
    """Start ``mograft`` in a folder, in a session of its own, with limited memory."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("MOGRAFT_")}
    return subprocess.Popen(
        [*PROGRAM, *words.split()],
        cwd=folder,
        env=environment | {"OPENBLAS_NUM_THREADS": "1"} | (variables or {}),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES)),
        **options,
    )


def run(words, folder, variables=None, seconds=SECONDS):
    """Run ``mograft``; return its exit code, or None after `seconds`, and what it printed."""
    process = start(words, folder, variables)
    try:
        out, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        out, err = process.communicate()
        return None, out, err
    return process.returncode, out, err


def complaint(code, out, err):
    """Return what is wrong with the end of a command; "" if it succeeded or has one error."""
    if code is None:
        return "does not end"
    if code not in _CODES:
        return f"exit code {code}: {err[-200:]}"
    # "encountered in" is in warnings of NumPy.
    if re.search("Traceback|Exception ignored|Warning|encountered in|at line .* in file", err):
        return f"prints {err[-300:]!r}"
    n_errors = len(re.findall("^error: ", err, re.MULTILINE))
    is_silent = not n_errors and not out and code not in (0, 2)
    return f"exit code {code} without an error: {err[-200:]!r}" if is_silent else ""


def make_inputs(folder):
    """Write the clips, a library and a graft to the folder ``in``."""
    for words in (
        "demo -o d",
        "export d/dance.bvh -o in/a.bvh --frames 0-200",
        "export d/dance.bvh -o in/b.bvh --frames 300-500",
    ):
        (folder / "in").mkdir(exist_ok=True)
        code, _, err = run(words, folder)
        assert code == 0, err
    shutil.rmtree(folder / "d")
    for words in ("index in/a.bvh in/b.bvh -o in/l", "graft in/a.bvh -o g.bvh"):
        code, _, err = run(words, folder)
        assert code == 0, err
    (folder / "in" / "g.json").write_bytes((folder / "g.json").read_bytes().replace(b'"in/', b'"'))
    for name in ("g.bvh", "g.json"):
        (folder / name).unlink()


def prepare(command, folder):
    """Make the old state of a command in ``work``."""
    old = folder / f"old {command.name}"
    shutil.rmtree(folder / "work", ignore_errors=True)
    if not old.exists():
        (folder / "work").mkdir()
        if command.prepare:
            code, _, err = run(command.prepare, folder)
            assert code == 0, err
        (folder / "work").rename(old)
    shutil.copytree(old, folder / "work", symlinks=True)
    return state(folder)


def state(folder):
    """Return the hashes of the files in ``work`` by name; those of a library are one entry.

    The names of generations and shards in a library differ after a failure. Drafts, which a kill
    leaves, are listed with a name that starts with a point.
    """
    found, libraries = {}, []
    for path in sorted((folder / "work").rglob("*")):
        name = str(path.relative_to(folder / "work"))
        if path.name == "manifest.json" and "files" in (own := json.loads(path.read_text())):
            files = own["files"]
            for file, own in files.items():
                actual = hashlib.sha256((path.parent / file).read_bytes()).hexdigest()
                assert actual == own["sha256"], f"{file} is damaged"
            kinds = sorted(
                (re.sub(r"[\d/-]", "", file), own["sha256"]) for file, own in files.items()
            )
            found[str(path.parent.relative_to(folder / "work"))] = str(kinds)
            libraries.append(path.parent)
        elif path.is_file() and path.name != ".lock":
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    inside = tuple(f"{own.relative_to(folder / 'work')}/" for own in libraries)
    return {name: own for name, own in found.items() if not name.startswith(inside)}


def differences(found, old, new):
    """Return what is neither old nor new in a state, and which grafts are no pairs."""
    problems = []
    for name in sorted({*found, *old, *new}):
        if any(part.startswith(".") for part in Path(name).parts):
            problems.append(f"{name} is left")
        elif found.get(name) not in (old.get(name), new.get(name)):
            problems.append(f"{name} is neither old nor new")
        if name.endswith(".bvh") and name[:-4] + ".json" in {*old, *new}:
            record = name[:-4] + ".json"
            wanted = [(own.get(name), own.get(record)) for own in (old, new)]
            # Between the two replacements; readers report it.
            wanted += [(own, new.get(record)) for own in (None, old.get(name))]
            if (found.get(name), found.get(record)) not in wanted:
                problems.append(f"{name} and {record} are no pair")
    return problems
