"""`read_model`: the skeleton and hinges of a robot, from a model in MJCF or URDF.

Names of elements and attributes of MJCF, and their defaults, are those of the XML reference of
MuJoCo.
"""

import os
from collections.abc import Mapping
from math import inf
from pathlib import Path

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.io.clips import errors_of_file
from mograft.io.robots.bodies import Body, BodyJoint, to_skeleton
from mograft.io.robots.xml_tree import XmlElement, read_xml
from mograft.motion import limits, rotations
from mograft.motion.hinges import NO_LIMIT, TableLayout
from mograft.motion.skeleton import Skeleton

QUATERNION_ORDERS = ("wxyz", "xyzw")

_REFUSED = ("include", "attach", "composite", "flexcomp", "frame", "replicate")
"""Elements of MJCF that are not read."""

_MAIN = "main"
"""The class of joints in MJCF without another one."""

_URDF_TYPES = ("revolute", "continuous", "fixed")


def read_model(
    path: str | os.PathLike[str],
    *,
    quaternion: str | None = None,
    rate: float | Mapping[str, float] | None = None,
) -> Skeleton:
    """Read the skeleton of a robot with a floating base from its model.

    Parameters
    ----------
    path : str or path
        An MJCF or URDF file. Meshes are not needed.
    quaternion : {"wxyz", "xyzw"}, optional
        Order of the root's quaternion in motion files. Default: it is found in each file.
    rate : float or mapping of str to float, optional
        Frames per second of motion files that state none, or those of the files whose names match
        globs, such as ``{"dance*": 60}``. Default: 30.

    Returns
    -------
    Skeleton
        The bodies as joints, in their pose with all angles at 0, in metres with z up. The names,
        axes and limits of the hinges are in `hinges`. Give it to `read` as `skeleton`.

    Raises
    ------
    FormatError
        If the file is not such a model, or has elements that are not supported, such as ball and
        slide joints; the message states the line.
    ValueError
        If an argument is invalid.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "arm.xml"
    >>> _ = target.write_text('''<mujoco><worldbody><body name="trunk"><freejoint/>
    ... <body name="arm" pos="0 0 1"><joint name="elbow" axis="0 1 0" range="0 90"/></body>
    ... </body></worldbody></mujoco>''')
    >>> model = read_model(target)
    >>> model, model.hinges.names, model.hinges.limits.round(3).tolist()
    (Skeleton(2 joints, 9 channels, root trunk), ('elbow',), [[0.0, 1.571]])
    """
    if quaternion not in (None, *QUATERNION_ORDERS):
        raise ValueError(f"`quaternion` must be wxyz or xyzw, got {quaternion!r}")
    rates = {} if rate is None else rate if isinstance(rate, Mapping) else {"*": rate}
    for own in rates.values():
        limits.check_frame_time(1.0 / own if own > 0 else inf, "1 / `rate`")
    file = Path(path)
    root = read_xml(file)
    if root.tag not in ("mujoco", "robot"):
        raise root.error(f"expected the element mujoco or robot, got {root.tag}")
    with errors_of_file(file):
        bodies = _mjcf_bodies(root) if root.tag == "mujoco" else _urdf_bodies(root)
    if not any(body.joints for body in bodies):
        raise root.error("expected at least one hinge joint, got none")
    names = [joint.name for body in bodies for joint in body.joints]
    if len(set(names)) < len(names):
        raise root.error(f"expected joints of different names, got {', '.join(names)}")
    with errors_of_file(file):
        return to_skeleton(bodies, TableLayout(quaternion or "", rates=tuple(rates.items())))


class _MjcfReader:
    """The settings of a model, and the bodies that were read."""

    def __init__(self, root: XmlElement) -> None:
        settings: dict[str, str] = {}
        for compiler in root.all("compiler"):
            settings |= compiler.attributes
        self.unit = 1.0 if settings.get("angle", "degree") == "radian" else np.pi / 180.0
        self.order = settings.get("eulerseq", "xyz")
        self.limits_by_range = settings.get("autolimits", "true") == "true"
        self.defaults: dict[str, dict[str, str]] = {_MAIN: {}}
        for element in root.all("default"):
            self._read_defaults(element, {}, _MAIN)
        self.bodies: list[Body] = []

    def _read_defaults(self, element: XmlElement, above: Mapping[str, str], name: str) -> None:
        """Store the attributes of joints of a class, and of the classes in it."""
        own = {**above, **element.first("joint").attributes}
        self.defaults[name] = {**self.defaults.get(name, {}), **own}
        for child in element.all("default"):
            if "class" not in child.attributes:
                raise child.error("expected the attribute class of <default>, got none")
            self._read_defaults(child, own, child.attributes["class"])

    def read_body(self, element: XmlElement, parent: int, kind: str) -> None:
        """Read a body and the bodies in it; `kind` is the class of its joints."""
        kind = element.attributes.get("childclass", kind)
        name = element.attributes.get("name", f"body{len(self.bodies) + 1}")
        body = Body(name, parent, element.numbers("pos", 3, "0 0 0"), self.turn(element), [])
        inertial = element.first("inertial")
        if element.all("inertial"):
            (body.mass,) = inertial.numbers("mass", 1).tolist()
            body.center = inertial.numbers("pos", 3)
        index = len(self.bodies)
        self.bodies.append(body)
        for child in element.children:
            if child.tag in _REFUSED:
                raise child.error(f"<{child.tag}> is not supported: save the model with MuJoCo")
            if child.tag in ("joint", "freejoint"):
                body.joints += self._joints(child, kind, is_root=parent < 0)
        for child in element.all("body"):
            self.read_body(child, index, kind)

    def _joints(self, element: XmlElement, kind: str, *, is_root: bool) -> list[BodyJoint]:
        """Return the hinge of an element; nothing for the free joint of the root."""
        chosen = element.attributes.get("class", kind)
        if chosen not in self.defaults:
            raise element.error(f"expected a class of <default>, got {chosen!r}")
        known = {**self.defaults[chosen], **element.attributes}
        name = known.get("name", f"joint{len(self.bodies)}")
        joint = XmlElement(element.path, element.line, "joint", known)
        form = "free" if element.tag == "freejoint" else known.get("type", "hinge")
        if is_root and form == "free":
            return []
        if is_root or form != "hinge":
            expected = "a free joint at the root" if is_root else "a hinge"
            raise element.error(f"expected {expected}, got a joint of type {form}")
        if joint.numbers("ref", 1, "0").any():
            raise element.error("expected a joint with ref 0, got another reference")
        axis = joint.numbers("axis", 3, "0 0 1")
        if not axis.any():
            raise element.error("expected an axis with a length above 0, got 0 0 0")
        angles = (-NO_LIMIT, NO_LIMIT)
        limited = known.get("limited", "auto")
        if limited == "true" or (limited == "auto" and "range" in known and self.limits_by_range):
            low, high = (self.unit * joint.numbers("range", 2)).tolist()
            if low > high:
                raise element.error(f"expected an ascending range, got {known['range']}")
            angles = (low, high)
        return [BodyJoint(name, axis, joint.numbers("pos", 3, "0 0 0"), angles)]

    def turn(self, element: XmlElement) -> FloatArray:
        """Return the rotation of a body relative to its parent, xyzw."""
        known = element.attributes
        if "euler" in known:
            angles, order = self.unit * element.numbers("euler", 3), self.order
            if order.isupper():  # about the axes of the parent
                return rotations.from_euler(angles[::-1].copy(), order[::-1])
            return rotations.from_euler(angles, order.upper())
        for name in ("axisangle", "xyaxes", "zaxis"):
            if name in known:
                raise element.error(f"{name} is not supported: expected quat or euler")
        w, *vector = element.numbers("quat", 4, "1 0 0 0").tolist()
        quat = np.array([*vector, w])
        if not quat.any():
            raise element.error("expected a quaternion with a length above 0, got 0")
        return quat / np.linalg.norm(quat)


def _mjcf_bodies(root: XmlElement) -> list[Body]:
    """Return the bodies of a model: those of the only tree with a free joint, or of the only tree.

    Raises `FormatError` with the line if there is another number of trees, or an element that is
    not supported.
    """
    for element in root.children:
        if element.tag in _REFUSED:
            raise element.error(f"<{element.tag}> is not supported: save the model with MuJoCo")
    tops = [body for world in root.all("worldbody") for body in world.all("body")]
    free = [top for top in tops if any(map(_is_free, top.children))]
    chosen = free or tops
    if len(chosen) != 1:
        raise root.error(f"expected one body with a free joint, got {len(chosen)}")
    reader = _MjcfReader(root)
    reader.read_body(chosen[0], -1, _MAIN)
    return reader.bodies


def _is_free(element: XmlElement) -> bool:
    return element.tag == "freejoint" or element.attributes.get("type") == "free"


def _urdf_bodies(root: XmlElement) -> list[Body]:
    """Return the links of a robot, from the link without parent on; children follow their parent.

    Raises `FormatError` with the line if a joint is not supported or the links are not a tree.
    """
    links = {_name_of(link): link for link in root.all("link")}
    below: dict[str, list[XmlElement]] = {name: [] for name in links}
    children = set()
    for joint in root.all("joint"):
        ends = [joint.first(end).attributes.get("link", "") for end in ("parent", "child")]
        for name in ends:
            if name not in links:
                raise joint.error(f"expected the name of a link, got {name!r}")
        if ends[1] in children:
            raise joint.error(f"expected one joint above {ends[1]}, got another one")
        children.add(ends[1])
        below[ends[0]].append(joint)
    tops = [name for name in links if name not in children]
    if len(tops) != 1:
        raise root.error(f"expected one link that is no child, got {len(tops)}")
    bodies = [Body(tops[0], -1, np.zeros(3), rotations.IDENTITY, [])]
    stack = [(joint, 0) for joint in below[tops[0]][::-1]]
    while stack:
        joint, parent = stack.pop()
        name = joint.first("child").attributes["link"]
        origin = joint.first("origin")
        # Roll, pitch and yaw are about the axes of the parent.
        turn = rotations.from_euler(origin.numbers("rpy", 3, "0 0 0")[::-1].copy(), "ZYX")
        bodies.append(Body(name, parent, origin.numbers("xyz", 3, "0 0 0"), turn, _hinge(joint)))
        stack += [(child, len(bodies) - 1) for child in below[name][::-1]]
    for body in bodies:
        inertial = links[body.name].first("inertial")
        if inertial.all("mass"):
            (body.mass,) = inertial.first("mass").numbers("value", 1).tolist()
            body.center = inertial.first("origin").numbers("xyz", 3, "0 0 0")
    return bodies


def _name_of(element: XmlElement) -> str:
    if "name" not in element.attributes:
        raise element.error(f"expected the attribute name of <{element.tag}>, got none")
    return element.attributes["name"]


def _hinge(joint: XmlElement) -> list[BodyJoint]:
    """Return the hinge of a joint; nothing if it is fixed."""
    name, form = _name_of(joint), joint.attributes.get("type")
    if form not in _URDF_TYPES:
        raise joint.error(f"expected a joint of type {', '.join(_URDF_TYPES)}, got {form}")
    if joint.all("mimic"):
        raise joint.error(f"expected a joint that moves by itself, got the mimic joint {name}")
    if form == "fixed":
        return []
    axis, limit = joint.first("axis").numbers("xyz", 3, "1 0 0"), joint.first("limit")
    if not axis.any():
        raise joint.error("expected an axis with a length above 0, got 0 0 0")
    speed = float(limit.numbers("velocity", 1, "0")[0])
    found = BodyJoint(name, axis, speed=speed if speed > 0.0 else NO_LIMIT)
    if form == "revolute":
        low, high = (float(limit.numbers(end, 1, "0")[0]) for end in ("lower", "upper"))
        if low > high:
            raise limit.error(f"expected an ascending range, got {low:g} {high:g}")
        found.limits = (low, high)
    return [found]
