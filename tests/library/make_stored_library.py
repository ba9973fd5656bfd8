"""Write what later versions must read: ``python -m tests.library.make_stored_library``.

``tests/data`` holds for each version a library (``library-0.1.tar.xz``), a graft of it
(``library-0.1.npz``), and clips with grafts and their provenance (``grafts-0.1.tar.xz``). After the
release of a version they never change. The clips are of the procedural dancer.
"""

import json
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np

import mograft as mg
from mograft.dancer import dance
from mograft.scenario import walk

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data"
VERSION = ".".join(mg.__version__.split(".")[:2])
N_CLIPS, N_FRAMES = 2, 44
N_FRAMES_OF_GRAFTS = 260


def graft(library):
    """Return the graft that is compared with the stored one."""
    return mg.graft(library, seed=7)


def write_clips(folder, n_frames):
    """Write two clips of the dancer, one after the other."""
    motion = dance(seed=0, strides=1).motion
    for number in range(N_CLIPS):
        part = motion[number * n_frames : (number + 1) * n_frames]
        mg.write_bvh(part, folder / f"{number}.bvh", digits=2)


def is_released(version):
    """Return whether the changelog names a minor version, such as 0.1."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return re.search(rf"^## {re.escape(version)}\.\d", text, re.MULTILINE) is not None


def write_grafts(folder, stored, config=None):
    """Write grafts of several kinds beside their provenance, into a folder with clips."""
    clips = sorted(folder.glob("*.bvh"))
    library = mg.Library.build(clips, config=config)
    arms = mg.Library.build(clips, groups="lower_torso_larm_rarm", config=config)
    first = mg.graft(arms, seed=3)
    grafts = {
        "plain": mg.graft(library, seed=7),
        "groups": first,
        "constraints": mg.graft(
            library, seed=5, constraints=[mg.KeepOriginal(frames=(20, 60)), mg.MaxStretch(0.1)]
        ),
        "edit": first.replace(mg.KeepOriginal(frames=(60, 90)), reroll=[10], seed=1),
        "walk": mg.graft(library, scenario=walk(library, 4.0, seed=2), seed=2),
        "library": graft(stored),
    }
    for name, new in grafts.items():
        mg.write_graft(new, folder / f"new_{name}.bvh")


def describe_numbers():
    """Return what decides the last bits of numbers: NumPy and its vector instructions."""
    build = np.show_config(mode="dicts")
    return {
        "numpy": np.__version__,
        "machine": build["Machine Information"]["host"],
        "instructions": build["SIMD Extensions"],
    }


def main():
    """Write the files of this version; raise FileExistsError if it is released."""
    DATA.mkdir(exist_ok=True)
    if is_released(VERSION):
        raise FileExistsError(f"{VERSION} is released: its stored files never change")
    with tempfile.TemporaryDirectory() as temporary:
        library = write_library(Path(temporary))
        folder = Path(temporary) / "grafts"
        folder.mkdir()
        write_clips(folder, N_FRAMES_OF_GRAFTS)
        write_grafts(folder, library)
        (folder / "numbers.txt").write_text(json.dumps(describe_numbers()), encoding="utf-8")
        shutil.make_archive(DATA / f"grafts-{VERSION}", "xztar", folder)


def write_library(folder):
    """Write a library and a graft of it; return the library, which is in `folder`."""
    target = DATA / f"library-{VERSION}"
    (folder / "clips").mkdir()
    write_clips(folder / "clips", N_FRAMES)
    library = mg.Library.index(folder / "clips", folder / target.name)
    shutil.make_archive(target, "xztar", library.folder)
    new = graft(library)
    np.savez_compressed(
        target.with_name(f"{target.name}.npz"),
        rotations=new.motion.rotations.astype(np.float32),
        positions=new.motion.positions.astype(np.float32),
        donors=[[own.donor_start, own.donor_stop] for own in new.substitutions],
    )
    return library


if __name__ == "__main__":
    main()
