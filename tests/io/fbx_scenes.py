"""FBX scenes: writers of text and binary files, and a slow evaluation by the equations of FBX."""

import struct
import zlib
from dataclasses import dataclass, field

import numpy as np

TICKS = 46_186_158_000
"""Ticks of FBX per second."""

TIME_MODES = {120: 1, 100: 2, 60: 3, 50: 4, 48: 5, 30: 6, 24: 11}
"""Values of the property TimeMode for frame rates."""

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
class Scene:
    nodes: tuple
    takes: tuple
    rate: int = 30
    axes: tuple = ((1, 1), (2, 1), (0, 1))  # up, front, right: number of the axis and its sign
    unit: float = 1.0  # centimetres
    bind: dict = field(default_factory=dict)  # node to world matrix (4, 4)


# Documents: an element is (name, values, children).


def _vector(name, value, kind="Vector3D"):
    return ("P", [name, kind, "Vector" if kind == "Vector3D" else "", "A", *map(float, value)], [])


def _number(name, value, kind):
    second = {"int": "Integer", "enum": "", "bool": "", "double": "Number", "KTime": "Time"}[kind]
    stored = value if kind in {"double", "KTime"} else np.int32(value)
    return ("P", [name, kind, second, "", stored], [])


def _node_properties(node):
    properties = [_vector(name, getattr(node, key), name) for key, name in PROPERTIES.items()]
    properties += [_vector(name, getattr(node, key)) for key, name in VECTORS.items()]
    properties += [
        _number("RotationOrder", node.order, "enum"),
        _number("RotationActive", 1, "bool"),
        _number("InheritType", node.inherit, "enum"),
    ]
    return ("Properties70", [], properties)


def _settings(scene):
    numbers = []
    for name, (axis, sign) in zip(("Up", "Front", "Coord"), scene.axes, strict=True):
        numbers.append(_number(f"{name}Axis", axis, "int"))
        numbers.append(_number(f"{name}AxisSign", sign, "int"))
    numbers.append(_number("UnitScaleFactor", float(scene.unit), "double"))
    numbers.append(_number("TimeMode", TIME_MODES[scene.rate], "enum"))
    return ("GlobalSettings", [], [("Version", [1000], []), ("Properties70", [], numbers)])


def _ticks(scene, take):
    frames = take.first + np.arange(take.n_frames)
    return frames * (TICKS // scene.rate)


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
            link = [
                "OO" if slot is None else "OP",
                number,
                parent,
                *([] if slot is None else [slot]),
            ]
            self.connections.append(("C", link, []))
        return number

    def connect(self, child, parent):
        self.connections.append(("C", ["OO", child, parent], []))


@dataclass(frozen=True)
class Label:
    """A name with its class: ``Class::name`` in text, ``name``, 0, 1, ``Class`` in binary."""

    name: str
    group: str


def _add_curves(builder, ticks, values, curve_node):
    for axis, column in zip("XYZ", np.asarray(values, float).T, strict=True):
        n_keys = len(column)
        children = [
            ("Default", [float(column[0])], []),
            ("KeyVer", [4008], []),
            ("KeyTime", [np.asarray(ticks, np.int64)], []),
            ("KeyValueFloat", [column.astype(np.float32)], []),
            ("KeyAttrFlags", [np.array([4], np.int32)], []),  # linear
            ("KeyAttrDataFloat", [np.zeros(4, np.float32)], []),
            ("KeyAttrRefCount", [np.array([n_keys], np.int32)], []),
        ]
        builder.add("AnimationCurve", ("", "AnimCurve"), "", children, curve_node, f"d|{axis}")


def _add_take(builder, scene, take, models):
    ticks = _ticks(scene, take)
    span = [
        _number("LocalStart", int(ticks[0]), "KTime"),
        _number("LocalStop", int(ticks[-1]), "KTime"),
    ]
    label = (take.name, "AnimStack")
    stack = builder.add("AnimationStack", label, "", [("Properties70", [], span)])
    for number, layer in enumerate(take.layers):
        settings = [
            _number("Weight", float(layer.weight), "double"),
            _number("BlendMode", layer.mode, "enum"),
            _number("RotationAccumulationMode", 1, "enum"),  # by channel
        ]
        children = [("Properties70", [], settings)]
        layer_id = builder.add(
            "AnimationLayer", (f"layer{number}", "AnimLayer"), "", children, stack
        )
        for (node, key), values in layer.tracks.items():
            slot = PROPERTIES[key]
            first = [
                _number(f"d|{a}", float(v), "double") for a, v in zip("XYZ", values[0], strict=True)
            ]
            children = [("Properties70", [], first)]
            label = (key, "AnimCurveNode")
            curve_node = builder.add("AnimationCurveNode", label, "", children, models[node], slot)
            builder.connect(curve_node, layer_id)
            _add_curves(builder, ticks, values, curve_node)


def _document(scene, version):
    builder = _Builder()
    models = []
    for node in scene.nodes:
        parent = models[node.parent] if node.parent >= 0 else 0
        children = [("Version", [232], []), _node_properties(node)]
        models.append(builder.add("Model", (node.name, "Model"), node.kind, children, parent))
        if node.kind == "LimbNode":
            flags = [("TypeFlags", ["Skeleton"], [])]
            builder.add("NodeAttribute", ("", "NodeAttribute"), "LimbNode", flags, models[-1])
    if scene.bind:
        poses = [
            ("PoseNode", [], [("Node", [models[n]], []), ("Matrix", [np.ravel(m.T)], [])])
            for n, m in scene.bind.items()
        ]
        children = [("Type", ["BindPose"], []), ("Version", [100], [])]
        builder.add("Pose", ("pose", "Pose"), "BindPose", children + poses)
    for take in scene.takes:
        _add_take(builder, scene, take, models)
    return [
        (
            "FBXHeaderExtension",
            [],
            [("FBXHeaderVersion", [1003], []), ("FBXVersion", [version], [])],
        ),
        _settings(scene),
        ("Objects", [], builder.objects),
        ("Connections", [], builder.connections),
    ]


# Version 6100: objects are connected by name, keys are in a section of takes, without layers.


def _to_60(properties):
    _, _, rows = properties
    return (
        "Properties60",
        [],
        [("Property", [r[1][0], r[1][1], "A", *r[1][4:]], []) for r in rows],
    )


def _document_6100(scene):
    objects, links, takes = [], [], []
    for node in scene.nodes:
        label = Label(node.name, "Model")
        kind = "Limb" if node.kind == "LimbNode" else node.kind
        objects.append(
            ("Model", [label, kind], [("Version", [232], []), _to_60(_node_properties(node))])
        )
        parent = scene.nodes[node.parent].name if node.parent >= 0 else "Scene"
        links.append(("Connect", ["OO", label, Label(parent, "Model")], []))
    if scene.bind:
        poses = [
            (
                "PoseNode",
                [],
                [
                    ("Node", [Label(scene.nodes[n].name, "Model")], []),
                    ("Matrix", list(map(float, np.ravel(m.T))), []),
                ],
            )
            for n, m in scene.bind.items()
        ]
        children = [("Type", ["BindPose"], []), ("Version", [100], [])]
        objects.append(("Pose", [Label("pose", "Pose"), "BindPose"], children + poses))
    name, values, children = _settings(scene)
    objects.append((name, values, [children[0], _to_60(children[1])]))
    for take in scene.takes:
        ticks = _ticks(scene, take)
        (layer,) = take.layers
        models = []
        for number, node in enumerate(scene.nodes):
            parts = []
            for key in "TRS":
                default = np.array([getattr(node, key)], float)
                track = layer.tracks.get((number, key))
                axes = []
                for column, axis in enumerate("XYZ"):
                    if track is None:
                        axes.append(
                            ("Channel", [axis], [("Default", [float(default[0, column])], [])])
                        )
                        continue
                    keys = []
                    for tick, value in zip(
                        ticks, np.asarray(track, np.float32)[:, column], strict=True
                    ):
                        keys += [int(tick), float(value), Word("L")]
                    axes.append(
                        (
                            "Channel",
                            [axis],
                            [
                                ("Default", [keys[1]], []),
                                ("KeyVer", [4005], []),
                                ("KeyCount", [len(ticks)], []),
                                ("Key", keys, []),
                            ],
                        )
                    )
                parts.append(("Channel", [key], [*axes, ("LayerType", [1], [])]))
            models.append(
                (
                    "Model",
                    [Label(node.name, "Model")],
                    [("Version", [1.1], []), ("Channel", ["Transform"], parts)],
                )
            )
        span = [int(ticks[0]), int(ticks[-1])]
        takes.append(
            (
                "Take",
                [take.name],
                [
                    ("FileName", ["take.tak"], []),
                    ("LocalTime", span, []),
                    ("ReferenceTime", span, []),
                    *models,
                ],
            )
        )
    return [
        ("FBXHeaderExtension", [], [("FBXHeaderVersion", [1003], []), ("FBXVersion", [6100], [])]),
        ("Objects", [], objects),
        ("Connections", [], links),
        ("Takes", [], [("Current", [scene.takes[0].name if scene.takes else ""], []), *takes]),
    ]


@dataclass(frozen=True)
class Word:
    """A letter without quotes in text; one byte in binary."""

    text: str


# Text.


def _text_value(value):
    if isinstance(value, Label):
        return f'"{value.group}::{value.name}"'
    if isinstance(value, Word):
        return value.text
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
    if not children and name not in {"Objects", "Connections", "Takes", "Properties70"}:
        lines.append(head)
        return
    lines.append(head + " {")
    for child in children:
        _text_lines(child, indent + 1, lines)
    lines.append(tabs + "}")


def to_text(scene, version=7400):
    """Return a text file."""
    document = _document_6100(scene) if version < 7000 else _document(scene, version)
    lines = [f"; FBX {version // 1000}.{version // 100 % 10}.0 project file"]
    for element in document:
        _text_lines(element, 0, lines)
    return ("\n".join(lines) + "\n").encode()


# Binary.


def _binary_value(value):
    if isinstance(value, Label):
        data = value.name.encode() + b"\0\1" + value.group.encode()
        return b"S" + struct.pack("<I", len(data)) + data
    if isinstance(value, Word):
        return b"C" + value.text.encode()
    if isinstance(value, str):
        data = value.encode()
        return b"S" + struct.pack("<I", len(data)) + data
    if isinstance(value, float):
        return b"D" + struct.pack("<d", value)
    if isinstance(value, np.int32):
        return b"I" + struct.pack("<i", value)
    if isinstance(value, int):
        return b"L" + struct.pack("<q", value)
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
    document = _document_6100(scene) if version < 7000 else _document(scene, version)
    data = b"Kaydara FBX Binary  \0\x1a\0" + struct.pack("<I", version)
    for element in document:
        data += _binary_element(element, len(data), version)
    return data + bytes(25 if version >= 7500 else 13)


CONTAINERS = {
    "text 7400": lambda scene: to_text(scene, 7400),
    "text 6100": lambda scene: to_text(scene, 6100),
    "binary 6100": lambda scene: to_binary(scene, 6100),
    "binary 7400": lambda scene: to_binary(scene, 7400),
    "binary 7700": lambda scene: to_binary(scene, 7700),
}
"""Writers of the kinds of files; version 6100 has one layer."""


# Evaluation: the equations of the FBX SDK, "Computing transformation matrices", one node and one
# frame at a time.


def _translation(vector):
    matrix = np.eye(4)
    matrix[:3, 3] = vector
    return matrix


def _rotation(degrees, order="XYZ"):
    matrix = np.eye(4)
    for axis in order:
        one = "XYZ".index(axis)
        angle = np.radians(degrees[one])
        turn = np.eye(4)
        j, k = (one + 1) % 3, (one + 2) % 3
        turn[j, j] = turn[k, k] = np.cos(angle)
        turn[k, j], turn[j, k] = np.sin(angle), -np.sin(angle)
        matrix = turn @ matrix
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
        if node.parent < 0:
            parent, parent_turn, parent_shear, parent_scale = [np.eye(4)] * 4
        else:
            parent, parent_turn = worlds[node.parent], turns[node.parent]
            parent_shear, parent_scale = shears[node.parent], scales[node.parent]
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
                layer_value = np.asarray(track, np.float32).astype(float)[frame]
                weight = layer.weight / 100.0
                if index == 0 or layer.mode == 1:
                    value = layer_value
                elif layer.mode == 0:
                    value = value + weight * layer_value
                else:
                    value = (1 - weight) * value + weight * layer_value
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


def scene_of_motions(motions, names):
    """Return a scene with a take per motion; all motions have the same skeleton.

    The local axes of every joint are turned by a rotation of its own, so that the scene has the
    pre-rotations and post-rotations of a rig.
    """
    skeleton = motions[0].skeleton
    rng = np.random.default_rng(0)
    axes = rng.uniform(-90, 90, (skeleton.n_joints, 3))
    nodes = []
    for joint, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        turns = "".join(c[0] for c in skeleton.channels[joint] if c.endswith("rotation"))
        frame = _rotation(axes[parent])[:3, :3] if parent >= 0 else np.eye(3)
        # Axes of the joint: those of the parent, pre-rotation, rotation, inverse post-rotation.
        nodes.append(
            Node(
                name,
                int(parent),
                T=tuple(frame.T @ skeleton.offsets[joint]),
                pre=tuple(_angles(frame.T)),
                post=tuple(_angles(_rotation(axes[joint])[:3, :3].T)),
                order=ORDERS.index(turns[::-1]),
            )
        )
    return Scene(tuple(nodes), tuple(map(_take_of_motion, motions, names)))


def _angles(matrix):
    """Return the angles of a rotation about X, then Y, then Z, in degrees."""
    y = np.arcsin(np.clip(-matrix[2, 0], -1, 1))
    x = np.arctan2(matrix[2, 1], matrix[2, 2])
    z = np.arctan2(matrix[1, 0], matrix[0, 0])
    return np.degrees([x, y, z])


def _take_of_motion(motion, name):
    tracks = {(0, "T"): motion.positions[:, 0]}
    columns = motion.skeleton.channel_columns
    numbers = motion.channel_numbers()
    for joint, names in enumerate(motion.skeleton.channels):
        values = dict(zip(names, numbers[:, columns[joint]].T, strict=True))
        tracks[joint, "R"] = np.stack([values[f"{axis}rotation"] for axis in "XYZ"], axis=1)
    return Take(name, motion.n_frames, (Layer(tracks),))
