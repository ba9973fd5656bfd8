"""An independent reader of GLB files, and the comparison of positions up to a rotation."""

import json
import struct
from pathlib import Path

import numpy as np

COMPONENTS = {5126: "<f4", 5121: "u1", 5123: "<u2"}


WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    """A GLB file, parsed according to the specification, without code of the package."""

    def __init__(self, path):
        data = Path(path).read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        self.document = json.loads(data[20 : 20 + size].decode("utf-8"))
        rest, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0"
        assert 28 + size + rest == len(data)
        self.binary = data[28 + size :]

    def array(self, index):
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width = WIDTHS[accessor["type"]]
        raw = np.frombuffer(
            self.binary,
            COMPONENTS[accessor["componentType"]],
            accessor["count"] * width,
            view["byteOffset"],
        )
        return raw.astype(float).reshape(accessor["count"], width)

    def keys(self, animation, node, path, frame):
        for channel in animation["channels"]:
            if channel["target"] == {"node": node, "path": path}:
                sampler = animation["samplers"][channel["sampler"]]
                values = self.array(sampler["output"])
                assert len(values) == len(self.array(sampler["input"]))
                return values[min(frame, len(values) - 1)]
        rest = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1]}
        return np.array(self.document["nodes"][node].get(path, rest[path]), float)

    def matrices(self, animation, frame):
        """Return the world matrices of all nodes in a frame."""
        nodes = self.document["nodes"]
        world = {}

        def visit(node, parent):
            local = np.eye(4)
            local[:3, :3] = to_matrix(self.keys(animation, node, "rotation", frame))
            local[:3, 3] = self.keys(animation, node, "translation", frame)
            world[node] = parent @ local
            for child in nodes[node].get("children", []):
                visit(child, world[node])

        for root in self.document["scenes"][0]["nodes"]:
            visit(root, np.eye(4))
        return world

    def skin_vertices(self, animation, frame):
        """Return the skinned vertices of the mesh in a frame, and the joint of each."""
        skin = self.document["skins"][0]
        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        world = self.matrices(animation, frame)
        transforms = np.array([world[j] for j in skin["joints"]]) @ inverse
        attributes = self.document["meshes"][0]["primitives"][0]["attributes"]
        joints = self.array(attributes["JOINTS_0"])[:, 0].astype(int)
        vertices = self.array(attributes["POSITION"])
        homogeneous = np.concatenate([vertices, np.ones((len(vertices), 1))], axis=1)
        return np.einsum("vij,vj->vi", transforms[joints], homogeneous)[:, :3], joints


def to_matrix(quat):
    x, y, z, w = quat
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def assert_equal_up_to_rotation(actual, expected, atol):
    """Assert that positions are equal up to one rotation about the origin."""
    flat = [positions.reshape(-1, 3) for positions in (actual, expected)]
    left, _, right = np.linalg.svd(flat[0].T @ flat[1])
    rotation = left @ right
    # A reflection is not a rotation.
    if np.linalg.det(rotation) < 0:
        rotation = left @ np.diag([1, 1, -1]) @ right
    np.testing.assert_allclose(flat[0], flat[1] @ rotation.T, atol=atol)
