"""Reading and writing of BVH files in the standard layout."""

import numpy as np
from scipy.spatial.transform import Rotation


def read_bvh(path):
    """Return names, parents, offsets, channels per joint, frame time and channel values."""
    names, parents, offsets, channels, stack = [], [], [], [], []
    with open(path) as file:
        for line in file:
            words = line.split()
            if not words:
                continue
            if words[0] in ("ROOT", "JOINT"):
                parents.append(stack[-1] if stack else -1)
                names.append(" ".join(words[1:]))
                stack.append(len(names) - 1)
            elif words[0] == "End":
                stack.append(None)
            elif words[0] == "OFFSET" and stack[-1] is not None:
                offsets.append([float(word) for word in words[1:]])
            elif words[0] == "CHANNELS":
                channels.append(words[2:])
            elif words[0] == "}":
                stack.pop()
            elif words[0] == "Frames:":
                n_frames = int(words[1])
            elif words[:2] == ["Frame", "Time:"]:
                frame_time = float(words[2])
                break
        values = np.loadtxt(file, ndmin=2)
    assert len(values) == n_frames
    return names, np.array(parents), np.array(offsets), channels, frame_time, values


def write_bvh(path, header, values):
    """Write a header and one line of channel values per frame."""
    with open(path, "w") as file:
        file.write(header)
        for row in values:
            file.write(" ".join(repr(float(value)) for value in row) + "\n")


def to_transforms(channels, offsets, values):
    """Return the local rotations (F, J, 4) and positions (F, J, 3) of channel values."""
    rotations, positions = [], []
    column = 0
    for names, offset in zip(channels, offsets, strict=True):
        block = dict(zip(names, values[:, column : column + len(names)].T, strict=True))
        column += len(names)
        order = "".join(name[0] for name in names if name.endswith("rotation"))
        angles = np.stack([block[axis + "rotation"] for axis in order], axis=1)
        rotations.append(Rotation.from_euler(order, angles, degrees=True).as_quat())
        position = np.tile(offset, (len(values), 1))
        for axis, letter in enumerate("XYZ"):
            if letter + "position" in block:
                position[:, axis] = block[letter + "position"]
        positions.append(position)
    return np.stack(rotations, axis=1), np.stack(positions, axis=1)
