"""How detectable motions are against how new they are: curves of several methods.

Every method keeps the legs of a clip and makes its upper body anew; each has a parameter that
changes how much. Newness: mean angle of the upper body's joints to the base, in degrees, over all
frames. AUC: as in `seam_tests`, but of all windows whose central pose differs from the base by over
a degree, against the captured windows at the same frames: a method does not gain by changing
little. Fréchet distance: of the embedded windows in one half of the blocks from captured windows in
the other. At most 12 clips of each source.

The comparison is at the newness of the default: the curve of a method is interpolated linearly
between its two settings on either side. Methods that reach it with no setting, or that have only
one, have no value. Motion graphs are left out: they make new legs, whose frames have no base.
"""

import warnings
from dataclasses import replace

import numpy as np

import mograft as mg
from lab.baselines import body_mixing, catalogue
from lab.donors.methods import Nearest
from lab.experiments.sources import SEVERAL
from lab.experiments.sources import SOURCES as ALL_SOURCES
from lab.experiments.tables import Table, format_estimate
from lab.measures import generated_sets, two_sets
from mograft import rotations
from mograft.evaluation import RandomLength, grafts_by

NAME = "tradeoff"
SOURCES = SEVERAL
MAX_CLIPS = 12
N_RUNS = 2
MIN_BLOCKS = 10
MIN_CHANGE = np.radians(1.0)
DEFAULT = ("balls", mg.Config().sigma_scale)
SCALES = (0.25, 0.5, 0.75, 1.0, 1.5)
QUICK_SETTINGS = (("balls", 0.75), ("mirror", 1.0), ("noise", 2.0), ("noise", 16.0))


def settings():
    """Return the methods and their settings, and how each makes the motions of a clip."""
    found = {("balls", scale): _graft(sigma_scale=scale) for scale in SCALES}
    found |= {
        ("clusters", scale): _graft(sigma_scale=scale, neighbourhood="cluster") for scale in SCALES
    }
    found |= {
        ("nearest", count): _rule(Nearest(count=count, uses_cost=True)) for count in (2, 8, 32)
    }
    found["random donors", 1.0] = _rule(RandomLength(has_seam_limit=False))
    found |= {
        ("random, by cost", novelty): _rule(
            RandomLength(uses_cost=True, config_changes=(("novelty", novelty),))
        )
        for novelty in (1.0, 10.0, 40.0, 160.0)
    }
    found |= {
        (name, 1.0): _generator(name) for name in ("CutMix", "motion matching", "GenMM, upper body")
    }
    found["mirror", 1.0] = _mirror
    return found | {("noise", degrees): _noise(degrees) for degrees in (2.0, 8.0, 16.0)}


def _graft(**changes):
    def make(studio, clip):
        library = studio.library.relabelled(replace(studio.library.config, **changes))
        return [own.motion for own in mg.graft_many(library, studio.name(clip), N_RUNS, seed=0)]

    return make


def _rule(method):
    def make(studio, clip):
        found = grafts_by(method, studio.library, studio.name(clip), N_RUNS, seed=0)
        return [own.motion for own in found]

    return make


def _generator(name):
    generator = next(own for own in catalogue.GENERATORS if own.name == name)
    return lambda studio, clip: studio.make(generator, clip, N_RUNS)[0]


def _mirror(studio, clip):
    """Return the legs of a clip with the upper body of its mirror image, at the same frames."""
    base = studio.library.clips[clip]
    turns = base.rotations.copy()
    turns[:, studio.joints] = mg.mirror(base).rotations[:, studio.joints]
    return [replace(base, rotations=turns, channel_values=None)]


def _noise(degrees):
    def make(studio, clip):
        base, rng = studio.library.clips[clip], np.random.default_rng(clip)
        return [body_mixing.add_noise(base, degrees, rng, studio.joints) for _ in range(N_RUNS)]

    return make


def measure(recordings, *, is_quick):
    """Return newness, AUC and Fréchet distance of a source by method and setting."""
    step = max(-(-len(recordings.motions) // MAX_CLIPS), 1)
    recordings = type(recordings)(recordings.name, recordings.motions[::step])
    studio = catalogue.Studio(recordings.library, recordings)
    reference = generated_sets.Reference(studio.library)
    if reference.n_blocks < MIN_BLOCKS:
        raise mg.InsufficientDataError(
            f"{MIN_BLOCKS} blocks of five seconds are needed, but there are {reference.n_blocks}"
        )
    found = []
    for (method, setting), make in settings().items():
        if is_quick and (method, setting) not in QUICK_SETTINGS:
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made = [make(studio, clip) for clip in range(len(reference.clips))]
        except ValueError as error:
            found.append({"method": method, "setting": setting, "refused": str(error)})
            continue
        runs = [[several[run % len(several)] for several in made] for run in range(N_RUNS)]
        found.append({"method": method, "setting": setting, **_measure(studio, reference, runs)})
    return found


def _measure(studio, reference, runs):
    angles = [
        [
            rotations.angle(motion.rotations[:, studio.joints], clip.rotations[:, studio.joints])
            for motion, clip in zip(run, reference.clips, strict=True)
        ]
        for run in runs
    ]
    changed = [[own.mean(axis=1) > MIN_CHANGE for own in run] for run in angles]
    generated = [
        two_sets.read_windows(run, reference.blocks, own)
        for run, own in zip(runs, changed, strict=True)
    ]
    anywhere = [np.any(own, axis=0) for own in zip(*changed, strict=True)]
    captured = two_sets.read_windows(reference.clips, reference.blocks, anywhere)
    generated = [own for own in generated if own is not None]
    auc = generated_sets.NO_DETECTION
    if generated and captured is not None:
        windows = two_sets.WindowSet.concatenate(generated)
        assigned = two_sets.assign_blocks(windows, captured)
        auc = generated_sets.detection([(captured, assigned)], reference.n_blocks)
    return {
        "newness": float(np.degrees(np.mean([own.mean() for run in angles for own in run]))),
        "changed": float(np.mean([own.mean() for run in changed for own in run])),
        "frechet": generated_sets.embedding_measures(reference, runs)["frechet"].as_dict(),
        **{name: own.as_dict() for name, own in auc.items()},
    }


def tables(results):
    """All settings of all sources, and the curves at the same newness."""
    rows = [
        (
            source,
            own["method"],
            f"{own['setting']:g}",
            f"{own['newness']:.2f}",
            f"{100 * own['changed']:.0f}",
            *(format_estimate(own[key], 2, has_n=False) for key in ("gross", "fine")),
            format_estimate(own["frechet"], 1, has_n=False),
        )
        for source, found in results.items()
        for own in found
        if "refused" not in own
    ]
    head = ("source", "method", "setting", "newness, degrees", "changed frames, %")
    head = (*head, "AUC, gross", "AUC, fine", "Fréchet distance")
    return {"settings": Table(head, rows), "matched": _matched(results)}


def _matched(results):
    """Return AUC and Fréchet distance of each method at the newness of the default, by source."""
    methods = dict.fromkeys(method for method, _ in settings())
    rows = []
    for source, found in results.items():
        by_setting = {(own["method"], own["setting"]): own for own in found}
        if "newness" not in by_setting.get(DEFAULT, {}):
            continue
        newness = by_setting[DEFAULT]["newness"]
        for method in methods:
            own = [row for row in found if row["method"] == method and "refused" not in row]
            cells = [at_newness(own, key, newness) for key in ("gross", "fine", "frechet")]
            if None not in cells:
                text = [f"{cell:.{n}f}" for cell, n in zip(cells, (2, 2, 1), strict=True)]
                rows.append((source, ALL_SOURCES[source].use, f"{newness:.1f}", method, *text))
    head = ("source", "use", "newness, degrees", "method")
    return Table((*head, "AUC, gross", "AUC, fine", "Fréchet distance"), rows)


def at_newness(rows, key, newness):
    """Return the value of a curve at a newness, or None if no two settings are around it."""
    known = [own for own in rows if own[key]["value"] is not None]
    points = sorted((own["newness"], own[key]["value"]) for own in known)
    x, y = ([own[axis] for own in points] for axis in (0, 1))
    if len(points) < 2 or not x[0] <= newness <= x[-1]:
        return None
    return float(np.interp(newness, x, y))
