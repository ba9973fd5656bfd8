"""MJCF: the bodies of a model of MuJoCo.

Names of elements and attributes, and their defaults, are those of the XML reference of MuJoCo.
"""

from collections.abc import Mapping

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.io.robots.bodies import Body, BodyJoint
from mograft.io.robots.xml_tree import XmlElement
from mograft.motion import rotations
from mograft.motion.hinges import NO_LIMIT

_REFUSED = ("include", "attach", "composite", "flexcomp", "frame", "replicate")
_MAIN = "main"


class _Reader:
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
        limits = (-NO_LIMIT, NO_LIMIT)
        limited = known.get("limited", "auto")
        if limited == "true" or (limited == "auto" and "range" in known and self.limits_by_range):
            low, high = (self.unit * joint.numbers("range", 2)).tolist()
            if low > high:
                raise element.error(f"expected an ascending range, got {known['range']}")
            limits = (low, high)
        return [BodyJoint(name, axis, joint.numbers("pos", 3, "0 0 0"), limits)]

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


def mjcf_bodies(root: XmlElement) -> list[Body]:
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
    reader = _Reader(root)
    reader.read_body(chosen[0], -1, _MAIN)
    return reader.bodies


def _is_free(element: XmlElement) -> bool:
    return element.tag == "freejoint" or element.attributes.get("type") == "free"
