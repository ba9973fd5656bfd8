"""Damaged models and tables of robots: small valid files with random changes.

Within 5 seconds, reading must return a model, or a motion that can be written, or raise a
`FormatError` with the path.
"""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from mograft import FormatError, Motion, formats
from mograft.io.formats import read
from tests.fuzz import damage, limits, outcome
from tests.io.robot_files import random_robot, to_urdf, write_walks

_WORDS = (
    *(*b'nan inf -1e308 1e999 " < ,'.split(), b"\n", *b"\x00 \xff &amp; -".split()),
    *(b"</body>", b"<body>", b'type="ball"', b'euler="1 2 3"', b'class="x"', b'<joint name="a"/>'),
)


@cache
def valid_files():
    """The model of the tables, and the name and the bytes of each valid file."""
    folder = Path(tempfile.mkdtemp())
    path, (table,) = write_walks(folder, n_clips=1, n_frames=20)
    model = formats.read_model(path, rate=30)
    names = [f"root_{kind}{axis}" for kind in ("translate", "rotate") for axis in "XYZ"]
    names += [f"{name}_dof" for name in model.hinges.names]
    rows = ["Frame," + ",".join(names)]
    rows += [f"{k},0,{k},80,{k},0,0" + ",0.5" * len(model.hinges.names) for k in range(5)]
    formats.write_tracker(read(table, skeleton=model)[0], folder / "t.npz")
    files = {"m.xml": path.read_bytes(), "t.csv": table.read_bytes()}
    files |= {"m.urdf": to_urdf(random_robot(3, several=False)).encode()}
    files |= {"h.csv": "\n".join(rows).encode(), "t.npz": (folder / "t.npz").read_bytes()}
    return model, files


def mutate(seed):
    """Return the name and the content of a damaged file."""
    return damage(seed, valid_files()[1], _WORDS)


def check(seed, folder):
    """Read a damaged file; return whether it is a model or a motion."""
    name, data = mutate(seed)
    path = folder / name
    path.write_bytes(data)
    with limits(5.0):
        if path.suffix in (".xml", ".urdf"):
            found = outcome(formats.read_model, path)
        else:
            found = outcome(lambda: read(path, skeleton=valid_files()[0])[0])
        if isinstance(found, FormatError):
            assert str(path) in str(found)
        elif isinstance(found, Motion):
            assert np.isfinite(found.rotations).all()
            formats.write_table(found, folder / "again.csv")
    return not isinstance(found, FormatError)
