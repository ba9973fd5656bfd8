"""The commands that write, and the states in which they may leave a folder."""

import hashlib
import re
from typing import NamedTuple

from mograft.library.files import storage


class WritePath(NamedTuple):
    """A command that writes to the folder ``work``; the clips ``a.bvh``, ``b.bvh`` are in ``in``.

    `words` are its arguments, and `prepare` those of the command that makes the old state.
    """

    name: str
    words: str
    prepare: str = ""

    @property
    def again(self):
        """The arguments of the next start."""
        is_repeatable = self.words.endswith((" --force", " --add"))
        return self.words if is_repeatable else f"{self.words} --force"


_NUMBERS = re.compile(r"(?<=partial-)\d+|-\d+-[0-9a-f]+(?=\.part)")
_INDEX = "index in/a.bvh -o work/l"
# The provenance holds the command, so that the next start has the same arguments.
_GRAFT = "graft in/a.bvh in/b.bvh -o work/g.bvh --force"

WRITE_PATHS = (
    WritePath("index", _INDEX),
    WritePath("index --add", "index in -o work/l --add", _INDEX),
    WritePath("index --force", "index in/b.bvh -o work/l --force", _INDEX),
    WritePath("graft", _GRAFT),
    WritePath("graft --force", _GRAFT, "graft in/b.bvh -o work/g.bvh"),
    WritePath("lib export --format csv", "lib export in/l --format csv -o work/tables"),
    WritePath("lib export --format npz", "lib export in/l --format npz -o work/tables.npz"),
    WritePath("groups", "groups in/a.bvh -o work/groups.toml"),
    WritePath("view", "view in/a.bvh -o work/page.html"),
    WritePath("export", "export in/a.bvh -o work/a.glb"),
)


def is_allowed(state, old, new):
    """Return whether a state is the old or the new one, for several files one by one.

    A new graft is allowed only with its new provenance.
    """
    is_mixed = all(state.get(name) in (old.get(name), new.get(name)) for name in state | old | new)
    is_new_graft = state.get("g.bvh") == new.get("g.bvh") != old.get("g.bvh")
    return is_mixed and (not is_new_graft or state.get("g.json") == new.get("g.json"))


def visible_state(work):
    """Return the files that a user sees in a folder; raise LibraryError for a damaged library.

    The result has the SHA-256 of each file by its name, and the hashes of libraries.
    """
    state = {}
    for path in sorted(own for own in work.iterdir() if not own.name.startswith(".")):
        if (path / storage.MANIFEST).exists():
            if problems := storage.verify(path):
                raise storage.LibraryError(f"{path}: {problems}")
            # Generations have other numbers after a failed write.
            state[path.name] = sorted(
                (name.partition("/")[2].partition("-")[0], own["sha256"])
                for name, own in storage.read_manifest(path)["files"].items()
            )
        else:
            files = [file for file in (path, *path.rglob("*")) if file.is_file()]
            state |= {str(file.relative_to(work)): _hash(file) for file in files}
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
    names = {path: _NUMBERS.sub("", str(path.relative_to(work))) for path in work.rglob("*")}
    tree = [(name, _hash(path) if path.is_file() else "") for path, name in names.items()]
    return hashlib.sha256(repr(sorted(tree)).encode()).hexdigest()


def _hash(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()
