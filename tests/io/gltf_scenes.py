"""Random scenes as glTF files, and their slow evaluation; the vertices of skinned meshes."""

import base64
import json
import struct
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from mograft.io.gltf.container import read_accessor
from mograft.io.rest_pose import restore
from mograft.motion import rotations

_PATHS = ("translation", "rotation", "scale")
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_COMPONENTS = {"<f4": 5126, "i1": 5120, "u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125}


@dataclass
class Track:
    """One animated property of a node, as stored: single precision or integers."""

    node: int
    path: str
    interpolation: str
    times: np.ndarray
    values: np.ndarray  # shape (n_keys or 3 * n_keys, width), float64 of the stored numbers
    component: str = "<f4"

    def at(self, time):
        """Return the value at a time, by the formulas of the specification."""
        times, cubic = self.times, self.interpolation == "CUBICSPLINE"
        keys = self.values[1::3] if cubic else self.values
        k = max(0, int(np.searchsorted(times, time + 1e-9, side="right")) - 1)
        if self.interpolation == "STEP" or time <= times[0] or k == len(times) - 1:
            return keys[k]
        gap = times[k + 1] - times[k]
        u = min(max((time - times[k]) / gap, 0.0), 1.0)
        start, end = keys[k], keys[k + 1]
        if cubic:
            tangents = gap * self.values[3 * k + 2], gap * self.values[3 * k + 3]
            return CubicHermiteSpline([0.0, 1.0], [start, end], tangents)(u)
        if self.path == "rotation":
            return Slerp([0.0, 1.0], Rotation.from_quat([start, end]))(u).as_quat()
        return start + u * (end - start)


@dataclass
class Scene:
    """A node tree with one animation."""

    parents: list
    translations: np.ndarray
    rotations: np.ndarray
    scales: np.ndarray
    tracks: list
    skin: list | None = None  # nodes
    matrices: set = field(default_factory=set)  # nodes that are written with a matrix

    def local(self, node, time):
        """Return the local matrix of a node at a time; with None, its default."""
        arrays = (self.translations, self.rotations, self.scales)
        values = dict(zip(_PATHS, (array[node] for array in arrays), strict=True))
        for track in self.tracks:
            if track.node == node and time is not None:
                values[track.path] = track.at(time)
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(values["rotation"]).as_matrix() * values["scale"]
        matrix[:3, 3] = values["translation"]
        return matrix

    def world_matrix(self, node, time):
        """Return the world matrix of a node at a time; with None, without animation."""
        matrix = np.eye(4)
        while node >= 0:
            matrix = self.local(node, time) @ matrix
            node = self.parents[node]
        return matrix

    def document(self, rng=None):
        """Return the JSON document and the buffer; `rng` chooses strides and sparse accessors."""
        builder = Builder(rng)
        nodes = []
        for index, parent in enumerate(self.parents):
            node = {"name": f"n{index}"}
            if index in self.matrices:
                node["matrix"] = self.local(index, None).T.ravel().tolist()
            else:
                arrays = zip(_PATHS, (self.translations, self.rotations, self.scales), strict=True)
                node |= {path: array[index].tolist() for path, array in arrays}
            nodes.append(node)
            if parent >= 0:
                nodes[parent].setdefault("children", []).append(index)
        samplers, channels = [], []
        for track in self.tracks:
            times = builder.add(track.times[:, None], "<f4", may_vary=False)
            values = builder.add(track.values, track.component)
            kind = track.interpolation
            samplers.append({"input": times, "output": values, "interpolation": kind})
            target = {"node": track.node, "path": track.path}
            channels.append({"sampler": len(samplers) - 1, "target": target})
        document = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [i for i, p in enumerate(self.parents) if p < 0]}],
            "nodes": nodes,
            "animations": [{"name": "move", "samplers": samplers, "channels": channels}],
            "accessors": builder.accessors,
            "bufferViews": builder.views,
            "buffers": [{"byteLength": len(builder.data)}],
        }
        if self.skin is not None:
            document["skins"] = [{"joints": self.skin}]
        return document, bytes(builder.data)


class Builder:
    """A buffer with its views and accessors."""

    def __init__(self, rng):
        self.rng, self.data, self.views, self.accessors = rng, bytearray(), [], []

    def _view(self, data, **fields):
        self.data += b"\0" * (-len(self.data) % 4)
        place = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(place | fields)
        self.data += data
        return len(self.views) - 1

    def _sparse(self, rows, stored, index_type):
        view = self._view(rows.astype(index_type).tobytes())
        indices = {"bufferView": view, "componentType": _COMPONENTS[str(index_type)]}
        values = {"bufferView": self._view(stored[rows].tobytes())}
        return {"count": len(rows), "indices": indices, "values": values}

    def add(self, values, component, *, may_vary=True):
        """Add an accessor of stored values, at random sparse, strided, or with an offset."""
        dtype = np.dtype(component)
        stored = values
        accessor = {"componentType": _COMPONENTS[component], "count": len(values)}
        accessor["type"] = _TYPES[values.shape[1]]
        if dtype.kind != "f":
            accessor["normalized"] = True
            stored = np.round(values * np.iinfo(dtype).max)
        stored = np.ascontiguousarray(stored.astype(dtype))
        way = self.rng.integers(4) if may_vary and self.rng is not None else 0
        if way == 1:  # interleaved with other data, after an offset
            row = stored.dtype.itemsize * stored.shape[1]
            stride = row + -row % 4 + 4
            rows = np.zeros((len(stored), stride), np.uint8)
            rows[:, :row] = stored.view(np.uint8).reshape(len(stored), row)
            accessor["byteOffset"] = 8
            data = b"\1" * 8 + rows.tobytes()
            accessor["bufferView"] = self._view(data, byteStride=stride)
        elif way == 2:  # some elements are sparse; without a buffer view, the others are zero
            rows = np.flatnonzero((stored != 0).any(axis=1))
            rows = rows if len(rows) else np.array([0])
            accessor["sparse"] = self._sparse(rows, stored, self.rng.choice(["u1", "<u2", "<u4"]))
        elif way == 3:  # one element is replaced
            damaged = stored.copy()
            damaged[-1] = 0
            accessor["bufferView"] = self._view(damaged.tobytes())
            accessor["sparse"] = self._sparse(np.array([len(stored) - 1]), stored, "u1")
        else:
            accessor["bufferView"] = self._view(stored.tobytes())
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def random_scene(rng, *, scale, has_skin):
    """Return a random scene. `scale` is "none", "uniform", "mirrored" or "any"."""
    n_nodes = int(rng.integers(2, 8))
    parents = [-1, *(int(rng.integers(node)) for node in range(1, n_nodes))]
    turned = rng.normal(size=(n_nodes, 4))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)

    def scales(count):
        if scale == "none":
            return np.ones((count, 3))
        if scale in ("uniform", "mirrored"):
            sizes = np.repeat(rng.uniform(0.5, 2.0, (count, 1)), 3, axis=1)
            return -sizes if scale == "mirrored" else sizes
        return rng.uniform(0.5, 2.0, (count, 3)) * rng.choice([-1.0, 1.0], (count, 3))

    tracks = []
    for node in range(n_nodes):
        for path in _PATHS:
            if rng.random() < 0.5 and not (path == "scale" and scale == "none"):
                tracks.append(_random_track(rng, node, path, scales))
    if not tracks:
        tracks.append(_random_track(rng, 0, "rotation", scales))
    moved = {track.node for track in tracks}
    still = [node for node in range(n_nodes) if node not in moved]
    skin = sorted(rng.choice(n_nodes, int(rng.integers(1, n_nodes + 1)), replace=False).tolist())
    places, sizes = rng.uniform(-2, 2, (n_nodes, 3)), scales(n_nodes)
    matrices = {node for node in still if rng.random() < 0.3}
    return Scene(parents, places, turned, sizes, tracks, skin if has_skin else None, matrices)


def _random_track(rng, node, path, scales):
    interpolation = str(rng.choice(["STEP", "LINEAR", "CUBICSPLINE"]))
    n_keys = int(rng.integers(1, 6))
    # Multiples of 1/16 s are exact in single precision.
    times = np.sort(rng.choice(64, n_keys, replace=False)) / 16
    n_values = 3 * n_keys if interpolation == "CUBICSPLINE" else n_keys
    component = "<f4"
    if path == "translation":
        values = rng.uniform(-2, 2, (n_values, 3))
    elif path == "scale":
        values = scales(n_values)
    else:
        values = rng.normal(size=(n_values, 4))
        values /= np.linalg.norm(values, axis=1, keepdims=True)
        component = str(rng.choice(["<f4", "i1", "<i2"]))
    if component == "<f4":
        values = values.astype("<f4").astype(float)
    else:
        largest = np.iinfo(component).max
        values = np.round(values * largest) / largest
    return Track(node, path, interpolation, times, values, component)


def pack_glb(document, binary):
    """Return the bytes of a GLB file."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(binary))
    chunk = struct.pack("<I4s", len(text), b"JSON") + text
    return header + chunk + struct.pack("<I4s", len(binary), b"BIN\0") + binary


def write_gltf(folder, document, binary, way):
    """Write a file as "glb", as "external" or "embedded" glTF; return its path."""
    if way == "glb":
        path = folder / "scene.glb"
        path.write_bytes(pack_glb(document, binary))
        return path
    path = folder / "scene.gltf"
    buffer = dict(document["buffers"][0])
    if way == "external":
        (folder / "a b.bin").write_bytes(binary)
        buffer["uri"] = "a%20b.bin"
    else:
        text = base64.b64encode(binary).decode()
        buffer["uri"] = f"data:application/octet-stream;base64,{text}"
    path.write_text(json.dumps({**document, "buffers": [buffer]}))
    return path


def read_primitives(file):
    """Return the arrays by attribute of each mesh primitive, and its material."""
    widths = {"TEXCOORD_0": 2, "JOINTS_0": 4, "WEIGHTS_0": 4}
    for primitive in (own for mesh in file.container.items("meshes") for own in mesh["primitives"]):
        found = {
            name: read_accessor(file.container, index, "", widths.get(name, 3))
            for name, index in primitive["attributes"].items()
        }
        if "indices" in primitive:
            found["indices"] = read_accessor(file.container, primitive["indices"], "", 1)[:, 0]
        yield found, primitive.get("material")


def skinned(file, motion, found):
    """Return the world positions (n_frames, n, 3) of the vertices of a primitive."""
    (skin,) = file.container.items("skins")
    columns = read_accessor(file.container, skin["inverseBindMatrices"], "", 16)
    inverse = columns.reshape(-1, 4, 4).transpose(0, 2, 1)
    turned, places = restore(file.rest, motion)
    worlds = np.zeros((*turned.shape[:2], 4, 4))
    for axis in range(3):
        worlds[..., :3, axis] = rotations.rotate(turned, np.eye(3)[axis])
    worlds[..., :3, 3], worlds[..., 3, 3] = places, 1.0
    rows = {node: row for row, node in enumerate(file.joints.tolist())}
    matrices = worlds[:, [rows[node] for node in skin["joints"]]] @ inverse
    points = np.c_[found["POSITION"], np.ones(len(found["POSITION"]))]
    moved = np.einsum("fvkij,vj->fvki", matrices[:, found["JOINTS_0"]], points)
    return np.einsum("vk,fvki->fvi", found["WEIGHTS_0"], moved)[..., :3]


def assert_equal_up_to_rotation(actual, expected, atol):
    """Assert that positions are equal up to one rotation about the origin."""
    flat = [positions.reshape(-1, 3) for positions in (actual, expected)]
    left, _, right = np.linalg.svd(flat[0].T @ flat[1])
    rotation = left @ right
    # A reflection is not a rotation.
    if np.linalg.det(rotation) < 0:
        rotation = left @ np.diag([1, 1, -1]) @ right
    np.testing.assert_allclose(flat[0], flat[1] @ rotation.T, atol=atol)
