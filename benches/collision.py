"""Experiment 5.2: repair a dance that collides with a copy of itself.

Run as ``python benches/collision.py FILE.bvh... [-o FOLDER]``; without files it uses the
procedural dancer. The copy is translated, with the same heading or the opposite one, to the
position at which its arms collide in the most frames and the rest of its body in none. The bench
prints the collisions before and after the repair, the share of changed segments and the
milliseconds; with ``-o`` it draws both motions at the worst collisions before and after.
"""

import argparse
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
import mograft.constraints as mc
from benches import _common
from mograft._util.runs import find_runs
from mograft.body.anatomy import anatomy
from mograft.solve.search_problem import SearchProblem

RATE = 30.0
DISTANCES = np.arange(0.25, 1.0, 0.05)
DIRECTIONS = np.radians(np.arange(0, 360, 30))


def copies(motion, poses, step=1, directions=DIRECTIONS):
    """Yield characters at all distances and in all directions, with either heading."""
    level = [axis for axis in range(3) if axis != poses.up]
    for yaw in (0.0, np.pi):
        # The rotation is about the origin: move the mean position back to that of the original.
        mean = poses.positions[:, 0].mean(axis=0)
        home = mean - (mean if yaw == 0 else half_turn(mean, poses.up))
        for distance in DISTANCES[::step]:
            for angle in directions[::step]:
                offset = home.copy()
                offset[level] += distance * poses.height * np.array([np.cos(angle), np.sin(angle)])
                yield (
                    mc.Character(motion, tuple(offset), yaw),
                    distance,
                    np.degrees([angle, yaw]),
                )


def half_turn(position, up):
    turned = -position
    turned[up] = position[up]
    return turned


def worst_collision(motion, problem, step=1):
    """Return the copy that collides with the arms in the most frames, and with nothing else."""
    poses = problem.base_poses
    # Grafted arms do not move the trunk and the head, so these must not collide at all.
    arms = anatomy(motion.skeleton).joints("upper_arm", "forearm", "hand", "finger")
    grafted = np.isin(np.arange(motion.n_joints), arms)
    every = slice(None, None, max(motion.n_frames // 400, 2))
    sparse = poses.with_poses(poses.frames[every], poses.rotations[every], poses.positions[every])
    found = []
    for other, distance, angles in copies(motion, poses, step):
        avoid = mc.Avoid(other)
        if (avoid.errors(sparse, ~grafted)[0] > 1).any():
            continue
        count = int((avoid.errors(sparse, grafted)[0] > 1).sum())
        if count:
            found.append((count, other, distance, angles))
    for candidate in sorted(found, key=lambda candidate: -candidate[0]):
        if not (mc.Avoid(candidate[1]).errors(poses, ~grafted)[0] > 1).any():
            return candidate
    return None


def strip(path, base, graft, other, frames, body):
    """Draw both motions at some frames, before and after."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    poses = mg.Poses.from_motion(base)
    level = [axis for axis in range(3) if axis != poses.up]
    away = np.array(other.offset)[level] if np.any(np.array(other.offset)[level]) else [1.0, 0.0]
    across = np.array(away) / np.linalg.norm(away)
    figure, axes = plt.subplots(2, len(frames), figsize=(3.2 * len(frames), 7), squeeze=False)
    theirs, radii = other._capsule_ends_and_radii
    for row, (name, motion) in enumerate((("before", base), ("after", graft.motion))):
        figure_poses = mg.Poses.from_motion(motion)
        error, joint = mc.Avoid(other).errors(figure_poses)
        for axis, frame in zip(axes[row], frames, strict=True):
            for ends, widths, color in (
                (figure_poses.ends[frame], body.radii, "tab:blue"),
                (theirs[frame], radii, "tab:gray"),
            ):
                for capsule, radius in zip(ends, widths, strict=True):
                    x, y = capsule[:, level] @ across, capsule[:, poses.up]
                    hit = color == "tab:blue" and error[frame] > 1
                    at = body.joints[int(np.argmin(np.abs(ends[:, 0] - capsule[0]).sum(axis=1)))]
                    shade = "tab:red" if hit and at == joint[frame] else color
                    axis.plot(
                        x,
                        y,
                        color=shade,
                        linewidth=max(radius / poses.height * 130, 1),
                        solid_capstyle="round",
                        alpha=0.6,
                    )
            depth = error[frame] * 0.005
            axis.set_title(f"{name}, frame {frame}: {depth:.3f} heights", fontsize=9)
            axis.set_aspect("equal")
            axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=70)
    plt.close(figure)


@dataclass(frozen=True)
class Trial:
    """A motion, the copy that it collides with, and the repaired motion."""

    motion: mg.Motion
    library: mg.Library
    avoid: mc.Avoid
    where: str
    graft: mg.Graft
    before: np.ndarray
    after: np.ndarray

    @classmethod
    def run(cls, motion, step=1):
        library = mg.Library.build(motion)
        scenario = library.segments.of_clip(0)
        segments = library.segments[scenario]
        problem = SearchProblem.build(library, motion, scenario, segments, ["upper"], [])
        found = worst_collision(motion, problem, step)
        if found is None:
            return None
        _, other, distance, (angle, yaw) = found
        where = f"{distance:.2f} heights away at {angle:.0f}°, heading turned by {yaw:.0f}°"
        avoid = mc.Avoid(other)
        graft = mg.repair(library, constraints=[avoid])
        before, after = (
            avoid.errors(mg.Poses.from_motion(each))[0] for each in (motion, graft.motion)
        )
        return cls(motion, library, avoid, where, graft, before, after)

    def draw(self, path):
        """Draw the frames of the worst collisions, before and after."""
        runs = sorted(
            find_runs(self.before > 1).tolist(),
            key=lambda run: -self.before[run[0] : run[1]].max(),
        )
        frames = sorted(run[0] + int(self.before[run[0] : run[1]].argmax()) for run in runs[:4])
        body = mg.Poses.from_motion(self.motion).capsules
        strip(path, self.motion, self.graft, self.avoid.obstacle, frames, body)


def run(motion, folder, step=1):
    trial = Trial.run(motion, step)
    if trial is None:
        print(f"{motion.name}: no position at which only the arms collide")
        return True
    times = []
    for _ in range(3):
        start = time.perf_counter()
        mg.repair(trial.library, constraints=[trial.avoid])
        times.append(time.perf_counter() - start)
    graft, n = trial.graft, len(trial.graft.substitutions)
    changed = sum(not s.is_own for s in graft.substitutions)
    share = (graft.motion.rotations != motion.rotations).any(axis=(1, 2)).mean()
    print(f"{motion.name}: {motion.n_frames} frames, {n} segments; copy at {trial.where}")
    for name, error in (("before", trial.before), ("after", trial.after)):
        deepest = error.max() * trial.avoid.tolerance
        print(f"  {name}: {(error > 1).sum()} frames collide, {deepest:.4f} heights deep")
    print(
        f"  changed: {changed} of {n} segments ({changed / n:.1%}), {share:.1%} of frames, "
        f"at sigma_scale {graft.library.config.sigma_scale:.2f}; "
        f"{statistics.median(times) * 1e3:.0f} ms",
        flush=True,
    )
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        trial.draw(folder / f"{motion.name}.png")
    return trial.after.max() <= 1.0


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*")
    parser.add_argument("-o", "--output", type=Path)
    return _common.run(parser, report, argv)


def report(options):
    if options.tiny:
        with tempfile.TemporaryDirectory() as folder:
            run(_common.tiny_motion(n_frames=150), Path(folder), step=3)
        return 0
    if options.files:
        motions = [mg.read_bvh(path) for path in options.files]
    else:
        from mograft.dancer import dance

        motions = [dance(seed=1, strides=3).motion]
    motions = [m.resample(RATE) if m.rate > RATE + 5 else m for m in motions]
    results = [run(motion, options.output) for motion in motions]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
