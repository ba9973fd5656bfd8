"""Random robots and their models as text; a humanoid that walks."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mograft import formats
from mograft.io.robots.poses import Pose, to_motion
from mograft.motion import rotations
from mograft.motion.hinges import TableLayout
from tests.hierarchies import DATA

G1 = DATA / "g1"
G1_MODEL = G1 / "g1_mocap_29dof.xml"


def needs_g1():
    """The mark of tests that need the recordings of the G1."""
    return pytest.mark.skipif(not G1_MODEL.exists(), reason="needs the recordings of the G1")


@dataclass
class Part:
    """A body of a random robot: poses are relative to the parent, quaternions wxyz."""

    name: str
    parent: int
    place: np.ndarray
    quat: np.ndarray
    hinges: list  # of name, axis, anchor, low, high
    mass: float
    center: np.ndarray


def random_robot(seed, n_bodies=6, *, several=True):
    """A random tree of bodies, of which some have no hinge, and some several if `several`."""
    rng = np.random.default_rng(seed)
    parts = []
    for index in range(n_bodies):
        n_hinges = int(rng.integers(3 if several else 2)) if index > 1 else index
        hinges = []
        for k in range(n_hinges):
            low, high = np.sort(rng.uniform(-2.5, 2.5, 2)) + np.array([-0.1, 0.1])
            anchor = rng.uniform(-0.1, 0.1, 3) if several else np.zeros(3)
            hinges.append((f"j{index}{'xyz'[k]}", rng.normal(size=3), anchor, low, high))
        quat = rng.normal(size=4)
        parent = int(rng.integers(index)) if index else -1
        place, center = rng.uniform(-0.5, 0.5, (2, 3))
        mass = float(rng.uniform(0.1, 5.0))
        parts.append(Part(f"b{index}", parent, place, quat, hinges, mass, center))
    return parts


def _text(values):
    return " ".join(f"{value:.17g}" for value in np.atleast_1d(values))


def to_mjcf(parts, *, degrees=False):
    """The model as MJCF; angles may be in degrees, the default of the format."""
    unit = 180 / np.pi if degrees else 1.0

    def body(index):
        own = parts[index]
        lines = [f'<body name="{own.name}" pos="{_text(own.place)}" quat="{_text(own.quat)}">']
        lines += [f'<inertial pos="{_text(own.center)}" mass="{own.mass:.17g}"']
        lines[-1] += ' diaginertia="1 1 1"/>'
        lines += ["<freejoint/>"] if not index else []
        for name, axis, anchor, low, high in own.hinges:
            bounds = _text([unit * low, unit * high])
            lines += [f'<joint name="{name}" axis="{_text(axis)}" pos="{_text(anchor)}"']
            lines[-1] += f' range="{bounds}"/>'
        lines += [body(i) for i, part in enumerate(parts) if part.parent == index]
        return "\n".join([*lines, "</body>"])

    compiler = "" if degrees else '<compiler angle="radian"/>'
    return f"<mujoco>{compiler}<worldbody>\n{body(0)}\n</worldbody></mujoco>\n"


def to_urdf(parts):
    """The model as URDF; each body has one hinge without anchor, or none."""
    lines = ["<robot name='r'>"]
    for part in parts:
        lines += [f'<link name="{part.name}"><inertial><origin xyz="{_text(part.center)}"/>']
        lines[-1] += f'<mass value="{part.mass:.17g}"/></inertial></link>'
    for part in parts[1:]:
        angles = Rotation.from_quat(np.roll(part.quat, -1)).as_euler("xyz")
        name, axis, _, low, high = (*part.hinges, (part.name, [1, 0, 0], 0, 0, 0))[0]
        kind = "revolute" if part.hinges else "fixed"
        lines += [
            f'<joint name="{name}" type="{kind}"><parent link="{parts[part.parent].name}"/>',
            f'<child link="{part.name}"/><axis xyz="{_text(axis)}"/>',
            f'<origin xyz="{_text(part.place)}" rpy="{_text(angles)}"/>',
            f'<limit lower="{low:.17g}" upper="{high:.17g}" velocity="7"/></joint>',
        ]
    return "\n".join([*lines, "</robot>"])


def smooth_angles(hinges, rng, n_frames, share=0.8):
    """Angles that swing within a share of the limits, (n_frames, n_hinges)."""
    time = np.arange(n_frames)[:, None]
    pace, phase = rng.uniform(0.02, 0.2, len(hinges.names)), rng.uniform(0, 6, len(hinges.names))
    low, high = hinges.limits.T
    return 0.5 * (low + high) + 0.5 * share * (high - low) * np.sin(pace * time + phase)


_LIMBS = {
    "hip_pitch": ("pelvis", "0 {y:.2f} -0.1", "0 1 0", "-1.5 1.5"),
    "hip_roll": ("hip_pitch", "0 0 -0.02", "1 0 0.1", "-0.5 0.5"),
    "knee": ("hip_roll", "0 0 -0.35", "0 1 0", "-0.1 2.5"),
    "ankle_pitch": ("knee", "0 0 -0.35", "0 1 0", "-0.9 0.6"),
    "ankle_roll": ("ankle_pitch", "0.02 0 -0.02", "1 0 0", "-0.3 0.3"),
    "shoulder_pitch": ("torso", "0 {y2:.2f} 0.3", "0 1 0", "-3 2"),
    "shoulder_roll": ("shoulder_pitch", "0 0 -0.02", "1 0 0.1", "-2 2"),
    "elbow": ("shoulder_roll", "0 0 -0.25", "0 1 0", "-2 0.5"),
    "wrist_yaw": ("elbow", "0 0 -0.22", "0 0 1", "-1.5 1.5"),
}
_TRUNK = {
    "waist_yaw": ("pelvis", "0 0 0.05", "0 0 1", "-1.5 1.5"),
    "waist_roll": ("waist_yaw", "0 0 0.02", "1 0 0", "-0.5 0.5"),
    "torso": ("waist_roll", "0 0 0.02", "0 1 0", "-0.5 0.5"),
}


def humanoid_text():
    """A small humanoid in MJCF, with joint groups that presets recognize."""
    bodies = dict(_TRUNK)
    for side, y in (("left", 0.1), ("right", -0.1)):
        for name, (above, place, axis, bounds) in _LIMBS.items():
            parent = f"{side}_{above}" if above in _LIMBS else above
            bodies[f"{side}_{name}"] = parent, place.format(y=y, y2=1.6 * y), axis, bounds

    def body(name):
        _, place, axis, bounds = bodies.get(name, ("", "0 0 0", "", ""))
        hinge = f'<joint name="{name}_joint" axis="{axis}" range="{bounds}"/>' if axis else ""
        head = '<body name="head_link" pos="0 0 0.4"/>' if name == "torso" else ""
        toe = f'<body name="{name.split("_")[0]}_toe_link" pos="0.12 0 -0.02"/>'
        inside = "".join(body(own) for own, (above, *_) in bodies.items() if above == name)
        mass = '<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>'
        link = f'<body name="{name}_link" pos="{place}">' if axis else '<body name="pelvis">'
        free = "" if axis else "<freejoint/>"
        toe = toe if name.endswith("ankle_roll") else ""
        return f"{link}{mass}{free}{hinge}{head}{toe}{inside}</body>"

    compiler = '<compiler angle="radian"/>'
    return f"<mujoco>{compiler}<worldbody>{body('pelvis')}</worldbody></mujoco>"


def standing_pose(model, quats, angles):
    """Return poses with these rotations and angles whose lowest point stays where it is."""
    pose = Pose(np.zeros((len(quats), 3)), quats, angles)
    places = to_motion(model, pose, TableLayout()).world_positions()
    lowest = places[..., 2].argmin(axis=1)[:-1]
    steps = np.diff(places, axis=0)[np.arange(len(lowest)), lowest]
    root = np.vstack([np.zeros(3), -np.cumsum(steps, axis=0)])
    root[:, 2] = -places[..., 2].min(axis=1)
    return Pose(root, quats, angles)


def write_walks(folder, n_clips=2, n_frames=240):
    """Write the humanoid and walks of it; return the model file and the tables."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "humanoid.xml"
    path.write_text(humanoid_text())
    model = formats.read_model(path)
    names = model.hinges.names
    files = []
    for clip in range(n_clips):
        rng = np.random.default_rng(clip)
        time = np.arange(n_frames) / 30.0
        step = 2 * np.pi * (0.9 + 0.02 * clip) * time
        sway = np.interp(time, np.arange(0, 10), rng.uniform(-1, 1, 10))
        angles = np.zeros((n_frames, len(names)))
        for column, name in enumerate(names):
            side = -1 if name.startswith("right") else 1
            kinds = {
                "hip_pitch": -0.4 * side * np.sin(step),
                "knee": 0.5 - 0.4 * side * np.cos(step),
                "ankle_pitch": -0.2 + 0.1 * np.sin(step),
                "shoulder_pitch": (0.8 + 0.4 * clip) * (side * 0.5 * np.sin(step) + 0.4 * sway),
                "shoulder_roll": side * (0.6 + 0.1 * sway),
                "elbow": -0.8 + 0.3 * np.sin(step + sway),
                "waist_yaw": 0.15 * np.sin(step) + 0.1 * sway,
                "torso": 0.1 + 0.05 * np.cos(2 * step),
            }
            stem = name.removesuffix("_joint").removeprefix("left_").removeprefix("right_")
            angles[:, column] = kinds.get(stem, 0.05 * sway)
        turn = rotations.from_axis_angle([0, 0, 1], 1.0 + 0.1 * time)
        lean = rotations.from_axis_angle([0.3, 1, 0], 0.05 * np.sin(2 * step))
        quats = rotations.multiply(turn, lean)
        root = standing_pose(model, quats, angles).positions
        weights = np.hanning(17)[1:-1] / np.hanning(17).sum()
        padded = np.pad(root, ((7, 7), (0, 0)), mode="reflect", reflect_type="odd")
        root = np.stack([np.convolve(own, weights, mode="valid") for own in padded.T], axis=1)
        pose = Pose(root, quats, angles)
        files.append(folder / f"walk{clip}.csv")
        layout = TableLayout("wxyz", numbers=".6f")
        formats.write_table(to_motion(model, pose, layout), files[-1])
    return path, files
