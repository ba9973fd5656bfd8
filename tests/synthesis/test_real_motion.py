"""The main job on real motion, where it is at hand: ``../shared/data`` beside the checkout."""

import json
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

from mograft import JointGroups, Library, read_bvh
from mograft.cli import main
from tests.hierarchies import DATA

SOURCES = (
    "paper_shape_57dof/paper_shape_A.bvh",
    "dance_perfume_test",
    "dance_cmu94_indian_30fps",
    "database_vsports_basket",
    "skel_neuron_354dof",
    "synthetic_quadruped",
    "bandai_ds1",
)


def at(source):
    path = DATA / source
    if not path.exists():
        pytest.skip(f"{source} is not at hand below {DATA}")
    return path


@pytest.mark.parametrize("source", SOURCES)
def test_three_different_grafts_with_the_legs_of_the_input(source, tmp_path, capsys):
    path = at(source)
    assert main(["graft", str(path), "-o", str(tmp_path), "-n", "3"]) == 0
    written = [Path(line) for line in capsys.readouterr().out.split()]
    # In the recording of "skel_neuron_354dof" only two segments have a candidate.
    n_different = 2 if source == "skel_neuron_354dof" else 3
    assert n_different <= len(written) <= 3
    base = read_bvh(path if path.is_file() else sorted(path.rglob("*.bvh"))[0])
    lower = JointGroups.preset("lower_upper", base.skeleton).resolve(base.skeleton)["lower"]
    columns = [c for joint in lower for c in base.skeleton.channel_columns[joint]]
    news = [read_bvh(file) for file in written]
    for file, new in zip(written, news, strict=True):
        assert_array_equal(new.channel_values[:, columns], base.channel_values[:, columns])
        document = json.loads(file.with_suffix(".json").read_text())
        assert document["base"] == base.name
        assert any(s["exchanged"] for s in document["substitutions"])
    assert len({new.channel_values.tobytes() for new in news}) >= n_different


NAMINGS = ("mixamo_names_XYZ", "biped_names_spaces_ZXY")


@pytest.mark.filterwarnings("ignore:.* excluded as donors")
def test_names_and_rotation_orders_change_no_segment():
    """One take under other names: the same segments and the same clusters."""
    takes = [read_bvh(at(f"synthetic_names/{n}.bvh")) for n in NAMINGS]
    libraries = [Library.build(take) for take in takes]
    first, second = (library.segments for library in libraries)
    assert_array_equal(first.start, second.start)
    for group in ("lower", "upper"):
        one, other = (library.labels[group] for library in libraries)
        assert_array_equal(one, other)
