"""FBX scenes: writers of text and binary files, and a slow evaluation by the equations of FBX."""

import struct
import zlib
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

TICKS = 46_186_158_000
"""Ticks of FBX per second."""

RATE, TIME_MODE = 30, 6
"""Frames per second of all scenes, and the value of the property TimeMode for them."""

ORDERS = ("XYZ", "XZY", "YZX", "YXZ", "ZXY", "ZYX")
"""Rotation orders: the first axis is applied first."""

INHERIT_RRSS, INHERIT_RSRS, INHERIT_RRS = 0, 1, 2
PROPERTIES = {"T": "Lcl Translation", "R": "Lcl Rotation", "S": "Lcl Scaling"}
VECTORS = {
    "pre": "PreRotation",
    "post": "PostRotation",
    "rotation_offset": "RotationOffset",
    "rotation_pivot": "RotationPivot",
    "scaling_offset": "ScalingOffset",
    "scaling_pivot": "ScalingPivot",
}


@dataclass(frozen=True)
class Node:
    """A node; vectors have three components, angles are in degrees."""

    name: str
    parent: int = -1  # -1: the root of the scene
    kind: str = "LimbNode"
    T: tuple = (0.0, 0.0, 0.0)
    R: tuple = (0.0, 0.0, 0.0)
    S: tuple = (1.0, 1.0, 1.0)
    order: int = 0
    inherit: int = INHERIT_RSRS
    pre: tuple = (0.0, 0.0, 0.0)
    post: tuple = (0.0, 0.0, 0.0)
    rotation_offset: tuple = (0.0, 0.0, 0.0)
    rotation_pivot: tuple = (0.0, 0.0, 0.0)
    scaling_offset: tuple = (0.0, 0.0, 0.0)
    scaling_pivot: tuple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Layer:
    """An animation layer: `tracks` maps (node, "T", "R" or "S") to values (n_frames, 3)."""

    tracks: dict
    mode: int = 0  # 0 additive, 1 override, 2 override passthrough
    weight: float = 100.0


@dataclass(frozen=True)
class Take:
    name: str
    n_frames: int
    layers: tuple
    first: int = 0  # number of the first frame


@dataclass(frozen=True)
class Mesh:
    """A mesh at the root of the scene, in the axes of the file."""

    points: np.ndarray  # (n, 3)
    faces: tuple  # tuples of indices of points
    uvs: np.ndarray  # (number of corners of faces, 2)
    weights: np.ndarray | None  # (number of nodes, n); None without a skin
    place: tuple = (0.0, 0.0, 0.0)
    color: tuple = (1.0, 1.0, 1.0)
    texture: str = ""
    content: bytes = b""  # of the texture, if it is embedded


@dataclass(frozen=True)
class Scene:
    nodes: tuple
    takes: tuple
    axes: tuple = ((1, 1), (2, 1), (0, 1))  # up, front, right: number of the axis and its sign
    unit: float = 1.0  # centimetres
    bind: dict = field(default_factory=dict)  # node to world matrix (4, 4)
    meshes: tuple = ()


def needs_extension():
    """The mark of tests that need the package mograft-fbx."""
    reason = "mograft-fbx is not installed: pip install ./python-fbx"
    return pytest.mark.skipif(not find_spec("mograft_fbx"), reason=reason)


# Documents: an element is (name, values, children).


def _rows(fields):
    return [(name, [value], []) for name, value in fields.items()]


def _vector(name, value, kind="Vector3D"):
    return ("P", [name, kind, "Vector" if kind == "Vector3D" else "", "A", *map(float, value)], [])


def _number(name, value, kind):
    second = {"int": "Integer", "enum": "", "bool": "", "double": "Number", "KTime": "Time"}[kind]
    stored = value if kind in {"double", "KTime"} else np.int32(value)
    return ("P", [name, kind, second, "", stored], [])


def _node_properties(node):
    properties = [_vector(name, getattr(node, key), name) for key, name in PROPERTIES.items()]
    properties += [_vector(name, getattr(node, key)) for key, name in VECTORS.items()]
    properties.append(_number("RotationOrder", node.order, "enum"))
    properties.append(_number("RotationActive", 1, "bool"))
    return ("Properties70", [], [*properties, _number("InheritType", node.inherit, "enum")])


def _settings(scene):
    numbers = []
    for name, (axis, sign) in zip(("Up", "Front", "Coord"), scene.axes, strict=True):
        numbers += [_number(f"{name}Axis", axis, "int"), _number(f"{name}AxisSign", sign, "int")]
    numbers.append(_number("UnitScaleFactor", float(scene.unit), "double"))
    numbers.append(_number("TimeMode", TIME_MODE, "enum"))
    return ("GlobalSettings", [], [("Version", [1000], []), ("Properties70", [], numbers)])


class _Builder:
    """Objects and connections of a document with identifiers."""

    def __init__(self):
        self.objects, self.connections, self.n_objects = [], [], 0

    def add(self, kind, label, subtype, children, parent=None, slot=None):
        self.n_objects += 1
        number = 1000 + self.n_objects
        values = [number, Label(*label), subtype]
        self.objects.append((kind, values, children))
        if parent is not None:
            link = ["OO", number, parent] if slot is None else ["OP", number, parent, slot]
            self.connections.append(("C", link, []))
        return number


@dataclass(frozen=True)
class Label:
    """A name with its class: ``Class::name`` in text, ``name``, 0, 1, ``Class`` in binary."""

    name: str
    group: str


def _add_curves(builder, ticks, values, curve_node):
    for axis, column in zip("XYZ", np.asarray(values, float).T, strict=True):
        fields = {"Default": float(column[0]), "KeyVer": 4008, "KeyTime": np.int64(ticks)}
        fields |= {"KeyValueFloat": np.float32(column), "KeyAttrFlags": np.int32([4])}  # linear
        fields |= {"KeyAttrDataFloat": np.zeros(4, "f4")}
        fields |= {"KeyAttrRefCount": np.int32([len(column)])}
        label = ("", "AnimCurve")
        builder.add("AnimationCurve", label, "", _rows(fields), curve_node, f"d|{axis}")


def _add_take(builder, take, models):
    ticks = (take.first + np.arange(take.n_frames)) * (TICKS // RATE)
    ends = {"LocalStart": ticks[0], "LocalStop": ticks[-1]}
    span = [_number(name, int(tick), "KTime") for name, tick in ends.items()]
    span = [("Properties70", [], span)]
    stack = builder.add("AnimationStack", (take.name, "AnimStack"), "", span)
    for number, layer in enumerate(take.layers):
        modes = {"BlendMode": layer.mode, "RotationAccumulationMode": 1}  # by channel
        settings = [_number("Weight", float(layer.weight), "double")]
        settings += [_number(name, value, "enum") for name, value in modes.items()]
        label, children = (f"layer{number}", "AnimLayer"), [("Properties70", [], settings)]
        layer_id = builder.add("AnimationLayer", label, "", children, stack)
        for (node, key), values in layer.tracks.items():
            slot = PROPERTIES[key]
            first = zip("XYZ", map(float, values[0]), strict=True)
            numbers = [_number(f"d|{axis}", value, "double") for axis, value in first]
            label, children = (key, "AnimCurveNode"), [("Properties70", [], numbers)]
            curve_node = builder.add("AnimationCurveNode", label, "", children, models[node], slot)
            builder.connections.append(("C", ["OO", curve_node, layer_id], []))
            _add_curves(builder, ticks, values, curve_node)


def _add_mesh(builder, scene, mesh, models):
    node = _node_properties(Node("mesh", T=mesh.place))
    model = builder.add("Model", ("mesh", "Model"), "Mesh", [node], 0)
    ends = [index for *others, last in mesh.faces for index in (*others, ~last)]

    def layer(kind, mapping, arrays):
        words = {"MappingInformationType": mapping, "ReferenceInformationType": "IndexToDirect"}
        return (f"LayerElement{kind}", [0], _rows(words | arrays))

    uvs = {"UV": np.ravel(mesh.uvs), "UVIndex": np.arange(len(ends), dtype=np.int32)}
    children = _rows({"Vertices": np.ravel(mesh.points), "PolygonVertexIndex": np.int32(ends)})
    children.append(layer("UV", "ByPolygonVertex", uvs))
    children.append(layer("Material", "AllSame", {"Materials": np.zeros(1, np.int32)}))
    geometry = builder.add("Geometry", ("mesh", "Geometry"), "Mesh", children, model)
    color = ("P", ["DiffuseColor", "Color", "", "A", *mesh.color], [])
    shading = [("ShadingModel", ["lambert"], []), ("Properties70", [], [color])]
    material = builder.add("Material", ("skin", "Material"), "", shading, model)
    if mesh.texture:
        names = _rows({"FileName": mesh.texture, "RelativeFilename": mesh.texture})
        texture = builder.add("Texture", ("map", "Texture"), "", names, material, "DiffuseColor")
        if mesh.content:
            content = ("Content", [mesh.content], [])
            builder.add("Video", ("map", "Video"), "Clip", [*names, content], texture)
    if mesh.weights is None:
        return
    skin = builder.add("Deformer", ("skin", "Deformer"), "Skin", [], geometry)
    worlds = world_matrices(scene, static_values(scene))
    for weights, world, bone in zip(mesh.weights, worlds, models, strict=True):
        (chosen,) = np.nonzero(weights)
        if not len(chosen):
            continue
        to_bone = np.linalg.inv(world) @ _translation(mesh.place)
        arrays = {"Indexes": np.int32(chosen), "Weights": weights[chosen]}
        arrays |= {"Transform": np.ravel(to_bone.T), "TransformLink": np.ravel(world.T)}
        cluster = builder.add("Deformer", ("own", "SubDeformer"), "Cluster", _rows(arrays), skin)
        builder.connections.append(("C", ["OO", bone, cluster], []))


def _header(version):
    children = [("FBXHeaderVersion", [1003], []), ("FBXVersion", [version], [])]
    return ("FBXHeaderExtension", [], children)


def _document(scene, version):
    builder = _Builder()
    models = []
    for node in scene.nodes:
        parent = models[node.parent] if node.parent >= 0 else 0
        label, children = (node.name, "Model"), [_node_properties(node)]
        models.append(builder.add("Model", label, node.kind, children, parent))
        if node.kind == "LimbNode":
            flags = [("TypeFlags", ["Skeleton"], [])]
            builder.add("NodeAttribute", ("", "NodeAttribute"), "LimbNode", flags, models[-1])
    if scene.bind:
        poses = [
            ("PoseNode", [], [("Node", [models[n]], []), ("Matrix", [np.ravel(m.T)], [])])
            for n, m in scene.bind.items()
        ]
        builder.add("Pose", ("pose", "Pose"), "BindPose", [("Type", ["BindPose"], []), *poses])
    for mesh in scene.meshes:
        _add_mesh(builder, scene, mesh, models)
    for take in scene.takes:
        _add_take(builder, take, models)
    objects, links = ("Objects", [], builder.objects), ("Connections", [], builder.connections)
    return [_header(version), _settings(scene), objects, links]


# Text.


def _text_value(value):
    if isinstance(value, Label):
        return f'"{value.group}::{value.name}"'
    if isinstance(value, str):
        return f'"{value}"'
    return repr(value.item() if isinstance(value, np.generic) else value)


def _text_lines(element, indent, lines):
    name, values, children = element
    tabs = "\t" * indent
    if len(values) == 1 and isinstance(values[0], np.ndarray):
        numbers = ",".join(map(repr, values[0].tolist()))
        lines += [f"{tabs}{name}: *{len(values[0])} {{", f"{tabs}\ta: {numbers}", f"{tabs}}}"]
        return
    head = f"{tabs}{name}: " + ", ".join(map(_text_value, values))
    if not children and name not in {"Objects", "Connections", "Properties70"}:
        lines.append(head)
        return
    lines.append(head + " {")
    for child in children:
        _text_lines(child, indent + 1, lines)
    lines.append(tabs + "}")


def to_text(scene, version=7400):
    """Return a text file."""
    lines = [f"; FBX {version // 1000}.{version // 100 % 10}.0 project file"]
    for element in _document(scene, version):
        _text_lines(element, 0, lines)
    return ("\n".join(lines) + "\n").encode()


# Binary.


def _binary_value(value):
    if isinstance(value, Label):
        data = value.name.encode() + b"\0\1" + value.group.encode()
        return b"S" + struct.pack("<I", len(data)) + data
    if isinstance(value, str):
        return b"S" + struct.pack("<I", len(value.encode())) + value.encode()
    if isinstance(value, bytes):
        return b"R" + struct.pack("<I", len(value)) + value
    for kind, code in ((float, "Dd"), (np.int32, "Ii"), (int, "Lq")):
        if isinstance(value, kind):
            return code[:1].encode() + struct.pack(f"<{code[1]}", value)
    code = {"float64": b"d", "float32": b"f", "int64": b"l", "int32": b"i"}[value.dtype.name]
    packed = zlib.compress(value.tobytes()) if len(value) > 8 else value.tobytes()
    return code + struct.pack("<III", len(value), int(len(value) > 8), len(packed)) + packed


def _binary_element(element, start, version):
    name, values, children = element
    header = struct.Struct("<QQQB" if version >= 7500 else "<IIIB")
    properties = b"".join(map(_binary_value, values))
    body = name.encode() + properties
    end = start + header.size + len(body)
    if children:
        for child in children:
            data = _binary_element(child, end, version)
            body, end = body + data, end + len(data)
        body, end = body + bytes(header.size), end + header.size
    return header.pack(end, len(values), len(properties), len(name)) + body


def to_binary(scene, version=7400):
    """Return a binary file."""
    data = b"Kaydara FBX Binary  \0\x1a\0" + struct.pack("<I", version)
    for element in _document(scene, version):
        data += _binary_element(element, len(data), version)
    return data + bytes(25 if version >= 7500 else 13)


CONTAINERS = {"text": to_text, "binary 7400": to_binary}
CONTAINERS["binary 7700"] = partial(to_binary, version=7700)
"""Writers of the kinds of files; a recorded file has the older layout of version 6100."""


# Evaluation: the equations of the FBX SDK, "Computing transformation matrices", one node and one
# frame at a time.


def _translation(vector):
    matrix = np.eye(4)
    matrix[:3, 3] = vector
    return matrix


def _rotation(degrees, order="XYZ"):
    """Return the matrix of rotations about fixed axes, the first axis of `order` first."""
    matrix = np.eye(4)
    angles = [degrees["XYZ".index(axis)] for axis in order]
    matrix[:3, :3] = Rotation.from_euler(order.lower(), angles, degrees=True).as_matrix()
    return matrix


def _scaling(vector):
    return np.diag([*vector, 1.0])


def _local(node, values):
    """Return the rotation, the scale and the translation of a node relative to its parent."""
    turn = _rotation(node.pre) @ _rotation(values["R"], ORDERS[node.order])
    turn = turn @ np.linalg.inv(_rotation(node.post))
    pivot, scaling_pivot = _translation(node.rotation_pivot), _translation(node.scaling_pivot)
    matrix = _translation(values["T"]) @ _translation(node.rotation_offset) @ pivot @ turn
    matrix = matrix @ np.linalg.inv(pivot) @ _translation(node.scaling_offset) @ scaling_pivot
    matrix = matrix @ _scaling(values["S"]) @ np.linalg.inv(scaling_pivot)
    return turn, _scaling(values["S"]), matrix[:3, 3]


def world_matrices(scene, values):
    """Return the world matrices (n_nodes, 4, 4) for local values: a dict per node."""
    worlds, turns, shears, scales = [], [], [], []
    for node, local_values in zip(scene.nodes, values, strict=True):
        turn, scale, translation = _local(node, local_values)
        parent, parent_turn, parent_shear, parent_scale = (
            own[node.parent] if node.parent >= 0 else np.eye(4)
            for own in (worlds, turns, shears, scales)
        )
        if node.inherit == INHERIT_RRSS:
            linear = parent_turn @ turn @ parent_shear @ scale
        elif node.inherit == INHERIT_RSRS:
            linear = parent_turn @ parent_shear @ turn @ scale
        else:
            linear = parent_turn @ turn @ parent_shear @ np.linalg.inv(parent_scale) @ scale
        world = _translation((parent @ [*translation, 1.0])[:3]) @ linear
        worlds.append(world)
        turns.append(parent_turn @ turn)
        shears.append(np.linalg.inv(turns[-1]) @ linear)
        scales.append(scale)
    return np.array(worlds)


def axis_conversion(scene):
    """Return the matrix from the axes of the file to right, up and front."""
    up, front, right = scene.axes
    matrix = np.zeros((3, 3))
    for row, (axis, sign) in enumerate((right, up, front)):
        matrix[row, axis] = sign
    return matrix


def values_in_frame(scene, take, frame):
    """Return the local values of every node: additive layers and layers that override."""
    result = []
    for number, node in enumerate(scene.nodes):
        values = {}
        for key in "TRS":
            value = np.array(getattr(node, key), float)
            for index, layer in enumerate(take.layers):
                track = layer.tracks.get((number, key))
                if track is None:
                    continue
                other, weight = np.float32(track[frame]).astype(float), layer.weight / 100.0
                kept = (1.0, 0.0, 1 - weight)[layer.mode if index else 1]
                value = kept * value + (weight if kept else 1.0) * other
            values[key] = value
        result.append(values)
    return result


def static_values(scene):
    return [{key: np.array(getattr(node, key), float) for key in "TRS"} for node in scene.nodes]


def positions_and_turns(scene, take):
    """Return world positions (F, N, 3) and linear parts (F, N, 3, 3) in right-handed axes, y up."""
    conversion = axis_conversion(scene)
    frames = [world_matrices(scene, values_in_frame(scene, take, f)) for f in range(take.n_frames)]
    worlds = np.array(frames).reshape(take.n_frames, len(scene.nodes), 4, 4)
    return worlds[..., :3, 3] @ conversion.T, conversion @ worlds[..., :3, :3]
