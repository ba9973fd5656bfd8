"""Measure how far streams are behind their base, and the gaps at seams, by horizon and delay.

``python -m lab delays FOLDER...`` takes every folder as one source, like ``variety``, and pushes
the first half minute of its longest clip frame by frame. It prints, for each setting of
`mg.Stream`, the median and the 99 % of the seconds between a frame and its piece, and the mean
seam gap.
"""

import argparse
import math

import numpy as np

import mograft as mg
from lab.common import run
from lab.studies.variety import read_sources

SETTINGS = ((1, 0.0), (8, 0.8), (8, 1.0), (8, 1.2), (8, 1.5), (8, math.inf))
MAX_FRAMES = 900


def measure(library, base, horizon, delay):
    """Return the seconds that each frame is behind, and the seam gaps in degrees."""
    stream = mg.Stream(library, horizon=horizon, delay=delay)
    behind, gaps, n_done = [], [], 0
    for frame in range(base.n_frames):
        stream.push(base[frame : frame + 1])
        for piece in stream.pieces():
            behind += range(frame - n_done, frame - piece.stop - 1, -1)
            n_done = piece.stop + 1
            gaps += [own.gap_before for own in piece.substitutions]
    return np.array(behind) / library.rate, np.degrees(gaps)


def report(options):
    """Print the table."""
    sources = read_sources(options)
    print("| source | horizon | delay | median | 99 % | seam gap |\n|---|---|---|---|---|---|")
    for name, library in sources.items():
        base = max(library.clips, key=len)[:MAX_FRAMES]
        for horizon, delay in SETTINGS:
            behind, gaps = measure(library, base, horizon, delay)
            cells = f"{np.median(behind):.2f} s | {np.percentile(behind, 99):.2f} s"
            print(f"| {name} | {horizon} | {delay:g} | {cells} | {gaps.mean():.1f}° |", flush=True)


def main(argv=None):
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", help="folders of BVH files, each one source")
    return run(parser, report, argv)
