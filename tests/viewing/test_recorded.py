"""Grafts in files: pages and figures read the provenance beside them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from mograft import Library, graft, read_bvh, write_bvh, write_graft
from mograft.cli import main
from mograft.constraints import Reach, Sphere
from mograft.dancer import dance
from mograft.search.pose_constraints import Avoid
from mograft.viewing.scene import Scene
from tests.viewing.page_content import shown

CONSTRAINTS = (
    Avoid(Sphere((0, 80, 200), 30), weight=1.0),
    Reach("LeftHand", (40, 120, 20), frame=50, weight=1.0),
)


@pytest.fixture
def made(tmp_path):
    """A graft that was written to a folder, with the file of its base."""
    write_bvh(dance(seed=1, strides=1).motion[:500], tmp_path / "clip.bvh")
    new = graft(Library.build(tmp_path / "clip.bvh"), seed=3, constraints=CONSTRAINTS)
    (tmp_path / "out").mkdir()
    write_graft(new, tmp_path / "out" / "new.bvh")
    return new


ROW_KEYS = ("group", "start", "stop", "first", "last", "source", "others", "grafted")


def test_view_file_with_provenance_equals_view_of_graft(made, tmp_path):
    want = shown(made)
    got = shown(tmp_path / "out" / "new.bvh")
    assert [clip["name"] for clip in got["clips"]] == ["clip", "new"]
    assert got["objects"] == want["objects"]
    assert len(got["objects"]) == 2
    (want_row,), (got_row,) = (data["clips"][1]["rows"] for data in (want, got))
    assert {key: got_row[key] for key in ROW_KEYS} == {key: want_row[key] for key in ROW_KEYS}
    assert max(got_row["source"]) >= 0
    for key in ("before", "after", "stretch"):
        values = np.array([got_row[key], want_row[key]], float)
        np.testing.assert_allclose(values[0], values[1], atol=0.011)
    assert got["clips"][1]["groups"] == want["clips"][1]["groups"]


def test_view_missing_or_changed_base_shows_graft_alone(made, tmp_path):
    (tmp_path / "clip.bvh").unlink()
    data = shown(tmp_path / "out" / "new.bvh")
    assert [clip["name"] for clip in data["clips"]] == ["new"]
    write_bvh(made.base[:400], tmp_path / "clip.bvh")
    data = shown(tmp_path / "out" / "new.bvh")
    assert [clip["name"] for clip in data["clips"]] == ["new"]
    assert data["clips"][0]["rows"][0]["grafted"]


@pytest.mark.usefixtures("made")
@pytest.mark.parametrize("damage", ["frames", "seams", "substitutions", "groups_toml"])
def test_view_damaged_provenance_warns_and_shows_motion(tmp_path, damage):
    path = tmp_path / "out" / "new.json"
    document = json.loads(path.read_text())
    document[damage] = 3
    path.write_text(json.dumps(document))
    with pytest.warns(UserWarning, match=r"new\.json.*shown without donors"):
        data = shown(path.with_suffix(".bvh"))
    assert [row["group"] for row in data["clips"][0]["rows"]] == ["segments"]
    path.write_text('{"schema": "other/1"}')  # another program's file: no warning
    assert shown(path.with_suffix(".bvh"))["clips"] == data["clips"]


@pytest.mark.usefixtures("made")
def test_view_provenance_of_groups_that_are_numbers_has_all_columns(tmp_path):
    path = tmp_path / "out" / "new.json"
    document = json.loads(path.read_text())
    for own in document["substitutions"]:
        own["group"] = 3
    path.write_text(json.dumps(document))
    (row,) = shown(path.with_suffix(".bvh"))["clips"][1]["rows"]
    assert row["group"] == "3"
    assert len(row["stretch"]) == len(row["start"]) == len(document["substitutions"])


def test_plot_timeline_of_file_hatches_exchanged_segments(made, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    from matplotlib import pyplot

    from mograft.viewing import plot

    axes = plot.timeline(tmp_path / "out" / "new.bvh")
    hatched = [bar for bar in axes.collections if bar.get_hatch() is not None]
    assert len(hatched) == sum(not s.is_own for s in made.substitutions)
    # All donors are of one clip, which has a colour of its own.
    assert len({tuple(bar.get_facecolor()[0]) for bar in hatched}) == 1
    grey = axes.collections[0].get_facecolor()[0]
    assert tuple(hatched[0].get_facecolor()[0]) != tuple(grey)
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["clip · segments", "new · upper"]
    pyplot.close("all")
    files = [str(tmp_path / "clip.bvh"), str(tmp_path / "out" / "new.bvh")]
    assert main(["plot", "timeline", *files, "-o", str(tmp_path / "both.svg")]) == 0


def test_scene_grafts_in_files_share_their_base(made, tmp_path):
    other = replace(made, motion=replace(made.motion, name="other"))
    write_graft(other, tmp_path / "out" / "other.bvh")
    paths = [tmp_path / "out" / f"{name}.bvh" for name in ("new", "other")]
    scene = Scene.of([*paths, read_bvh(tmp_path / "clip.bvh")])
    assert [figure.name for figure in scene.figures] == ["clip", "new", "other"]
    assert len(scene.constraints) == len(CONSTRAINTS)
