"""Write the library that later versions must open: ``python -m tests.library.make_stored_library``.

``tests/data/library-0.1.tar.xz`` holds the folder of a library. It is written once per format of
libraries and never changed. The clips are of the procedural dancer.
"""

import shutil
import tempfile
from pathlib import Path

import numpy as np

import mograft as mg
from mograft.dancer import dance

DATA = Path(__file__).parents[1] / "data"
NAME = "library-" + ".".join(mg.__version__.split(".")[:2])
N_CLIPS, N_FRAMES = 2, 44


def graft(library):
    """Return the graft that is compared with the stored one."""
    return mg.graft(library, seed=7)


def main():
    """Write the library, and the graft beside it."""
    DATA.mkdir(exist_ok=True)
    if (DATA / f"{NAME}.npz").exists():
        raise FileExistsError(f"{NAME} exists; a stored library never changes")
    motion = dance(seed=0, strides=1).motion
    with tempfile.TemporaryDirectory() as clips:
        for number in range(N_CLIPS):
            part = motion[number * N_FRAMES : (number + 1) * N_FRAMES]
            mg.write_bvh(part, Path(clips) / f"{number}.bvh", digits=2)
        library = mg.Library.index(clips, Path(clips) / NAME)
        shutil.make_archive(DATA / NAME, "xztar", library.folder)
        new = graft(library)
    np.savez_compressed(
        DATA / f"{NAME}.npz",
        rotations=new.motion.rotations.astype(np.float32),
        positions=new.motion.positions.astype(np.float32),
        donors=[[own.donor_start, own.donor_stop] for own in new.substitutions],
    )


if __name__ == "__main__":
    main()
