"""The commands that write, the program as a user runs it, and the states that it may leave."""

import hashlib
import os
import re
import resource
import signal
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from mograft.library.files import storage

MEMORY_BYTES, SECONDS = 3 << 30, 60
CODES = (0, 1, 2, 3, 4)


@dataclass(frozen=True)
class Command:
    """A command that writes to ``work``; the clips a.bvh and b.bvh are in ``in``.

    `words` can be run again, to the same result, unless the command `resumes` the folder work/s, or
    `keeps` a folder that is complete.
    """

    name: str
    words: str
    prepare: str = ""  # the command that makes the old state
    needs: str = "mograft"  # the package that it needs
    resumes: bool = False
    keeps: bool = False

    def again(self, work):
        """Return the words of the next start, after a failure."""
        return self.words + (" --resume" if self.resumes and (work / "s").exists() else "")


_INDEX = "index in/a.bvh -o work/l"
_AUGMENT = "augment made/l -o work/s -n 4 --seconds 1 --format"
_EXPORT = "export in/a.bvh --force -o work/a"
# The provenance holds the command, so that the next start has the same arguments.
_GRAFT = "graft in/a.bvh -o work/out -n 2 --force"
_PARQUET = "lib export made/l --format parquet -o work/t --force"
_EVERY = (
    Command("index", f"{_INDEX} --force"),
    Command("index -j 2", "index in -o work/l -j 2 --force"),
    Command("index --add", "index in -o work/l --add", _INDEX),
    Command("index --force", "index in/b.bvh -o work/l --force", _INDEX),
    Command("graft", _GRAFT),
    Command("graft --force", f"{_GRAFT} --seed 5", _GRAFT),
    Command("graft --report", "graft in/a.bvh -o work/g.bvh --report --force"),
    Command("graft --from", "graft --from made/g.json -o work/g.bvh --force"),
    Command("lib export csv", "lib export made/l --format csv -o work/t --force"),
    Command("lib export parquet", _PARQUET, needs="pyarrow"),
    Command("demo", "demo -o work/d --force"),
    Command("find", "find in/a.bvh made/l --frames 0-40 -o work/f.html --force"),
    Command("augment npz", f"{_AUGMENT} npz", resumes=True),
    Command("augment parquet", f"{_AUGMENT} parquet", needs="pyarrow", resumes=True),
    Command("curate", "curate made/l -o work/chosen --keep 50% -q --force", keeps=True),
    Command("groups", "groups in/a.bvh -o work/groups.toml --force"),
    Command("view", "view in/a.bvh -o work/a.html --force"),
    Command("plot png", "plot strip in/a.bvh -o work/a.png --force", needs="matplotlib"),
    Command("plot svg", "plot energy in/a.bvh -o work/a.svg --force", needs="matplotlib"),
    Command("export bvh", f"{_EXPORT}.bvh"),
    Command("export csv", f"{_EXPORT}.csv"),
    Command("export glb", f"{_EXPORT}.glb", "export in/b.bvh -o work/a.glb"),
    Command("export npz", f"{_EXPORT}.npz", "export in/b.bvh -o work/a.npz"),
    Command("export usda", f"{_EXPORT}.usda", "export in/b.bvh -o work/a.usda", needs="pxr"),
    Command("export usdc", f"{_EXPORT}.usdc", "export in/b.bvh -o work/a.usdc", needs="pxr"),
    Command("export gif", f"{_EXPORT}.gif --size 64x64", needs="PIL"),
    Command("export mp4", f"{_EXPORT}.mp4 --size 64x64", needs="imageio_ffmpeg"),
)
COMMANDS = [own for own in _EVERY if find_spec(own.needs) is not None]


def start(words, folder):
    """Start ``mograft`` in a folder, in a session of its own, with limited memory."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("MOGRAFT_")}
    environment.pop("LD_PRELOAD", None)
    return subprocess.Popen(
        [sys.executable, "-m", "mograft", *words],
        cwd=folder,
        env=environment | {"OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES)),
    )


def run(words, folder, seconds=SECONDS):
    """Run ``mograft``; return its exit code, or None after `seconds`, and what it printed."""
    process = start(words.split(), folder)
    try:
        out, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        out, err = process.communicate()
        return None, out, err
    return process.returncode, out, err


def complaint(code, out, err, codes=CODES):
    """Return what is wrong with the end of a command; "" if it succeeded or has one error."""
    if code is None:
        return "does not end"
    if code not in codes:
        return f"exit code {code}: {err[-200:]}"
    # "encountered in" is in warnings of NumPy.
    if re.search("Traceback|Exception ignored|Warning|encountered in|at line .* in file", err):
        return f"prints {err[-300:]!r}"
    is_silent = code in (1, 3, 4) and not out and not re.search("^error: ", err, re.MULTILINE)
    return f"exit code {code} without an error: {err[-200:]!r}" if is_silent else ""


def visible_state(work):
    """Return the files that a user sees in a folder; raise LibraryError for a damaged library.

    The result has the SHA-256 of each file by its name, and the hashes of libraries.
    """
    found, libraries = {}, _libraries(work)
    for folder in libraries:
        if problems := storage.verify(folder):
            raise storage.LibraryError(f"{folder}: {problems}")
        # Generations and shards have other numbers after a failed write.
        found[str(folder.relative_to(work))] = sorted(
            (re.sub(r"[\d/-]", "", name), own["sha256"])
            for name, own in storage.read_manifest(folder)["files"].items()
        )
    for path in sorted(work.rglob("*")):
        name = path.relative_to(work)
        is_hidden = any(part.startswith(".") for part in name.parts)
        if path.is_file() and not is_hidden and not libraries.intersection(path.parents):
            found[str(name)] = _hash(path)
    return found


def _libraries(work):
    """Return the folders of libraries, which have a database in a folder of their generation."""
    databases = work.rglob(f"*/{storage.DATABASE}")
    return {own.parents[1] for own in databases if (own.parents[1] / storage.MANIFEST).exists()}


def differences(found, old, new):
    """Return what is neither old nor new in a state, and new grafts without new provenance."""
    for name in sorted({*found, *old, *new}):
        if found.get(name) not in (old.get(name), new.get(name)):
            yield f"{name} is neither old nor new"
        record = name.removesuffix("bvh") + "json"
        is_new = name.endswith(".bvh") and found.get(name) == new.get(name) != old.get(name)
        if is_new and found.get(record) != new.get(record):
            yield f"{name} has no provenance"


def list_debris(work, expected):
    """Return the names in a folder that neither `expected` nor a complete library has."""
    libraries = _libraries(work)
    known = {parent for name in expected for parent in (work / name, *(work / name).parents)}
    debris = [
        str(path.relative_to(work))
        for path in work.rglob("*")
        if path not in known and path.name != storage.LOCK and not libraries & {*path.parents}
    ]
    return debris + [f"{own.name}/{n}" for own in libraries for n in storage.list_leftovers(own)]


_NUMBERS = re.compile(r"-\d+-[0-9a-f]+(?=\.part)")


def hash_tree(work):
    """Return a hash of all names and contents, without numbers of processes in names of drafts."""
    names = {path: _NUMBERS.sub("", str(path.relative_to(work))) for path in work.rglob("*")}
    tree = [(name, _hash(path) if path.is_file() else "") for path, name in names.items()]
    return hashlib.sha256(repr(sorted(tree)).encode()).hexdigest()


def _hash(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
