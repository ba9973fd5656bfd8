"""The comparison of outputs finds differences, and explains those that rules name."""

import json

from release.output_cases import Case, all_cases, old_command
from release.same_outputs import Outcome, compare

CASE = Case("graft/x", ("mograft graft x",))


def outcome(code=0, **files):
    """Return what a step left behind that wrote these files."""
    result = Outcome(CASE.steps, [code])
    for name, text in files.items():
        result.add(name.replace("_", "."), text.encode())
    return result


def find(old, new):
    """Return kind, file, detail and reason of each difference."""
    return [(d.kind, d.file, d.detail, d.reason()) for d in compare(CASE, old, new)]


def test_equal_outputs_have_no_difference():
    assert find(outcome(x_bvh="a"), outcome(x_bvh="a")) == []


def test_each_kind_of_difference_is_found():
    (text,) = find(outcome(x_bvh="a\nb"), outcome(x_bvh="a\nc"))
    assert text == ("output", "x.bvh", "line 2: 'b' became 'c'", None)
    (lost,) = find(outcome(x_bvh="a"), outcome())
    assert lost[2] == "only in old"
    (failed,) = find(outcome(), outcome(code=4))
    assert failed[2].startswith("failed in new: 0, 4")
    page = '<p>{}</p><script type="application/json" id="d">{}</script><script>{}</script>'
    first = outcome(x_html=page.format(1, 2, 3))
    assert {d[0] for d in find(first, outcome(x_html=page.format(1, 2, 4)))} == {"page"}
    for changed in (page.format(1, 5, 3), page.format(5, 2, 3)):
        assert "output" in {d[0] for d in find(first, outcome(x_html=changed))}


def test_rule_explains_only_the_keys_that_it_names():
    old, new = {"request": {"command": ["a"]}, "seed": 1}, {"request": {"command": ["b"]}}
    for seed in (1, 2):
        texts = json.dumps(old), json.dumps(new | {"seed": seed})
        (found,) = find(*(outcome(x_json=text) for text in texts))
        assert (found[3] is not None) == (seed == 1)


def test_fields_are_options_in_the_old_version():
    new = "mograft graft x --set reach_ik=0 --set self_repair=false"
    assert old_command(new) == "mograft graft x --reach-ik 0 --no-self-repair"
    new = "mograft graft x --only-violations --scenario graph --length 9"
    assert old_command(new) == "mograft graft x --repair --scenario graph --frames 9"
    assert old_command("print(1)") == "print(1)"


def test_names_of_cases_are_unique(tmp_path):
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "walk.bvh").touch()
    names = [case.name for case in all_cases(tmp_path)]
    assert len(names) == len({*names})
    assert names[-2:] == ["data/clips", "data/clips/walk.bvh"]
