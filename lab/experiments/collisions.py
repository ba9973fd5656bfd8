"""Experiment 5.2 of the paper: exchange of colliding segments, and other repairs beside it.

The longest clip of each source, its first 450 frames, as its own library, beside a copy of itself
at up to 20 placements at which the arms collide and nothing else does. Placements without a
collision after `mograft.repair`; share of colliding frames that it removes and share of changed
frames; mean seam gap. Null: the same repair with clusters of the same sizes whose members are
random. The repair of whole bodies exchanges all joints together. Nodes: the candidates near the
violations, among which the last search of a repair chooses, beside those of the whole motion.
Seconds of processor time of a repair. Intervals resample placements;
neighbouring placements collide at similar frames, so that the intervals are too narrow.
"""

import time
from dataclasses import replace

import numpy as np

import mograft as mg
from lab.experiments.tables import Table, format_estimate
from mograft.body.anatomy import anatomy
from mograft.evaluation import estimate
from mograft.solve.donor_repair import restrict_to_violations
from mograft.solve.plan import GraftPlan

NAME = "collisions"
SOURCES = ("salsa A", "perfume", "indian", "basketball", "stage")
MAX_FRAMES = 450
N_PLACEMENTS = 20
DIRECTIONS = np.radians(np.arange(0, 360, 15))
DISTANCES = np.arange(0.25, 1.0, 0.05)  # of the copy, in heights
WIDEST = 4.0


def measure(recordings, *, is_quick):
    """Collisions before and after the repair of one clip, at several placements of a copy."""
    clip = max(recordings.motions, key=lambda motion: motion.n_frames)[:MAX_FRAMES]
    balls = mg.Library.build(clip)
    library = mg.Library.build(clip, config=mg.Config(neighbourhood="cluster"))
    scale = library.config.sigma_scale
    shuffled = _shuffle_clusters(library)
    whole = _whole_body_library(clip)
    rows = []
    count, step = (2, 4) if is_quick else (N_PLACEMENTS, 1)
    for placed in _placements(clip, count, step):
        avoid = mg.constraints.Avoid(placed)
        before = int((avoid.errors(mg.Poses.from_motion(clip))[0] > 1).sum())
        row = {"before": before}
        for name, own, widest in (
            ("balls", balls, scale),
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
    for other in copies(clip, poses, step):
        avoid = mg.constraints.Avoid(other)
        if (avoid.errors(sparse, ~is_arm)[0] > 1).any():
            continue
        if (avoid.errors(sparse, is_arm)[0] > 1).any():
            found.append(other)
    n = min(count, len(found))
    return [found[index * len(found) // n] for index in range(n)]


def copies(motion, poses, step=1):
    """Yield characters at all distances and in all directions, with either heading."""
    level = [axis for axis in range(3) if axis != poses.up]
    for yaw in (0.0, np.pi):
        # The rotation is about the origin: move the mean position back to that of the original.
        mean = poses.positions[:, 0].mean(axis=0)
        home = mean - (mean if yaw == 0 else _half_turn(mean, poses.up))
        for distance in DISTANCES[::step]:
            for angle in DIRECTIONS[::step]:
                offset = home.copy()
                offset[level] += distance * poses.height * np.array([np.cos(angle), np.sin(angle)])
                yield mg.constraints.Character(motion, tuple(offset), yaw)


def _half_turn(position, up):
    turned = -position
    turned[up] = position[up]
    return turned


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
    config = mg.Config(neighbourhood="cluster", sigma_scale=1e6, distance_weight=0.0)
    return mg.Library.build(clip, groups, config)


def _repair(library, clip, avoid, widest):
    start = time.process_time()
    graft = mg.repair(library, constraints=[avoid], widest=widest)
    seconds = time.process_time() - start
    problem = GraftPlan.build(graft.library, None, None, [avoid]).problem
    near = restrict_to_violations(problem, problem.captured_donors)
    after = int((avoid.errors(mg.Poses.from_motion(graft.motion))[0] > 1).sum())
    changed = (graft.motion.rotations != clip.rotations).any(axis=(1, 2)).mean()
    gaps = [seam.gap for seam in graft.seams]
    return {
        "after": after,
        "changed": float(changed),
        "scale": graft.library.config.sigma_scale,
        "gap": float(np.degrees(np.mean(gaps))) if gaps else None,
        "seconds": seconds,
        "nodes": _count_nodes(near),
        "all nodes": _count_nodes(problem),
    }


def _count_nodes(problem):
    """Return the number of candidates at all positions that have more than the base segment."""
    counts = [len(own) for lists in problem.candidates.values() for own in lists]
    return sum(count for count in counts if count > 1)


_COSTS = ("seconds", "nodes", "all nodes")
_REPAIRS = {
    "balls": "balls, the default",
    "clusters": "clusters",
    "random": "random donors",
    "widened": f"clusters widened up to {WIDEST:g}",
    "whole": "whole bodies",
}


def tables(results):
    """What each repair solves, and differences between repairs."""
    rows = []
    for name, result in results.items():
        placements = result["rows"]
        for key, title in _REPAIRS.items():
            shares = [1 - own[key]["after"] / own["before"] for own in placements if own["before"]]
            gaps = [own[key]["gap"] for own in placements if own[key]["gap"] is not None]
            scales = [own[key]["scale"] for own in placements]
            rows.append(
                (
                    name,
                    title,
                    str(sum(own[key]["after"] == 0 for own in placements)),
                    str(len(placements)),
                    format_estimate(_mean(shares), 0, 100),
                    format_estimate(
                        _mean([own[key]["changed"] for own in placements]), 0, 100, has_n=False
                    ),
                    f"{min(scales):.2f} to {max(scales):.2f}" if key != "whole" else "any",
                    format_estimate(_mean(gaps), 1, has_n=False) if gaps else "-",
                    *(f"{np.median([own[key][k] for own in placements]):.4g}" for k in _COSTS),
                )
            )
    pairs = {
        "clusters less random donors": ("clusters", "random"),
        f"clusters widened up to {WIDEST:g} less whole bodies": ("widened", "whole"),
    }
    differences = [
        (name, *(format_estimate(_difference(result, *pair), 0, 100) for pair in pairs.values()))
        for name, result in results.items()
    ]
    head = ("removed, %", "changed frames, %", "sigma_scale", "seam gap")
    head += tuple(f"median {name}" for name in _COSTS)
    return {
        "repairs": Table(("source", "donors", "solved", "placements", *head), rows),
        "differences": Table(("source", *pairs), differences),
    }


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
