"""Names of body parts and the order of parts along a limb."""

# Ordered from the trunk outwards: a part of a limb is never the child of a later one.
ARM = ("clavicle", "upper_arm", "forearm", "hand", "finger")
LEG = ("thigh", "shank", "foot", "toe")
PARTS = ("pelvis", "trunk", "neck", "head", *ARM, *LEG, "tail", "other")
OPPOSITE_SIDE = {"left": "right", "right": "left", "": ""}
