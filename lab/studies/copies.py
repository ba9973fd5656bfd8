"""Measure how new grafts are if the library also holds a copy of their base.

``python -m lab copies FOLDER...`` takes every folder as one source, like ``variety``, and prints
the share of frames in which a grafted joint differs from the base by more than 5°:

- ``piece``: the base is a clip of ten seconds, cut from the longest clip of the library;
- ``stream``: the base of a stream is the longest clip of its library.

If copies could be donors, the captured part would be the cheapest one, and the share near 0.
"""

import argparse
from dataclasses import replace

import numpy as np

import mograft as mg
from lab.common import run
from lab.studies.variety import NEW_ANGLE, read_sources

COUNT = 5
PIECE_SECONDS = 10


def new_share(library, base, motion):
    """The share of frames in which a grafted joint of `motion` differs from `base`."""
    grafted = np.concatenate([library.joints(name) for name in library.groups.names[1:]])
    angles = mg.rotations.angle(base.rotations[:, grafted], motion.rotations[:, grafted])
    return float((angles > NEW_ANGLE).any(axis=1).mean())


def measure_piece(library, take):
    """The share for grafts of the middle seconds of `take`, beside all clips of a library."""
    n, middle = int(PIECE_SECONDS * take.rate), len(take) // 2
    piece = replace(take[max(middle - n // 2, 0) : middle + n // 2], name="piece", path=None)
    library = mg.Library.build([*library.clips, piece])
    return np.mean(
        [new_share(library, piece, own.motion) for own in mg.graft_many(library, "piece", COUNT)]
    )


def measure_stream(library, base):
    """The share for the pieces of a stream over `base`."""
    stream = mg.Stream(library, seed=1)
    stream.push(base)
    pieces = list(stream.pieces())
    shares = [new_share(library, base[own.start : own.stop + 1], own.motion) for own in pieces]
    return np.average(shares, weights=[len(own.motion) for own in pieces])


def report(options):
    """Print the table."""
    sources = read_sources(options)
    print("| source | piece | stream |\n|---|---|---|")
    for name, library in sources.items():
        take = max(library.clips, key=len)
        shares = measure_piece(library, take), measure_stream(library, take)
        print(f"| {name} |" + "".join(f" {share:.2f} |" for share in shares), flush=True)


def main(argv=None):
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", help="folders of BVH files, each one source")
    return run(parser, report, argv)
