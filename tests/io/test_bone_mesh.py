"""The mesh of exported files."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mograft.dancer import dance
from mograft.io.bone_mesh import bone_mesh
from mograft.io.units import ExportTransform
from mograft.motion import rotations
from tests.dialects import skeletons
from tests.hierarchies import human
from tests.oracles import bone_mesh as oracle
from tests.strategies import few_examples


@st.composite
def transforms(draw):
    turned = rotations.from_axis_angle([1.0, 0.0, 0.0], draw(st.sampled_from([0.0, np.pi / 2])))
    scale = draw(st.sampled_from([1.0, 0.01, 0.0254]))
    return ExportTransform(scale, "given", 1, turned)


@few_examples(60)
@given(skeletons() | st.just(human()) | st.just(dance(strides=1).motion.skeleton), transforms())
def test_bone_mesh_any_skeleton_equals_oracle_bit_for_bit(skeleton, transform):
    for actual, expected in zip(
        bone_mesh(skeleton, transform), oracle.bone_mesh(skeleton, transform), strict=True
    ):
        assert actual.dtype == expected.dtype
        assert actual.shape == expected.shape
        assert actual.tobytes() == expected.tobytes()
