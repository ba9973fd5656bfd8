"""The same input, options and seed give the same bytes from the command line and from Python."""

import re
from dataclasses import dataclass, field
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
    config: mg.Config = field(default_factory=mg.Config)
    build: dict[str, Any] = field(default_factory=dict)  # Of `Library.build`.
    call: dict[str, Any] = field(default_factory=dict)  # Of `graft_many`.
    scenario: Any = None  # A function of the library that returns one.
    constraints: Any = ()  # A list, or a function of the library that returns one.
    digits: int | None = None
    make: Any = None  # Replaces `graft_many`: a function of the library.
    source: str = "{folder}"


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


def is_feasible(library, graft):
    limits = mg.evaluation.feasible_limits(library.clips)
    checks = mg.evaluation.robot_checks(graft.motion, graft.base)
    return all(checks[name] <= limits[name] + 1e-6 for name in limits)


WIDE = mg.Config(max_stretch=0.4)
MAX_ANGLE = float(np.radians(60.0))
STEEP = mg.Config(max_angle=MAX_ANGLE)
CASES = [
    Case("--quiet --json --force --digits 3", digits=3),
    Case("--verbose --measure --report -n 2", call={"count": 2}),
    Case(
        "--count 3 --distinct 12 --seed 5",
        call={"count": 3, "distinct": float(np.radians(12.0)), "seed": 5},
    ),
    Case("--base b --skeleton {folder}/a.bvh", call={"base": "b"}),
    Case(
        "--groups lower_torso_arms --swap arms",
        build={"groups": "lower_torso_arms"},
        call={"swap": ["arms"]},
    ),
    Case("--match anatomy --include-grafts", build={"match": "anatomy", "include_grafts": True}),
    Case(
        "--model {walks}/humanoid.xml --quaternion wxyz --fps walk*=25 -n 3 --only-feasible",
        build={"skeleton": {"quaternion": "wxyz", "rate": {"walk*": 25}}},
        make=lambda library: [
            new for new in mg.graft_many(library, count=3) if is_feasible(library, new)
        ],
        source="{walks}",
    ),
    Case("--preset paper --seed 3", mg.Config.paper(), call={"seed": 3}),
    Case("--preset paper-rms", mg.Config.paper(sigma="rms")),
    Case("--variety 0.9", mg.Config.with_variety(0.9)),
    Case(
        "--set seam=offset --set temperature=2 --set self_repair=false -n 2",
        mg.Config(seam="offset", temperature=2.0, self_repair=False),
        call={"count": 2},
    ),
    Case("--mirror", make=lambda library: mg.graft_many(library.with_mirror_images())),
    Case(
        "--reach 3s-3.2s:LeftHand:10,100,20~.4 --reach 30:LeftHand:0,900,0 --best-effort",
        constraints=[
            c.Reach("LeftHand", HAND, tolerance=0.4, frames=(90, 96)),
            c.Reach("LeftHand", (0.0, 900.0, 0.0), tolerance=0.03, frames=(30, 30)),
        ],
    ),
    Case(
        "--avoid sphere:10,100,20,15@0-200 --avoid capsule:900,0,0,900,90,0,5@0s-9s --best-effort "
        "--avoid box:900,0,0,5,5,5 --avoid wall:0,-50,0,0,1,0 --avoid {folder}/b.bvh@300,0,0,90",
        constraints=lambda library: [
            c.Avoid(c.Sphere(HAND, 15.0), frames=(0, 200)),
            c.Avoid(c.Capsule((900.0, 0.0, 0.0), (900.0, 90.0, 0.0), 5.0), frames=(0, 270)),
            c.Avoid(c.Box((900.0, 0.0, 0.0), (5.0, 5.0, 5.0))),
            c.Avoid(c.HalfSpace((0.0, -50.0, 0.0), (0.0, 1.0, 0.0))),
            c.Avoid(c.Character(library.clips[1], (300.0, 0.0, 0.0), np.pi / 2)),
        ],
    ),
    Case(
        "--avoid-self --face 10,100,20@1s-2s --best-effort",
        constraints=[c.AvoidSelf(), c.Face(HAND, frames=(30, 60))],
    ),
    Case(
        "--groups lower_torso_larm_rarm --take larm:5=b:{b4} --ban 8=b --ban 7 --best-effort",
        build={"groups": "lower_torso_larm_rarm"},
        constraints=lambda library: [
            c.Use(5, ("b", *nth_segment(library, 1, 4)), group="larm"),
            c.Ban(8, "b"),
            c.Ban(7, None),
        ],
    ),
    Case(
        "--keep 2s-4s --only-from b --max-angle 60",
        STEEP,
        constraints=[c.KeepOriginal(frames=(60, 120)), c.OnlyFrom(["b"]), c.MaxAngle(MAX_ANGLE)],
    ),
    Case("--not-from b --max-stretch 0.4", WIDE, constraints=[c.NotFrom(["b"]), c.MaxStretch(0.4)]),
    Case("--only-tagged b", constraints=[c.OnlyFrom(tags=["b"])], source="{lib}"),
    Case("--not-tagged b", constraints=[c.NotFrom(tags=["b"])], source="{lib}"),
    Case(
        "--only-violations --avoid sphere:10,100,20,15 --best-effort",
        make=lambda library: [mg.repair(library, constraints=[c.Avoid(c.Sphere(HAND, 15.0))])],
    ),
    Case(
        "--scenario graph --length 200", scenario=lambda library: mg.scenario.fill(library, 200, 0)
    ),
    Case(
        "--scenario graph --path=0,0:150,-30",
        scenario=lambda library: mg.scenario.follow(library, [(0.0, 0.0), (150.0, -30.0)]),
    ),
    Case(
        "--scenario graph --beats 100 --duration 5",
        scenario=lambda library: mg.scenario.to_beats(library, np.arange(9) * 0.6, 0),
    ),
    Case(
        "--scenario graph --among b --duration 5",
        scenario=lambda library: mg.scenario.walk(
            library, 5.0, 0, graph=mg.scenario.transitions(library, ["b"])
        ),
    ),
    Case("--from {first}", make=replayed),
    Case("--from {first} --ban 3", make=lambda library: replayed(library, c.Ban(3))),
    Case(
        "--from {first} --change upper@20-90=b:10-70 --change upper@100-130 -n 2",
        make=lambda library: [changed(replayed(library)[0], rank) for rank in range(2)],
    ),
    Case(
        "--change upper@20-90=b:10-70 --change upper@100-130",
        make=lambda library: [changed(mg.graft(library, constraints=[c.KeepOriginal()]), 0)],
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
    places = {
        "walks": target / "walks",
        "folder": folder,
        "lib": target / "lib",
        "first": target / "first.json",
    }
    return places | {"b4": f"{first}-{last}"}


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
    if case.source == "{lib}":
        library = mg.Library.open(source)
    else:
        build = dict(case.build)
        if "skeleton" in build:
            model = mg.formats.read_model(f"{source}/humanoid.xml", **build.pop("skeleton"))
            build["skeleton"] = model
        library = mg.Library.build(source, config=case.config, **build)
    if case.make is not None:
        grafts = case.make(library)
    else:
        more = {} if case.scenario is None else {"scenario": case.scenario(library)}
        given = case.constraints(library) if callable(case.constraints) else case.constraints
        more["widen"] = not re.search("--variety|--set", case.words)
        grafts = mg.graft_many(library, constraints=given, **case.call, **more)
    written = sorted(own for end in ("bvh", "csv") for own in (tmp_path / "cli").glob(f"*.{end}"))
    assert len(written) == len(grafts)
    for path, new in zip(written, grafts, strict=True):
        mg.write_graft(new, tmp_path / path.name, digits=case.digits)
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


def test_graft_command_and_python_enlarge_clusters_alike(succeed, clip, tmp_path):
    short = tmp_path / "short.bvh"
    mg.write_bvh(mg.read_bvh(clip)[:40], short)
    err = succeed("graft", short, "-o", tmp_path / "cli", "-n", 30)[1]
    grafts = mg.graft_many(mg.Library.build(short), count=30)
    assert grafts.notes
    assert all(note in err for note in grafts.notes)
    written = sorted((tmp_path / "cli").glob("*.bvh"), key=lambda path: int(path.stem[11:]))
    assert len(written) == len(grafts)
    for path, new in zip(written, grafts, strict=True):
        mg.write_graft(new, tmp_path / path.name)
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()
