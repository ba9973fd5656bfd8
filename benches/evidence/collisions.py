"""Experiment 5.2 of the paper: exchange of colliding segments, with random donors beside it."""

from dataclasses import replace

import numpy as np

import mograft as mg
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
WIDEST = 4.0


def measure(recordings, *, is_quick):
    """Collisions before and after the repair of one clip, at several placements of a copy."""
    clip = max(recordings.motions, key=lambda motion: motion.n_frames)[:MAX_FRAMES]
    library = mg.Library.build(clip)
    scale = library.config.sigma_scale
    shuffled = _shuffle_clusters(library)
    rows = []
    count, step = (2, 4) if is_quick else (N_PLACEMENTS, 1)
    for placed in _placements(clip, count, step):
        avoid = mg.Avoid(placed)
        before = int((avoid.errors(mg.Poses.from_motion(clip))[0] > 1).sum())
        row = {"before": before}
        for name, own, widest in (
            ("clusters", library, scale),
            ("random", shuffled, scale),
            ("widened", library, WIDEST),
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
    for other, _, _ in copies(clip, poses, step):
        avoid = mg.Avoid(other)
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
                    f"{min(scales):.2f} to {max(scales):.2f}",
                    format_estimate(_mean(gaps), 1, has_n=False) if gaps else "-",
                )
            )
    return Section(
        anchor=NAME,
        title="Experiment 5.2: does an exchange of segments remove collisions?",
        question="Two figures dance side by side and their arms collide. The paper exchanges the "
        "colliding segments. How many collisions does this remove, and do similar legs help?",
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
        "what any exchange removes.",
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
                ("source", "removed, default clusters less random donors, points"),
                tuple(
                    (name, format_estimate(_difference(result), 0, 100))
                    for name, result in results.items()
                ),
                "Difference of the removed shares, paired by placement.",
            ),
        ),
        conclusions=_conclusions(results, removed),
        limits=(
            "That the donors of wide clusters suit the legs: where `sigma_scale` is large, any "
            "segment of similar length is a donor.",
            "That a repair which also replaces the legs would remove as many or as few: it was not "
            "measured.",
            "That clusters without similar legs would remove as many as clusters widened up to "
            f"{WIDEST:g}: random members were measured for the default sizes only.",
        ),
    )


def _mean(values):
    return estimate.block_mean(values, range(len(values)), "placements").as_dict()


def _difference(result):
    """Return the share removed with clusters less that removed with random donors."""
    return _mean(
        [
            (own["random"]["after"] - own["clusters"]["after"]) / own["before"]
            for own in result["rows"]
            if own["before"]
        ]
    )


def _similar_legs_conclusion(results):
    """Return in which sources clusters remove more or less than random donors."""
    found = {name: verdict(_difference(result)) for name, result in results.items()}
    cells = []
    for word, title in (("above", "more"), ("below", "fewer"), ("undecided", "undecided")):
        names = [name for name, own in found.items() if own == word]
        cells.append(f"{title} in {count_names(names)}")
    return (
        "Do similar legs help? The colliding frames that default clusters remove, compared with "
        "random "
        f"donors in clusters of the same sizes: {', '.join(cells)} of {len(found)} sources."
    )


def _conclusions(results, removed):
    lines = [_similar_legs_conclusion(results)] if results else []
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
