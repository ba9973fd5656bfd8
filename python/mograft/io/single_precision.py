"""Check of values for formats that store them in single precision."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.motion.skeleton import Skeleton

_LARGEST = 1e38  # sums of three such values are finite in single precision


def check_single_precision(
    kind: str, values: FloatArray, skeleton: Skeleton, owner: str = "", hint: str = ""
) -> None:
    """Raise ValueError if a value is too large for single precision.

    `values` have shape (n_joints, 3) or (n_frames, n_joints, 3). The message states what the values
    are (`kind`, such as "position"), the joint, the frame, the motion (`owner`) and the value, and
    ends with `hint`.
    """
    largest = np.abs(values).max(initial=0.0)
    if largest <= _LARGEST:
        return
    index = tuple(np.argwhere(~(np.abs(values) <= _LARGEST))[0])
    frame = f" in frame {index[0]}" if values.ndim == 3 else ""
    owner = f" of {owner}" if owner else ""
    raise ValueError(
        f"the {kind} of {skeleton.names[index[-2]]}{frame}{owner} must be within the range of "
        f"single precision, -1e38 to 1e38, got {values[index]:.6g}{hint}"
    )
