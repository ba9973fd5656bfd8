"""Experiment 5.2 of the paper: exchange of colliding segments, and other repairs beside it."""

from dataclasses import replace

import numpy as np

import mograft as mg
import mograft.constraints as mc
from benches import collision
from benches.collision import copies
from benches.evidence.section import Section, Table, count_names, format_estimate, verdict
from mograft.body.anatomy import anatomy
from mograft.evaluation import estimate

NAME = "collisions"
HELPERS = (collision,)
SOURCES = ("salsa A", "perfume", "indian", "basketball", "stage")
MAX_FRAMES = 450
N_PLACEMENTS = 20
DIRECTIONS = np.radians(np.arange(0, 360, 15))
WIDEST = 4.0


def measure(recordings, *, is_quick):
    """Collisions before and after the repair of one clip, at several placements of a copy."""
    clip = max(recordings.motions, key=lambda motion: motion.n_frames)[:MAX_FRAMES]
    library = mg.Library.build(clip)
    scale = library.config.sigma_scale
    shuffled = _shuffle_clusters(library)
    whole = _whole_body_library(clip)
    rows = []
    count, step = (2, 4) if is_quick else (N_PLACEMENTS, 1)
    for placed in _placements(clip, count, step):
        avoid = mc.Avoid(placed)
        before = int((avoid.errors(mg.Poses.from_motion(clip))[0] > 1).sum())
        row = {"before": before}
        for name, own, widest in (
            ("clusters", library, scale),
            ("random", shuffled, scale),
            ("widened", library, WIDEST),
            ("whole", whole, scale),
        ):
            row[name] = _repair(own, clip, avoid, widest)
        rows.append(row)
    if not rows:
        raise mg.InsufficientDataError("there is no placement at which only the arms collide")
    return {"frames": len(clip), "rows": rows}


def _placements(clip, count, step):
    """Return placements of a copy at which the arms collide and nothing else does."""
    poses = mg.Poses.from_motion(clip)
    arms = anatomy(clip.skeleton).joints("upper_arm", "forearm", "hand", "finger")
    is_arm = np.isin(np.arange(clip.n_joints), arms)
    every = slice(None, None, 4)
    sparse = poses.with_poses(poses.frames[every], poses.rotations[every], poses.positions[every])
    found = []
    for other, _, _ in copies(clip, poses, step, DIRECTIONS):
        avoid = mc.Avoid(other)
        if (avoid.errors(sparse, ~is_arm)[0] > 1).any():
            continue
        if (avoid.errors(sparse, is_arm)[0] > 1).any():
            found.append(other)
    n = min(count, len(found))
    return [found[index * len(found) // n] for index in range(n)]


def _shuffle_clusters(library):
    """Return a library with clusters of the same sizes but random members, and no distances."""
    rng = np.random.default_rng(0)
    base = library.groups.base
    labels = {**library.labels, base: rng.permutation(library.labels[base])}
    return replace(library, labels=labels, config=replace(library.config, distance_weight=0.0))


def _whole_body_library(clip):
    """Return a library in which all joints but one are exchanged together, with any segment.

    A library needs a base group. It is a joint at the end of a leg, which accepts every donor; its
    rotations, those of a foot's last joint, are the only part of a pose that is not exchanged.
    """
    skeleton = clip.skeleton
    ends = [joint for joint in range(clip.n_joints) if joint not in skeleton.parents]
    feet = set(anatomy(skeleton).joints("foot", "toe"))
    kept = next((joint for joint in ends if joint in feet), ends[-1])
    others = [joint for joint in range(clip.n_joints) if joint != kept]
    groups = mg.JointGroups({"end": [kept], "body": others}, base="end")
    config = mg.Config(sigma=np.finfo(float).max, distance_weight=0.0)
    return mg.Library.build(clip, groups, config)


def _repair(library, clip, avoid, widest):
    graft = mg.repair(library, constraints=[avoid], widest=widest)
    after = int((avoid.errors(mg.Poses.from_motion(graft.motion))[0] > 1).sum())
    changed = (graft.motion.rotations != clip.rotations).any(axis=(1, 2)).mean()
    gaps = [seam.gap for seam in graft.seams]
    return {
        "after": after,
        "changed": float(changed),
        "scale": graft.library.config.sigma_scale,
        "gap": float(np.degrees(np.mean(gaps))) if gaps else None,
    }


_REPAIRS = {
    "clusters": "default clusters",
    "random": "random donors",
    "widened": f"clusters widened up to {WIDEST:g}",
    "whole": "whole bodies",
}


def render(results):
    """The section."""
    rows, removed = [], {key: {} for key in _REPAIRS}
    for name, result in results.items():
        for key, title in _REPAIRS.items():
            placements = result["rows"]
            shares = [1 - own[key]["after"] / own["before"] for own in placements if own["before"]]
            removed[key][name] = _mean(shares)
            solved = sum(own[key]["after"] == 0 for own in placements)
            changed = _mean([own[key]["changed"] for own in placements])
            gaps = [own[key]["gap"] for own in placements if own[key]["gap"] is not None]
            scales = [own[key]["scale"] for own in placements]
            rows.append(
                (
                    name,
                    title,
                    f"{solved} of {len(placements)}",
                    format_estimate(removed[key][name], 0, 100),
                    format_estimate(changed, 0, 100, has_n=False),
                    f"{min(scales):.2f} to {max(scales):.2f}" if key != "whole" else "any",
                    format_estimate(_mean(gaps), 1, has_n=False) if gaps else "-",
                )
            )
    return Section(
        anchor=NAME,
        title="Experiment 5.2: does an exchange of segments remove collisions?",
        question="Two figures dance side by side and their arms collide. The paper exchanges the "
        "colliding segments. How many collisions does this remove, do similar legs help, and would "
        "exchanging whole bodies do as well?",
        data=f"The longest clip of each source, its first {MAX_FRAMES} frames, as its own library. "
        f"Up to {N_PLACEMENTS} evenly spaced placements of a copy at which the arms collide and "
        "nothing else does.",
        measure="Placements without a collision after `mograft.repair`; share of colliding frames "
        "that it removes and share of changed frames, in percent; the range of `sigma_scale` (the "
        "default is 0.75; at 3 and more most clips are a single cluster); mean seam gap in "
        "degrees. Intervals resample placements, n is their number. Neighbouring "
        "placements collide at similar frames, so that these intervals are too narrow, and a "
        "verdict near 0 may be wrong.",
        null="The same repair with clusters of the same sizes whose members are random. It shows "
        "what any exchange removes. The repair of whole bodies exchanges all joints together, with "
        "the segments of similar length that have small seams; from the first exchange on "
        "it also moves the figure over the floor. So it changes most frames, or none if it "
        "exchanges nothing.",
        tables=(
            Table(
                (
                    "source",
                    "donors",
                    "solved",
                    "removed, %",
                    "changed frames, %",
                    "sigma_scale",
                    "seam gap",
                ),
                tuple(rows),
            ),
            Table(
                (
                    "source",
                    "default clusters less random donors",
                    f"clusters widened up to {WIDEST:g} less whole bodies",
                ),
                tuple(
                    (
                        name,
                        format_estimate(_difference(result, "clusters", "random"), 0, 100),
                        format_estimate(_difference(result, "widened", "whole"), 0, 100),
                    )
                    for name, result in results.items()
                ),
                "Differences of the removed shares in percentage points, paired by placement.",
            ),
        ),
        conclusions=_conclusions(results, removed),
        limits=(
            "That the donors of wide clusters suit the legs: where `sigma_scale` is large, any "
            "segment of similar length is a donor.",
            "That the repair of whole bodies is the best search of its kind: it is that of "
            "`mograft.repair` with a single group of joints.",
            "That clusters without similar legs would remove as many as clusters widened up to "
            f"{WIDEST:g}: random members were measured for the default sizes only.",
        ),
    )


def _mean(values):
    return estimate.block_mean(values, range(len(values)), "placements").as_dict()


def _difference(result, one, other):
    """Return the share removed by one repair less that removed by another."""
    return _mean(
        [
            (own[other]["after"] - own[one]["after"]) / own["before"]
            for own in result["rows"]
            if own["before"]
        ]
    )


def _comparison(results, one, other):
    """Return in which sources one repair removes more or fewer collisions than another."""
    found = {name: verdict(_difference(result, one, other)) for name, result in results.items()}
    cells = []
    for word, title in (("above", "more"), ("below", "fewer"), ("undecided", "undecided")):
        names = [name for name, own in found.items() if own == word]
        cells.append(f"{title} in {count_names(names)}")
    return f"{', '.join(cells)} of {len(found)} sources"


def _conclusions(results, removed):
    lines = []
    if results:
        lines = [
            "Do similar legs help? The colliding frames that default clusters remove, compared "
            "with random donors in clusters of the same sizes: "
            f"{_comparison(results, 'clusters', 'random')}.",
            "Would exchanging whole bodies do as well? The colliding frames that clusters widened "
            f"up to {WIDEST:g} remove, compared with whole bodies: "
            f"{_comparison(results, 'widened', 'whole')}.",
        ]
    for key, title in _REPAIRS.items():
        n = sum(len(result["rows"]) for result in results.values())
        solved = sum(
            own[key]["after"] == 0 for result in results.values() for own in result["rows"]
        )
        cells = {
            name: sum(own[key]["after"] == 0 for own in result["rows"])
            for name, result in results.items()
        }
        listed = ", ".join(f"{name} {count}" for name, count in cells.items())
        values = [own["value"] for own in removed[key].values() if own["value"] is not None]
        if values:
            lines.append(
                f"With {title}: {solved} of {n} placements solved ({listed}); "
                f"{100 * min(values):.0f} to {100 * max(values):.0f} % of the colliding frames "
                "removed."
            )
    return tuple(lines)
