"""Put grafts on the character of an FBX file, and write them as takes of a new FBX file.

Run it with Blender, or with the Python of the package bpy:

    blender --background --python grafts_to_fbx.py -- CHARACTER.fbx OUT.fbx METRES GRAFT.bvh...

The grafts must have the joints of the character: `mograft graft` made them from FBX files with the
same skeleton. METRES is the length of the unit of CHARACTER.fbx in metres, which `mograft info`
prints: 0.01 for a file in centimetres. Each graft becomes a take with the name of its file. Meshes,
skins and materials are those that Blender imports.
"""

import sys
from pathlib import Path

import bpy
from mathutils import Matrix


def import_character(path):
    """Import the FBX file without its animation; return the armature."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.fbx(filepath=path, use_anim=False)
    return next(item for item in bpy.data.objects if item.type == "ARMATURE")


def import_graft(path, metres):
    """Import a BVH file in the axes that Blender gives to FBX files; return the armature."""
    bpy.ops.import_anim.bvh(
        filepath=path, global_scale=metres, axis_forward="-Z", axis_up="Y", update_scene_fps=True
    )
    return bpy.context.object


def pose(character, graft):
    """Set the pose of the character to that of the graft, and set a key for every bone.

    With respect to their rest poses, both figures have the same world rotations.
    """
    to_armature = character.matrix_world.inverted()
    turn_to_armature = to_armature.to_quaternion()
    matrices = {}
    for bone in character.pose.bones:  # parents first
        rest = bone.bone.matrix_local
        source = graft.pose.bones.get(bone.name)
        parent = bone.parent
        parents = {}
        if parent is not None:
            parents = {
                "parent_matrix": matrices[parent.name],
                "parent_matrix_local": parent.bone.matrix_local,
            }
        if source is None:
            matrix = bone.bone.convert_local_to_pose(Matrix(), rest, **parents)
        else:
            world = (graft.matrix_world @ source.matrix).to_quaternion()
            world_rest = (graft.matrix_world @ source.bone.matrix_local).to_quaternion()
            turn = world @ world_rest.inverted()
            turn = turn_to_armature @ turn @ turn_to_armature.inverted() @ rest.to_quaternion()
            place = to_armature @ graft.matrix_world @ source.head
            matrix = Matrix.LocRotScale(place, turn, None)
        matrices[bone.name] = matrix
        bone.matrix_basis = bone.bone.convert_local_to_pose(matrix, rest, invert=True, **parents)
        bone.rotation_mode = "QUATERNION"
        bone.keyframe_insert("location")
        bone.keyframe_insert("rotation_quaternion")


def transfer(character, path, metres):
    """Make an action of the character from a graft."""
    graft = import_graft(path, metres)
    source = graft.animation_data.action
    source.name = "graft"  # so that the new action can have the name of the file
    character.animation_data_create().action = bpy.data.actions.new(Path(path).stem)
    first, last = map(round, source.frame_range)
    for frame in range(first, last + 1):
        bpy.context.scene.frame_set(frame)
        pose(character, graft)
    bpy.data.objects.remove(graft)
    bpy.data.actions.remove(source)


def main(arguments):
    """Convert the files that the command line names."""
    source, target, metres, *grafts = arguments
    character = import_character(source)
    for path in grafts:
        transfer(character, path, float(metres))
    bpy.ops.export_scene.fbx(filepath=target, add_leaf_bones=False, bake_anim_simplify_factor=0.0)


main(sys.argv[sys.argv.index("--") + 1 :])
