"""Checks that run in Blender: ``python inside.py ZIP DATA [NAMES]`` prints a line for each.

The script is run by the Python of a `bpy` and imports nothing of the repository.
"""

import hashlib
import json
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

ZIP, DATA = Path(sys.argv[1]), Path(sys.argv[2])
MODULE = "bl_ext.user_default.mograft"
MAX_ERROR = 1e-4  # of the height
CHECKS = {}


def check(function):
    """Add a function to the checks; it returns a remark."""
    CHECKS[function.__name__] = function
    return function


def start():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module=MODULE)


def armature():
    return next(own for own in bpy.data.objects if own.type == "ARMATURE")


def activate(owner):
    bpy.context.view_layer.objects.active = owner
    for other in bpy.context.selected_objects:
        other.select_set(state=False)
    owner.select_set(state=True)
    for track in list(owner.animation_data.nla_tracks if owner.animation_data else ()):
        owner.animation_data.nla_tracks.remove(track)
    return owner


def load_bvh(name="dance_cmu60_salsa/60_01.bvh", **options):
    start()
    bpy.ops.import_anim.bvh(filepath=str(DATA / name), update_scene_fps=True, **options)
    return activate(armature())


def load_glb(*names):
    start()
    for name in names:
        bpy.ops.import_scene.gltf(filepath=str(DATA / "glb" / name))
    return activate(armature())


def load_fbx(name):
    start()
    bpy.ops.import_scene.fbx(filepath=str(DATA / "fbx" / name))
    return activate(armature())


def package():
    import importlib

    return importlib.import_module(MODULE)


def curves_of(action, owner):
    return package().sources.find_curves(action, owner)


def hash_action(action, owner):
    """Return the hash of all keys, handles and modifiers of an action."""
    digest = hashlib.sha256()
    curves = curves_of(action, owner)
    for path, index in sorted(curves):
        curve = curves[path, index]
        digest.update(f"{path}{index}{curve.extrapolation}{len(curve.modifiers)}".encode())
        for name, size in (("co", 2), ("handle_left", 2), ("handle_right", 2)):
            values = np.empty(size * len(curve.keyframe_points), np.float32)
            curve.keyframe_points.foreach_get(name, values)
            digest.update(values)
    return digest.hexdigest()


def keys_of(curve):
    """Return the frames and values of the keys of a curve."""
    flat = np.empty(2 * len(curve.keyframe_points), np.float32)
    curve.keyframe_points.foreach_get("co", flat)
    return flat.tolist()


def hash_all(owner):
    """Return the hashes of all actions that are no grafts, and of the rest pose."""
    actions = {
        own.name: hash_action(own, owner) for own in bpy.data.actions if "mograft_record" not in own
    }
    bones = [(own.name, np.array(own.matrix_local).tolist()) for own in owner.data.bones]
    return actions, bones


def grafts():
    return sorted(
        (own for own in bpy.data.actions if "mograft_record" in own), key=lambda own: own.name
    )


def show(owner, action):
    package().actions.preview(owner, action)


def evaluated_positions(owner, action, frames):
    """Return the world positions of the heads of all bones, as Blender shows them."""
    for bone in owner.pose.bones:
        bone.matrix_basis.identity()
    show(owner, action)
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        pose = owner.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
        found.append([owner.matrix_world @ own.head for own in pose])
    return np.array(found), [own.name for own in owner.pose.bones]


def compare(owner, base, action):
    """Return the largest distance between an action in Blender and its graft, in heights.

    The graft is made again by mograft from the actions as they are read here; and bones that were
    not exchanged must have the curves of the base.
    """
    sources, grafting = package().sources, package().grafting
    setup = sources.Setup.from_action(action)
    loaded = sources.load(setup)
    request = package().operators.request_of(loaded, setup)
    record = action["mograft_record"]
    result = grafting.change(request, record, None, lambda *_: None)
    motion = result.graft.motion
    first = loaded.first[base.name]
    frames = np.unique(np.linspace(first, first + motion.n_frames - 1, 25).astype(int))
    found, names = evaluated_positions(owner, action, frames.tolist())
    expected = motion.world_positions()[frames - first]
    height = float(np.ptp(expected[0], axis=0).max())
    index = [motion.skeleton.names.index(own) for own in names if own in motion.skeleton.names]
    columns = [i for i, own in enumerate(names) if own in motion.skeleton.names]
    error = float(np.abs(found[:, columns] - expected[:, index]).max()) / height
    old, new = curves_of(base, owner), curves_of(action, owner)
    base_joints = result.graft.library.joints(result.graft.library.groups.base)
    kept = {motion.skeleton.names[own] for own in base_joints}
    n_equal = 0
    for key, curve in old.items():
        match = package().sources.BONE_PATH.match(key[0])
        if match is None or match[1] in kept:
            values = [
                np.empty(2 * len(own.keyframe_points), np.float32) for own in (curve, new[key])
            ]
            for own, flat in zip((curve, new[key]), values, strict=True):
                own.keyframe_points.foreach_get("co", flat)
            assert (values[0] == values[1]).all(), key
            n_equal += 1
    assert n_equal > 0
    exchanged = sum(not own.is_own for own in result.graft.substitutions)
    return error, n_equal, exchanged


def generate_and_compare(owner, base=None, **options):
    settings = owner.mograft
    bpy.ops.mograft.add_sources()
    if base is not None:
        settings.base = bpy.data.actions[base]
    base = settings.base or owner.animation_data.action
    before = hash_all(owner)
    n_actions = len(bpy.data.actions)
    assert bpy.ops.mograft.generate(count=2, seed=3, **options) == {"FINISHED"}
    made = grafts()
    assert len(bpy.data.actions) == n_actions + len(made)
    assert hash_all(owner) == before, "the sources differ"
    worst, n_exchanged = 0.0, 0
    for own in made:
        assert own.use_fake_user
        error, n_equal, exchanged = compare(owner, base, own)
        n_exchanged += exchanged
        worst = max(worst, error)
    assert worst < MAX_ERROR, f"{worst} heights"
    assert n_exchanged > 0, "nothing was exchanged"
    assert made[0].pose_markers
    return f"{len(made)} grafts, {n_exchanged} parts, error {worst:.1e}, {n_equal} curves equal"


def refusal(operator, **options):
    """Return the message of an operator that refuses; check that nothing was made."""
    names = {own.name for own in bpy.data.actions}
    try:
        result = operator(**options)
    except RuntimeError as error:
        assert {own.name for own in bpy.data.actions} == names
        return str(error).strip().removeprefix("Error: ")
    raise AssertionError(f"not refused: {result}")


@check
def install():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(
        filepath=str(ZIP), repo="user_default", enable_on_install=True
    )
    assert hasattr(bpy.types, "MOGRAFT_PT_generate")
    names = dir(bpy.ops.mograft)
    expected = {"generate", "batch", "repeat", "next_donor", "accept", "regenerate"}
    assert expected <= set(names), names
    import mograft

    return f"{len(names)} operators, mograft {mograft.__version__}, NumPy {np.__version__}"


@check
def bvh_euler():
    return generate_and_compare(load_bvh())


@check
def bvh_quaternions_scaled():
    name = "skel_snu_wd2/wd2_spiral_walk_slow02.bvh"
    owner = load_bvh(name, rotate_mode="QUATERNION", global_scale=0.01)
    return generate_and_compare(owner)


@check
def glb_kaykit():
    owner = load_glb("kaykit_Med_MovementBasic.glb", "kaykit_Med_MovementAdvanced.glb")
    owner.mograft.variety = "MAXIMUM"
    names = [
        own.name
        for own in bpy.data.actions
        if "Running" in own.name and "HoldingBow" not in own.name
    ]
    return generate_and_compare(owner, names[0])


@check
def fbx_quaternius():
    owner = load_fbx("quaternius_Male_Casual.fbx")
    owner.mograft.variety = "MAXIMUM"
    return generate_and_compare(owner, next(a.name for a in bpy.data.actions if "Walk" in a.name))


def main():
    wanted = sys.argv[3:] or list(CHECKS)
    for name in dict.fromkeys(["install", *wanted]):
        begin = time.perf_counter()
        try:
            remark, is_passed = CHECKS[name](), True
        except BaseException as error:
            remark, is_passed = f"{type(error).__name__}: {error}", False
            traceback.print_exc()
        seconds = time.perf_counter() - begin
        row = {"name": name, "passed": is_passed, "remark": remark, "seconds": seconds}
        print("RESULT" + json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
