"""URDF: the links of a robot as bodies."""

import numpy as np

from mograft.io.robots.bodies import Body, BodyJoint
from mograft.io.robots.xml_tree import XmlElement
from mograft.motion import rotations
from mograft.motion.hinges import NO_LIMIT

_TYPES = ("revolute", "continuous", "fixed")


def urdf_bodies(root: XmlElement) -> list[Body]:
    """Return the links of a robot, from the link without parent on; children follow their parent.

    Raises `FormatError` with the line if a joint is not supported or the links are not a tree.
    """
    links = {_name(link): link for link in root.all("link")}
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


def _name(element: XmlElement) -> str:
    if "name" not in element.attributes:
        raise element.error(f"expected the attribute name of <{element.tag}>, got none")
    return element.attributes["name"]


def _hinge(joint: XmlElement) -> list[BodyJoint]:
    """Return the hinge of a joint; nothing if it is fixed."""
    name, form = _name(joint), joint.attributes.get("type")
    if form not in _TYPES:
        raise joint.error(f"expected a joint of type {', '.join(_TYPES)}, got {form}")
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
