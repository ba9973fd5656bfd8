"""Remarks after `mograft graft`: what was not exchanged, why, and which option helps."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from mograft import Config, KeepOriginal, Library, graft, graft_many, read_bvh
from mograft.cli.advice import advise
from mograft.solve.self_repair import RepairedWindow


@pytest.fixture(scope="module")
def library(folder):
    return Library.build(read_bvh(folder / "a.bvh"))


def advice(grafts):
    return advise(grafts[-1], [own.substitutions for own in grafts])


def test_advice_kept_seconds_are_those_of_frames_that_never_differ(library):
    grafts = list(graft_many(library, count=3, seed=1))
    exchanged = np.zeros(grafts[0].base.n_frames - 1, bool)
    for own in (s for new in grafts for s in new.substitutions if not s.is_own):
        exchanged[np.arange(own.start, own.stop)] = True
    seconds = (~exchanged).sum() / library.rate
    assert 0 < seconds < grafts[0].base.duration
    total = grafts[0].base.duration
    expected = f"in {seconds:.1f} of {total:.1f} s no segment was exchanged in any of the 3 motions"
    assert expected in advice(grafts)


def test_advice_counts_segments_without_candidate_by_cause(library):
    new = graft(library, seed=1)
    counts = new.alternatives["upper"]
    (line,) = [line for line in advice([new]) if line.startswith("upper: ")]
    n_without, n = map(int, re.match(r"upper: (\d+) of (\d+) segments", line).groups())
    assert (n_without, n) == ((counts == 0).sum(), len(counts))
    causes = re.search(r"\((.*?)\):", line).group(1)
    assert sum(int(number) for number in re.findall(r"\d+", causes)) == n_without
    assert "raise --variety" in line
    assert "raise --max-stretch (now 0.15)" in line


@pytest.mark.parametrize(
    ("config", "constraints", "cause", "remedy"),
    [
        ({"sigma": 1e-9}, [], "no similar segment", "raise --variety or add clips"),
        ({"sigma_scale": 2.0, "max_stretch": 1e-6, "length_slack": 0.0}, [], "none of sim", "-s"),
        ({}, [KeepOriginal()], "within the constraints", "relax the constraints"),
    ],
)  # fmt: skip
def test_advice_names_cause_and_remedy(library, config, constraints, cause, remedy):
    own = Library.build(library.clips[0], config=Config(**config))
    lines = advice([graft(own, constraints=constraints)])
    assert cause in lines[-1]
    assert remedy in lines[-1]


def test_advice_names_self_repair_if_it_restored_all_segments(library):
    kept = graft(library, seed=1)
    own = tuple(s._replace(donor=s.segment) for s in kept.substitutions)
    window = RepairedWindow(
        group="upper", start=0, stop=20, measure="world jerk", before=4.0, after=0.0
    )
    (line,) = [
        line
        for line in advice([replace(kept, substitutions=own, repairs=(window,))])
        if line.startswith("warning")
    ]
    assert "no segment was exchanged: self-repair restored the captured parts" in line
    assert "--no-self-repair keeps the exchanges" in line


def test_graft_nothing_exchanged_is_a_warning_and_exit_code_0(run, folder):
    code, out, err = run("graft", folder / "a.bvh", "-o", "x.bvh", "--sigma-scale", "0.0001")
    assert (code, out) == (0, "x.bvh\n")
    assert "warning: no segment was exchanged: no segment has a candidate" in err
    assert "no similar segment" in err
    code, _, err = run("graft", folder / "a.bvh", "-o", "y.bvh", "--repair", "--avoid-self")
    assert code == 0
    assert "warning: no segment was exchanged: the base satisfies the constraints" in err
    assert "--variety" not in err


def test_limit_options_above_those_of_the_configuration_raise_them(run, folder):
    stretches = {}
    for limit in ("0.1", "0.5"):
        code, _, _ = run("graft", folder, "-o", f"{limit}.bvh", "--max-stretch", limit)
        assert code == 0
        with open(f"{limit}.json") as file:
            document = json.load(file)
        shares = [1.0 - 1.0 / (1.0 + s["stretch"]) for s in document["substitutions"]]
        stretches[limit] = max(map(abs, shares))
        assert stretches[limit] <= float(limit) + 1e-6
    assert stretches["0.5"] > 0.2
    words = ("candidates", folder, "--segment", 12, "--json")
    plain, wide = (
        json.loads(run(*words, *more)[1])
        for more in ((), ("--max-stretch", "0.9", "--max-angle", "90"))
    )
    assert (wide["max_stretch"], wide["max_angle_degrees"]) == (0.9, 90.0)
    assert len(wide["allowed"]) > len(plain["allowed"])


def test_graft_obstacle_at_kept_joints_ends_before_the_search(run, folder, monkeypatch, tmp_path):
    def search(*_, **__):
        raise AssertionError("the search started")

    for name in ("repair", "graft_many"):
        monkeypatch.setattr(f"mograft.cli.actions.graft.{name}", search)
    clip = read_bvh(folder / "a.bvh")
    _, positions = clip.world_transforms()
    foot = ",".join(f"{value:.3f}" for value in positions[100, clip.skeleton.index("LeftFoot")])
    for words in (
        ["--avoid", f"sphere:{foot},5", "--repair"],
        ["--avoid", f"sphere:{foot},5@95-105", "-n", "2"],
        ["--reach", "100:LeftFoot:0,900,0"],
    ):
        code, out, err = run("graft", folder / "a.bvh", "-o", tmp_path / "out", *words)
        assert (code, out) == (4, "")
        assert re.search("by Left|LeftFoot is", err)
        assert "joints that are not exchanged violate constraints" in err.splitlines()[-1]
        assert not (tmp_path / "out").exists()
    with pytest.raises(AssertionError, match="the search started"):
        run("graft", folder / "a.bvh", "-o", "out", "--avoid", f"sphere:{foot},5", "--best-effort")
    with pytest.raises(AssertionError, match="the search started"):
        run("graft", folder / "a.bvh", "-o", "out", "--avoid", f"sphere:{foot},5@200-210")
