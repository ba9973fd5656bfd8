"""The same input, options and seed give the same bytes from the command line and from Python."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pytest

import mograft as mg
from mograft import constraints as c
from mograft.cli import main
from mograft.cli.syntax.arguments import arguments_of
from mograft.cli.syntax.options import GraftOptions
from tests.io.robot_files import write_walks

HAND = (10.0, 100.0, 20.0)


@dataclass
class Case:
    """Words of the command line, and what gives the same motions in Python."""

    words: str
    make: Any = mg.graft_many  # A function of the library.
    build: dict[str, Any] = field(default_factory=dict)  # Of `Library.build`.
    digits: int | None = None
    source: str = "{folder}"


def many(**call):
    """Return a function of a library that makes grafts."""
    return partial(mg.graft_many, **call)


def nth_segment(library, clip, number):
    segments = library.segments[library.segments.of_clip(clip)]
    return int(segments.start[number]), int(segments.stop[number])


def replayed(library, *edits):
    new = mg.graft(library, seed=2)
    return [mg.edit(new, *edits) if edits else new]


def changed(graft, rank):
    """The changes of the cases."""
    graft = mg.change(graft, "upper", (20, 90), ("b", 10, 70), rank=rank)
    return mg.change(graft, "upper", (100, 130), rank=rank)


def feasible(library):
    limits = mg.evaluation.feasible_limits(library.clips)
    for new in mg.graft_many(library, count=3):
        checks = mg.evaluation.robot_checks(new.motion, new.base)
        if all(checks[name] <= limits[name] + 1e-6 for name in limits):
            yield new


def in_scenario(make):
    return lambda library: mg.graft_many(library, scenario=make(library))


MAX_ANGLE = float(np.radians(60.0))
PILLAR = c.Capsule((900.0, 0.0, 0.0), (900.0, 90.0, 0.0), 5.0)
CASES = [
    Case("--quiet --json --force --digits 3", digits=3),
    Case("--verbose --measure --report -n 2", many(count=2)),
    Case(
        "--count 3 --distinct 12 --seed 5", many(count=3, distinct=float(np.radians(12.0)), seed=5)
    ),
    Case("--base b --skeleton {folder}/a.bvh", many(base="b")),
    Case(
        "--groups lower_torso_arms --swap arms", many(swap=["arms"]), {"groups": "lower_torso_arms"}
    ),
    Case("--match anatomy --include-grafts", build={"match": "anatomy", "include_grafts": True}),
    Case(
        "--model {walks}/humanoid.xml --quaternion wxyz --fps walk*=25 -n 3 --only-feasible",
        feasible,
        {"skeleton": {"quaternion": "wxyz", "rate": {"walk*": 25}}},
        source="{walks}",
    ),
    Case("--preset paper --seed 3", many(seed=3), {"config": mg.Config.paper()}),
    Case("--preset paper-rms", build={"config": mg.Config.paper(sigma="rms")}),
    Case("--variety 0.9", many(widen=False), {"config": mg.Config.with_variety(0.9)}),
    Case(
        "--set seam=offset --set temperature=2 --set self_repair=false -n 2",
        many(count=2),
        {"config": mg.Config(seam="offset", temperature=2.0, self_repair=False)},
    ),
    Case("--mirror", lambda library: mg.graft_many(library.with_mirror_images())),
    Case(
        "--reach 3s-3.2s:LeftHand:10,100,20~.4 --reach 30:LeftHand:0,900,0 --best-effort",
        many(
            constraints=[
                c.Reach("LeftHand", HAND, tolerance=0.4, frames=(90, 96)),
                c.Reach("LeftHand", (0.0, 900.0, 0.0), tolerance=0.03, frames=(30, 30)),
            ]
        ),
    ),
    Case(
        "--avoid sphere:10,100,20,15@0-200 --avoid capsule:900,0,0,900,90,0,5@0s-9s --best-effort "
        "--avoid box:900,0,0,5,5,5 --avoid wall:0,-50,0,0,1,0 --avoid {folder}/b.bvh@300,0,0,90",
        lambda library: mg.graft_many(
            library,
            constraints=[
                c.Avoid(c.Sphere(HAND, 15.0), frames=(0, 200)),
                c.Avoid(PILLAR, frames=(0, 270)),
                c.Avoid(c.Box((900.0, 0.0, 0.0), (5.0, 5.0, 5.0))),
                c.Avoid(c.HalfSpace((0.0, -50.0, 0.0), (0.0, 1.0, 0.0))),
                c.Avoid(c.Character(library.clips[1], (300.0, 0.0, 0.0), np.pi / 2)),
            ],
        ),
    ),
    Case(
        "--avoid-self --face 10,100,20@1s-2s --best-effort",
        many(constraints=[c.AvoidSelf(), c.Face(HAND, frames=(30, 60))]),
    ),
    Case(
        "--groups lower_torso_larm_rarm --take larm:5=b:{b4} --ban 8=b --ban 7 --best-effort",
        lambda library: mg.graft_many(
            library,
            constraints=[
                c.Use(5, ("b", *nth_segment(library, 1, 4)), group="larm"),
                c.Ban(8, "b"),
                c.Ban(7, None),
            ],
        ),
        {"groups": "lower_torso_larm_rarm"},
    ),
    Case(
        "--keep 2s-4s --only-from b --max-angle 60",
        many(
            constraints=[c.KeepOriginal(frames=(60, 120)), c.OnlyFrom(["b"]), c.MaxAngle(MAX_ANGLE)]
        ),
        {"config": mg.Config(max_angle=MAX_ANGLE)},
    ),
    Case(
        "--not-from b --max-stretch 0.4",
        many(constraints=[c.NotFrom(["b"]), c.MaxStretch(0.4)]),
        {"config": mg.Config(max_stretch=0.4)},
    ),
    Case("--only-tagged b", many(constraints=[c.OnlyFrom(tags=["b"])]), source="{lib}"),
    Case("--not-tagged b", many(constraints=[c.NotFrom(tags=["b"])]), source="{lib}"),
    Case(
        "--only-violations --avoid sphere:10,100,20,15 --best-effort",
        lambda library: [mg.repair(library, constraints=[c.Avoid(c.Sphere(HAND, 15.0))])],
    ),
    Case(
        "--scenario graph --length 200",
        in_scenario(lambda library: mg.scenario.fill(library, 200, 0)),
    ),
    Case(
        "--scenario graph --path=0,0:150,-30",
        in_scenario(lambda library: mg.scenario.follow(library, [(0.0, 0.0), (150.0, -30.0)])),
    ),
    Case(
        "--scenario graph --beats 100 --duration 5",
        in_scenario(lambda library: mg.scenario.to_beats(library, np.arange(9) * 0.6, 0)),
    ),
    Case(
        "--scenario graph --among b --duration 5",
        in_scenario(
            lambda library: mg.scenario.walk(
                library, 5.0, 0, graph=mg.scenario.transitions(library, ["b"])
            )
        ),
    ),
    Case("--from {first}", replayed),
    Case("--from {first} --ban 3", lambda library: replayed(library, c.Ban(3))),
    Case(
        "--from {first} --change upper@20-90=b:10-70 --change upper@100-130 -n 2",
        lambda library: [changed(replayed(library)[0], rank) for rank in range(2)],
    ),
    Case(
        "--change upper@20-90=b:10-70 --change upper@100-130",
        lambda library: [changed(mg.graft(library, constraints=[c.KeepOriginal()]), 0)],
    ),
]


@pytest.fixture(scope="module")
def places(folder, tmp_path_factory):
    """Where the words of a case find clips, a library of them, and a graft."""
    target = tmp_path_factory.mktemp("parity")
    (target / "tags.csv").write_text("clip,tag\nb,b\n")
    words = ["index", str(folder), "-o", str(target / "lib"), "--tags", str(target / "tags.csv")]
    assert main(words) == 0
    assert main(["graft", str(folder), "-o", str(target / "first.bvh"), "--seed", "2"]) == 0
    first, last = nth_segment(mg.Library.open(target / "lib"), 1, 4)
    write_walks(target / "walks")
    own = {name: target / name for name in ("walks", "lib")}
    return own | {"folder": folder, "first": target / "first.json", "b4": f"{first}-{last}"}


def test_parity_cases_cover_all_options_of_graft():
    words = {word.partition("=")[0] for case in CASES for word in case.words.split()}
    words |= {"--into", "--as"}  # of .glb files: test_formats.py
    words |= {"--project"}  # tests/studio
    for option in arguments_of(GraftOptions):
        assert option.is_positional or option.is_required or words & set(option.flags), option


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.words)
def test_graft_command_and_python_give_same_bytes(succeed, places, tmp_path, case):
    source = case.source.format(**places)
    words = case.words.format(**places).split()
    succeed("graft", source, "-o", tmp_path / "cli", *words)
    build = dict(case.build)
    if "skeleton" in build:
        build["skeleton"] = mg.formats.read_model(f"{source}/humanoid.xml", **build["skeleton"])
    is_stored = case.source == "{lib}"
    library = mg.Library.open(source) if is_stored else mg.Library.build(source, **build)
    assert_written(list(case.make(library)), tmp_path, case.digits)


def assert_written(grafts, folder, digits=None):
    """Assert that the motions in the folder ``cli`` are those of the grafts, byte for byte."""
    paths = [path for path in (folder / "cli").iterdir() if path.suffix in (".bvh", ".csv")]
    paths.sort(key=lambda path: (len(path.stem), path.stem))  # 2 before 10
    assert len(paths) == len(grafts)
    for path, new in zip(paths, grafts, strict=True):
        mg.write_graft(new, folder / path.name, digits=digits)
        assert (folder / path.name).read_bytes() == path.read_bytes()


def test_graft_command_and_python_enlarge_clusters_alike(succeed, clip, tmp_path):
    short = tmp_path / "short.bvh"
    mg.write_bvh(mg.read_bvh(clip)[:40], short)
    err = succeed("graft", short, "-o", tmp_path / "cli", "-n", 30)[1]
    grafts = mg.graft_many(mg.Library.build(short), count=30)
    assert grafts.notes
    assert all(note in err for note in grafts.notes)
    assert_written(grafts, tmp_path)
