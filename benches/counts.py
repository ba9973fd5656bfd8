"""Count what the paper counts in its tables 1 and 2, on motions of your own.

``python benches/counts.py FILE...`` cuts every file at 30 frames a second into segments,
clusters the parts of 2, 3 and 4 joint groups and prints how many segments could be put
together from them if nothing but the clusters limited the choice, beside the paper's numbers.
With no file the built-in dancer is counted.
"""

import argparse
import warnings
from pathlib import Path

import mograft as mg
from mograft.substitution import combinations

RATE = 30.0
PRESETS = {2: "lower_upper", 3: "lower_torso_arms", 4: "lower_torso_larm_rarm"}
PAPER = {
    "table 1 (6572 frames)": (895, {2: 3736, 3: 47018, 4: 3776858}),
    "table 2 (6652 frames)": (906, {2: 4272, 3: 79012, 4: 1910228}),
}


def row(what, segments, counts, clusters=""):
    cells = "".join(f"{counts[k]:>14}{counts[k] / segments:>11.1f}" for k in PRESETS)
    return f"{what:<34}{segments:>9}{cells}  {clusters}"


def counted(motion, config):
    counts, clusters = {}, {}
    for k, preset in PRESETS.items():
        library = mg.Library.build(motion, preset, config)
        counts[k] = combinations(library.labels[library.groups.base], k)
        clusters.update({name: int(own.max()) + 1 for name, own in library.labels.items()})
    told = " ".join(f"{name} {n}" for name, n in clusters.items())
    return len(library.segments), counts, told


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    heads = "".join(f"{f'B, K={k}':>14}{'B/A':>11}" for k in PRESETS)
    print(f"{'':<34}{'A':>9}{heads}  clusters")
    for name, (segments, counts) in PAPER.items():
        print(row(f"paper, {name}", segments, counts))
    if options.files:
        motions = [mg.read_bvh(path) for path in options.files]
    else:
        from mograft.dancer import dance

        motions = [dance().motion]
    for motion in motions:
        at_30 = motion.resample(RATE)
        for name, config in (("paper", mg.Config.paper()), ("default", mg.Config())):
            what = f"{motion.name} ({at_30.n_frames}), {name}"
            print(row(what, *counted(at_30, config)))


if __name__ == "__main__":
    main()
