"""A receiver of VMC, written from the specifications of OSC 1.0 and VMC, without mograft.

The bones form a tree as in Unity. All axes are left-handed: x to the right of a figure at rest, y
up, z forward. Places are positions and rotations (xyzw) relative to the parent.
"""

import struct

import numpy as np
from scipy.spatial.transform import Rotation

PARENTS = {
    **{"Spine": "Hips", "Chest": "Spine", "UpperChest": "Chest", "Neck": "UpperChest"},
    **{"Head": "Neck", "Jaw": "Head", "LeftEye": "Head", "RightEye": "Head"},
}
for _side in ("Left", "Right"):
    _chain = ["Hips", "UpperLeg", "LowerLeg", "Foot", "Toes"]
    _chains = [_chain, ["UpperChest", "Shoulder", "UpperArm", "LowerArm", "Hand"]]
    for _finger in ("Thumb", "Index", "Middle", "Ring", "Little"):
        _chains.append(
            ["Hand", *(f"{_finger}{own}" for own in ("Proximal", "Intermediate", "Distal"))]
        )
    for _chain in _chains:
        _names = [own if own in ("Hips", "UpperChest") else f"{_side}{own}" for own in _chain]
        PARENTS |= dict(zip(_names[1:], _names, strict=False))


def parse(packet):
    """Return the address and the arguments of each message of a packet."""
    if packet[:8] == b"#bundle\0":
        messages, rest = [], packet[16:]
        while rest:
            size = int.from_bytes(rest[:4], "big")
            messages += parse(rest[4 : 4 + size])
            rest = rest[4 + size :]
        return messages
    address, rest = _take_text(packet)
    tags, rest = _take_text(rest)
    arguments = []
    for tag in tags[1:]:
        if tag == "s":
            value, rest = _take_text(rest)
        else:
            value, rest = struct.unpack(f">{tag}", rest[:4])[0], rest[4:]
        arguments.append(value)
    assert not rest
    return [(address, arguments)]


def _take_text(data):
    end = data.index(b"\0")
    stop = end + 4 - end % 4
    assert not any(data[end:stop])
    return data[:end].decode("ascii"), data[stop:]


def receive(packet):
    """Return the time of a packet, and the place of each bone and of the root, ``""``."""
    time, places = None, {}
    for address, arguments in parse(packet):
        if address == "/VMC/Ext/T":
            (time,) = arguments
        elif address == "/VMC/Ext/Bone/Pos":
            places[arguments[0]] = np.array(arguments[1:])
        elif address == "/VMC/Ext/Root/Pos":
            places[""] = np.array(arguments[1:])
        else:
            assert (address, arguments) == ("/VMC/Ext/OK", [1])
    return time, places


def world(places):
    """Return the position and rotation of each bone in the world, in Unity's axes."""
    found = {"": (places[""][:3], Rotation.from_quat(places[""][3:]))}

    def find(bone):
        if bone not in found:
            above = PARENTS.get(bone, "")
            while above and above not in places:
                above = PARENTS.get(above, "")
            origin, turn = find(above)
            own = places[bone]
            found[bone] = origin + turn.apply(own[:3]), turn * Rotation.from_quat(own[3:])
        return found[bone]

    return {bone: find(bone) for bone in places if bone}
