# SPDX-License-Identifier: GPL-3.0-or-later
"""Joint groups as bone collections, which the user edits and the file stores."""

import mograft as mg

PREFIX = "mograft "
PRESETS = ("lower_upper", "lower_torso_arms", "lower_torso_larm_rarm", "lower_torso_head_larm_rarm")


def find_collections(owner):
    """Return the bone collections that are joint groups, by the names of the groups."""
    found = owner.data.collections_all
    return {own.name.removeprefix(PREFIX): own for own in found if own.name.startswith(PREFIX)}


def read_groups(rig, base):
    """Return the joint groups of bone collections; None if there are none.

    A bone in none of them belongs to the group of its parent, and without a parent to `base`.
    """
    collections = find_collections(rig.owner)
    if not collections:
        return None
    if base not in collections:
        base = next(iter(collections))
    owners = {}
    for group, collection in collections.items():
        for bone in collection.bones:
            if owners.setdefault(bone.name, group) != group:
                both = f"{PREFIX}{owners[bone.name]} and {PREFIX}{group}"
                raise ValueError(f"Bone {bone.name} is in two groups: {both}")
    members = {group: [] for group in collections}
    found = []
    for joint, (name, parent) in enumerate(zip(rig.rest.names, rig.rest.parents.tolist())):
        found.append(owners.get(name, found[parent] if parent >= 0 else base))
        members[found[-1]].append(name if rig.rest.names.count(name) == 1 else joint)
    return mg.JointGroups({own: joints for own, joints in members.items() if joints}, base=base)


def write_groups(owner, skeleton, groups):
    """Replace the bone collections of joint groups."""
    for collection in find_collections(owner).values():
        owner.data.collections.remove(collection)
    for group, joints in groups.resolve(skeleton).items():
        collection = owner.data.collections.new(PREFIX + group)
        for joint in joints:
            bone = owner.data.bones.get(skeleton.names[joint])
            if bone is not None:
                collection.assign(bone)
