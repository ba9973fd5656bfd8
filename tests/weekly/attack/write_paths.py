"""The commands that write, each with its old state, its result and what must hold between them."""

import hashlib
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from mograft.library.files import storage

Files = dict[str, str]
"""The SHA-256 of each visible file by its name; for a library the hashes of its manifest."""


@dataclass(frozen=True)
class WritePath:
    """A command that writes to the folder ``work``; the clips ``a.bvh``, ``b.bvh`` are in ``in``.

    `words` are its arguments; ``{in}`` and ``{work}`` stand for the folders. `again` are those of
    the next start, `prepare` are the commands that make the old state.
    """

    name: str
    words: tuple[str, ...]
    again: tuple[str, ...]
    prepare: tuple[tuple[str, ...], ...] = ()
    # Names of files: the first is new only if the second is.
    ordered: tuple[str, str] | None = None

    def fill(self, words, trial):
        """Return arguments with the folders of a trial."""
        folders = {"in": str(trial / "in"), "work": str(trial / "work")}
        return [word.format(**folders) for word in words]

    def allows(self, state, old, new):
        """Return whether a state is the old or the new one, for several files one by one."""
        if not set(state) <= set(old) | set(new):
            return False
        for name in set(old) | set(new):
            if state.get(name) not in (old.get(name), new.get(name)):
                return False
        if self.ordered is not None:
            first, second = self.ordered
            is_new = state.get(first) == new.get(first) != old.get(first)
            return not is_new or state.get(second) == new.get(second)
        return True


_NUMBERS = re.compile(r"(?<=partial-)\d+|-\d+-[0-9a-f]+(?=\.part)")

INDEX = ("index", "{in}/a.bvh", "-o", "{work}/l")
GRAFT = ("graft", "{in}/a.bvh", "{in}/b.bvh", "-o", "{work}/g.bvh")
CSV = ("lib", "export", "{in}/l", "--format", "csv", "-o", "{work}/tables")
NPZ = ("lib", "export", "{in}/l", "--format", "npz", "-o", "{work}/tables.npz")
GROUPS = ("groups", "{in}/a.bvh", "-o", "{work}/groups.toml")
PAGE = ("view", "{in}/a.bvh", "-o", "{work}/page.html")
GLB = ("export", "{in}/a.bvh", "-o", "{work}/a.glb")
FORCE = ("--force",)

WRITE_PATHS = (
    WritePath("index", INDEX, (*INDEX, *FORCE)),
    WritePath(
        "index --add",
        ("index", "{in}", "-o", "{work}/l", "--add"),
        ("index", "{in}", "-o", "{work}/l", "--add"),
        (INDEX,),
    ),
    WritePath(
        "index --force",
        ("index", "{in}/b.bvh", "-o", "{work}/l", *FORCE),
        ("index", "{in}/b.bvh", "-o", "{work}/l", *FORCE),
        (INDEX,),
    ),
    # The provenance holds the command, so that the next start has the same arguments.
    WritePath("graft", (*GRAFT, *FORCE), (*GRAFT, *FORCE), ordered=("g.bvh", "g.json")),
    WritePath(
        "graft --force",
        (*GRAFT, *FORCE),
        (*GRAFT, *FORCE),
        (("graft", "{in}/b.bvh", "-o", "{work}/g.bvh"),),
        ordered=("g.bvh", "g.json"),
    ),
    WritePath("lib export --format csv", CSV, (*CSV, *FORCE)),
    WritePath("lib export --format npz", NPZ, (*NPZ, *FORCE)),
    WritePath("groups", GROUPS, (*GROUPS, *FORCE)),
    WritePath("view", PAGE, (*PAGE, *FORCE)),
    WritePath("export", GLB, (*GLB, *FORCE)),
)


def visible_state(work):
    """Return the `Files` that a user sees in a folder; raise LibraryError for a damaged library."""
    state: Files = {}
    for path in sorted(work.iterdir()):
        if path.name.startswith("."):
            continue
        if (path / storage.MANIFEST).exists():
            problems = storage.verify(path)
            if problems:
                raise storage.LibraryError(f"{path}: {problems}")
            files = storage.read_manifest(path)["files"]
            # Generations have other numbers after a failed write.
            hashes = sorted(
                (name.partition("/")[2].partition("-")[0], own["sha256"])
                for name, own in files.items()
            )
            state[path.name] = repr(hashes)
        elif path.is_dir():
            for file in sorted(path.rglob("*")):
                if file.is_file():
                    state[str(file.relative_to(work))] = _hash(file)
        else:
            state[path.name] = _hash(path)
    return state


def list_debris(work, expected):
    """Return the names in a folder that neither `expected` nor a complete library has."""
    debris = sorted({path.name for path in work.iterdir()} - {n.split("/")[0] for n in expected})
    for path in work.iterdir():
        if (path / storage.MANIFEST).exists():
            debris += [f"{path.name}/{name}" for name in storage.list_leftovers(path)]
    return debris


def hash_tree(work):
    """Return a hash of all names and contents, without numbers of processes in names of drafts."""
    digest = hashlib.sha256()
    for path in sorted(work.rglob("*"), key=lambda path: _NUMBERS.sub("", str(path))):
        name = _NUMBERS.sub("", str(path.relative_to(work)))
        digest.update(f"{name} {_hash(path) if path.is_file() else ''}\n".encode())
    return digest.hexdigest()


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def reset(trial, template):
    """Make the folder ``work`` of a trial a copy of that of the template."""
    shutil.rmtree(trial / "work", ignore_errors=True)
    shutil.copytree(template / "work", trial / "work")
