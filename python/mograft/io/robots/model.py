"""`read_model`: the skeleton and hinges of a robot, from a model in MJCF or URDF."""

import os
from collections.abc import Mapping
from math import inf
from pathlib import Path

from mograft.io.clips import errors_of_file
from mograft.io.robots.bodies import to_skeleton
from mograft.io.robots.mjcf import mjcf_bodies
from mograft.io.robots.urdf import urdf_bodies
from mograft.io.robots.xml_tree import read_xml
from mograft.motion import limits
from mograft.motion.hinges import TableLayout
from mograft.motion.skeleton import Skeleton

QUATERNION_ORDERS = ("wxyz", "xyzw")


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
        bodies = mjcf_bodies(root) if root.tag == "mujoco" else urdf_bodies(root)
    if not any(body.joints for body in bodies):
        raise root.error("expected at least one hinge joint, got none")
    names = [joint.name for body in bodies for joint in body.joints]
    if len(set(names)) < len(names):
        raise root.error(f"expected joints of different names, got {', '.join(names)}")
    with errors_of_file(file):
        return to_skeleton(bodies, TableLayout(quaternion or "", rates=tuple(rates.items())))
