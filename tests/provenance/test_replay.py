"""Replay: every kind of graft is made again from its provenance, bit for bit."""

import contextlib
import hashlib
import json
import re
import shutil
from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.config import CHOICES
from mograft.dancer import dance
from mograft.scenario import fill, follow
from tests.strategies import SEEDS, few_examples


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of three clips; ``c.bvh`` has another frame rate."""
    folder = tmp_path_factory.mktemp("clips")
    motion = dance(seed=1, strides=1).motion
    mg.write_bvh(motion[:500], folder / "a.bvh")
    mg.write_bvh(motion[400:900], folder / "b.bvh")
    mg.write_bvh(motion[900:1200].resample(25.0), folder / "c.bvh")
    return folder


@pytest.fixture(scope="module")
def library(folder):
    return mg.Library.build([folder / "a.bvh", folder / "b.bvh"])


@pytest.fixture(scope="module")
def four_groups(folder):
    return mg.Library.build([folder / "a.bvh", folder / "b.bvh"], "lower_torso_larm_rarm")


def check_replay(graft, tmp_path, library=None):
    """Check that a graft is made again from its file."""
    path = tmp_path / "new.bvh"
    mg.write_graft(graft, path)
    again = mg.replay(path.with_suffix(".json"), library)
    assert mg.graft_record(again, tmp_path) == mg.graft_record(graft, tmp_path)
    assert mg.advise(again) == mg.advise(graft)
    mg.write_graft(again, tmp_path / "again.bvh")
    for ending in (".bvh", ".json"):
        expected = path.with_suffix(ending).read_bytes()
        assert (tmp_path / "again.bvh").with_suffix(ending).read_bytes() == expected


def target_of(library, frame=100):
    motion = mg.graft(library, seed=3).motion
    return tuple(motion.world_positions()[frame, motion.skeleton.index("LeftHand")].tolist())


@pytest.fixture(scope="module")
def constraints(library, folder):
    """Return constraints of all kinds, by name."""
    hand = target_of(library)
    other = mc.Character(mg.read_bvh(folder / "b.bvh"), (80, 0, 0), yaw=1.0, delay=0.5)
    return {
        "use": [mc.Use(3, 20), mc.Ban(5), mc.Ban(6, "b")],
        "keep": [mc.KeepOriginal(frames=(100, 200))],
        "clips": [mc.OnlyFrom("b"), mc.NotFrom("b", (0, 50), weight=1.0)],
        "limits": [mc.MaxStretch(0.1), mc.MaxAngle(0.5)],
        "reach": [mc.Reach("LeftHand", hand, 100, 0.05)],
        "unreachable": [mc.Reach("LeftHand", (900, 900, 900), 100)],
        "avoid": [
            mc.Avoid(mc.Sphere(hand, 5.0)),
            mc.Avoid(mc.Capsule((0, 0, 500), (0, 200, 500), 10.0), weight=1.0),
            mc.AvoidSelf(frames=(0, 50)),
            mc.KeepOut("LeftHand", mc.Box((0, 0, 500), (1, 1, 1))),
            mc.Avoid(mc.HalfSpace((0, 0, 900), (0, 0, -1))),
            mc.Face((0, 150, 900), weight=0.5),
        ],
        "character": [mc.Avoid(other)],
        "custom": [mc.Custom(lambda poses: np.full(len(poses), 2.0), "never")],
    }


KINDS = "use keep clips limits reach unreachable avoid character custom"


@pytest.mark.parametrize("name", [*KINDS.split(), "repair"])
def test_replay_of_graft_with_constraints_is_identical(library, constraints, tmp_path, name):
    if name == "repair":
        graft = mg.repair(library, constraints=constraints["avoid"][:1])
    else:
        graft = mg.graft(library, constraints=constraints[name], seed=3)
    check_replay(graft, tmp_path)
    check_replay(graft, tmp_path, library)


@few_examples(12)
@given(
    seed=SEEDS,
    choice=st.sampled_from(CHOICES["choice"]),
    seam=st.sampled_from(CHOICES["seam"]),
    torso=st.sampled_from(CHOICES["torso"]),
    sigma_scale=st.sampled_from([0.5, 0.75, 1.5]),
    swap=st.sets(st.sampled_from(["torso", "larm", "rarm"]), min_size=1),
)
def test_replay_of_any_configuration_is_identical(
    four_groups, tmp_path_factory, seed, choice, seam, torso, sigma_scale, swap
):
    config = mg.Config(choice=choice, seam=seam, torso=torso, sigma_scale=sigma_scale)
    graft = mg.graft_many(four_groups.relabelled(config), "b", 2, swap=sorted(swap), seed=seed)[-1]
    check_replay(graft, tmp_path_factory.mktemp("replay"))


@pytest.mark.parametrize("base", ["root", "divided"])
def test_replay_of_root_or_divided_joint_is_identical(folder, tmp_path, base):
    names = mg.read_bvh(folder / "a.bvh").skeleton.names
    lower = [n for n in names if n == "Hips" or "Leg" in n or "Foot" in n]
    upper = [n for n in names if n not in lower]
    if base == "divided":
        lower += ["Spine.Yrotation"]
        upper = ["Spine.Xrotation", "Spine.Zrotation", *(n for n in upper if n != "Spine")]
    groups = mg.JointGroups(
        {"lower": lower, "upper": upper}, base="upper" if base == "root" else "lower"
    )
    graft = mg.graft(mg.Library.build(folder / "a.bvh", groups), seed=1)
    assert (graft.feet is not None) == (base == "root")
    check_replay(graft, tmp_path)


def scenarios(library):
    end = library.clips[0].world_positions()[0, library.root]
    return {
        "segments": [3, 4, 20, 21, 2],
        "array": library.segments.of_clip(1),
        "fill": fill(library, 120, 2),
        "follow": follow(library, [(end[0], end[2]), (end[0] + 100.0, end[2] + 50.0)]),
    }


@pytest.mark.parametrize("name", ["segments", "array", "fill", "follow"])
def test_replay_of_scenario_is_identical(library, tmp_path, name):
    graft = mg.graft(library, scenario=scenarios(library)[name], seed=1)
    check_replay(graft, tmp_path)
    check_replay(graft, tmp_path, library)


@pytest.mark.filterwarnings("ignore:resampled")
def test_replay_from_stored_library_needs_no_file(folder, tmp_path):
    clips = tmp_path / "clips"
    shutil.copytree(folder, clips)
    library = mg.Library.index(clips, tmp_path / "dance.mograft")
    graft = mg.graft(library, "b", seed=1)
    shutil.rmtree(clips)
    check_replay(graft, tmp_path)


@pytest.mark.filterwarnings("ignore:resampled")
@pytest.mark.parametrize("base", ["a", "c"])
def test_replay_of_resampled_and_mirrored_clips_is_identical(folder, tmp_path, base):
    rates = {"b": 29.0}
    sources = [folder / f"{name}.bvh" for name in "abc"]
    library = mg.Library.build(sources, frame_rates=rates).with_mirror_images()
    graft = mg.graft(library, base, seed=1)
    assert any(clip["is_mirrored"] for clip in mg.graft_record(graft)["clips"])
    check_replay(graft, tmp_path)


@pytest.mark.filterwarnings("ignore:.*resampled")
@pytest.mark.parametrize("base", ["b.bvh", "c.bvh"])
def test_replay_of_base_outside_the_library_is_identical(folder, tmp_path, base):
    library = mg.Library.build(folder / "a.bvh")
    graft = mg.graft(library, mg.read_bvh(folder / base), seed=1)
    check_replay(graft, tmp_path)
    check_replay(graft, tmp_path, library)
    own = replace(mg.read_bvh(folder / base), name="a")
    check_replay(mg.graft(library, own, seed=1), tmp_path)


@pytest.mark.parametrize("is_read", [False, True])
def test_replay_of_motion_that_no_file_holds_needs_the_library(folder, tmp_path, is_read):
    """Also of a part of the motion of a file."""
    motion = mg.read_bvh(folder / "a.bvh")[100:400] if is_read else dance(strides=1).motion[:300]
    library = mg.Library.build(motion)
    graft = mg.graft(library, seed=1)
    check_replay(graft, tmp_path, library)
    with pytest.raises(mg.ProvenanceError, match="is not from a file"):
        mg.replay(mg.graft_record(graft))


def test_provenance_lists_contributing_clips_only(folder, tmp_path):
    copies = []
    for number in range(4):
        copies.append(tmp_path / f"other{number}.bvh")
        shutil.copy(folder / "b.bvh", copies[-1])
    library = mg.Library.build([folder / "a.bvh", *copies])
    graft = mg.graft(library, constraints=[mc.OnlyFrom("other2")], seed=1)
    clips = mg.graft_record(graft, tmp_path)["clips"]
    assert [clip["name"] for clip in clips] == ["a", "other2"]
    assert clips[1]["file"] == "other2.bvh"
    assert clips[1]["sha256"] == hashlib.sha256(copies[2].read_bytes()).hexdigest()


def test_replay_changed_or_missing_file_names_file_and_hashes(folder, tmp_path):
    clips = tmp_path / "clips"
    shutil.copytree(folder, clips)
    library = mg.Library.build([clips / "a.bvh", clips / "b.bvh"])
    mg.write_graft(mg.graft(library, seed=1), tmp_path / "new.bvh")
    path = tmp_path / "new.json"
    before = hashlib.sha256((clips / "b.bvh").read_bytes()).hexdigest()
    with (clips / "b.bvh").open("a") as stream:
        stream.write("\n")
    after = hashlib.sha256((clips / "b.bvh").read_bytes()).hexdigest()
    with pytest.raises(mg.ProvenanceError) as caught:
        mg.replay(path)
    for part in (str(path), str(clips / "b.bvh"), before, after):
        assert part in str(caught.value)
    (clips / "b.bvh").unlink()
    with pytest.raises(mg.ProvenanceError, match=r"new\.json: .*b\.bvh is missing"):
        mg.replay(path)
    again = mg.replay(path, sources=[str(folder)])
    assert again.motion.n_frames == 500


def test_replay_another_library_names_both_hashes(folder, library):
    document = mg.graft_record(mg.graft(library, seed=1))
    other = mg.Library.build(folder / "b.bvh")
    expected = document["library"]["sha256"]
    with pytest.raises(mg.ProvenanceError, match=rf"[0-9a-f]{{64}}, expected {expected}"):
        mg.replay(document, other)


def request(constraints):
    """A change of the request of a document."""
    kept = {"method": "graft", "base": None, "swap": None, "command": None, "sources": []}
    return {"request": kept | {"constraints": constraints}}


NESTED = reduce(lambda inner, _: [inner], range(10_000), [])
DAMAGED = {
    "schema": ({"schema": "mograft.candidates/1"}, "mograft.candidates/1"),
    "no donors": ({"substitutions": []}, "substitutions"),
    "clip": ({"clips": [{"name": "a"}]}, "is missing"),
    "config": ({"config": {"novel": 3}}, "novel"),
    "groups": ({"groups_toml": "="}, "TOML"),
    "constraint": (request([{"kind": "X"}]), "'X'"),
    "nested constraint": (request([{"kind": "Ban", "donor": NESTED}]), "recursion"),
    "digits": ({"digits": 99}, "`digits` must be an integer from 1 to 12, got 99"),
    "poses": ({"poses_sha256": "0" * 64}, "differs from that of the provenance"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_replay_damaged_document_raises_provenance_error(library, name):
    changes, message = DAMAGED[name]
    document = mg.graft_record(mg.graft(library, seed=1))
    with pytest.raises(mg.ProvenanceError, match=message):
        mg.replay({**document, **changes}, library)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"schema": 3}', "\xff"])
def test_replay_other_file_raises_provenance_error(tmp_path, text):
    path = tmp_path / "new.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(mg.ProvenanceError, match=r"new\.json"):
        mg.replay(path)


@pytest.fixture(scope="module")
def text(library, constraints):
    used = [*constraints["use"], *constraints["unreachable"]]
    return json.dumps(mg.graft_record(mg.graft(library, constraints=used, seed=1)))


def places(value):
    """Return the keys that lead to each value of a JSON document, of lists to the first two."""
    if isinstance(value, list):
        items = list(enumerate(value[:2]))
    else:
        items = list(value.items()) if isinstance(value, dict) else []
    return [way for key, own in items for way in [(key,), *((key, *w) for w in places(own))]]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@few_examples(60)
@given(data=st.data())
def test_replay_document_without_a_value_raises_provenance_error_only(library, text, data):
    """Values of the document are removed, or replaced by others, at random places."""
    document = json.loads(text)
    *way, key = data.draw(st.sampled_from(places(document)))
    place = document
    for step in way:
        place = place[step]
    if data.draw(st.booleans()):
        del place[key]
    else:
        place[key] = data.draw(st.sampled_from([None, -1, 3.5, "x", [], {}, [1], True, 10**9]))
    with contextlib.suppress(mg.ProvenanceError):
        mg.replay(document, library)


def test_every_key_of_the_provenance_is_documented(library):
    text = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    section = text.partition("## Provenance of a graft")[2].partition("\n## ")[0]
    documented = set(re.findall(r"`([a-z_0-9]+)`", section))
    reach = mc.Reach("LeftHand", (900, 900, 900), 5)
    graft = mg.graft(library, constraints=[reach], scenario=[3, 4, 20, 5, 9], seed=1)
    graft = mg.edit(graft, mc.Use(2, 30))
    document = mg.graft_record(graft)
    parts = [document, document["request"], document["library"], document["scenario"]]
    lists = ("clips", "substitutions", "edits", "seams", "violations", "reach_ik")
    parts += [document[name][0] for name in lists]
    assert set().union(*parts) <= documented
