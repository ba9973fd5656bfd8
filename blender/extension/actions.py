# SPDX-License-Identifier: GPL-3.0-or-later
"""New actions from grafts: keys, markers, provenance; nothing remains if one cannot be written."""

import json
from dataclasses import asdict, replace

import bpy

from .armature import INFLUENCES, RefusedError, show, write_action
from .curves import find_bag, find_slot, write_channel
from .sources import RECORD, SETUP


def write_results(loaded, results, names=None):
    """Return new actions with grafts; remove all of them if one cannot be written."""
    made = []
    try:
        for number, result in enumerate(results):
            base = bpy.data.actions[result.graft.base.name]
            new = base.copy()
            made.append(new)
            new.name = names[number] if names else _free_name(base)
            _fill(loaded, result, new)
    except BaseException:
        bpy.data.batch_remove(made)
        raise
    return made


def _free_name(base):
    """Return ``BASE_graftN`` with the first N that is free."""
    number, stem = 0, base.name[:48]
    while f"{stem}_graft{number}" in bpy.data.actions:
        number += 1
    return f"{stem}_graft{number}"


def _fill(loaded, result, new):
    rig, graft = loaded.rig, result.graft
    if tuple(graft.motion.skeleton.names) != tuple(rig.rest.names):
        raise RefusedError("The bones of most sources differ from those of the base: remove some")
    first = loaded.first[graft.base.name]
    outside = loaded.outside.get(graft.base.name, {})
    written = write_action(rig, new, first, graft.motion, graft.base, outside)
    if loaded.setup.is_visual:
        _turn_off_constraints(rig.owner, new, written, first)
    if new.asset_data is not None:
        new.asset_clear()
    new.use_fake_user = True
    setup = asdict(replace(loaded.setup, others=result.others))
    new[RECORD], new[SETUP] = result.record, json.dumps(setup)
    new["mograft_seed"], new["mograft_newness"] = graft.seed, result.newness
    items = new.mograft.ranges
    items.clear()
    for own in result.ranges:
        item = items.add()
        item.name = f"{own['group']} {own['clip']}"
        for key, value in own.items():
            is_frame = key in ("first", "last")
            setattr(item, key, value + first if is_frame else value)
        item.donor_start = loaded.first.get(own["clip"], 0)
        marker = new.pose_markers.new(item.name[:60])
        marker.frame = item.first


def _turn_off_constraints(owner, action, names, frame):
    """Key the influence of the constraints of bones to 0: the keys contain their effect."""
    bag, stored = find_bag(action, find_slot(action, owner)), {}
    for name in names:
        for own in owner.pose.bones[name].constraints:
            path = own.path_from_id("influence")
            if owner.animation_data.drivers.find(path) is not None:
                raise RefusedError(f"A driver sets the influence of {own.name} of {name}")
            if own.enabled and own.influence:
                stored[path] = own.influence
                write_channel(bag, path, name, [frame], [[0.0]])
    action[INFLUENCES] = json.dumps(stored)


def preview(owner, action):
    """Assign an action to an armature; the present one is kept when the file is saved."""
    old = owner.animation_data_create().action
    if old == action:
        return
    if old is not None and old.library is None and not old.use_fake_user:
        old.use_fake_user = True
    show(owner, action)


def push_down(owner, action):
    """Add a muted track with an action to the NLA of an armature."""
    track = owner.animation_data_create().nla_tracks.new()
    track.name = action.name
    strip = track.strips.new(action.name, int(action.frame_range[0]), action)
    if slot := find_slot(action, owner):
        strip.action_slot = slot
    track.mute = True
