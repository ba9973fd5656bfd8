"""``--groups auto`` and ``auto:N``: every command that takes groups."""

import json

import pytest

import mograft as mg
from mograft import JointGroups, Library


def test_automatic_groups_of_every_command_are_those_of_discover(run, folder, tmp_path):
    expected = mg.discover_groups(folder / "a.bvh", 3).groups
    path = tmp_path / "groups.toml"
    assert run("groups", folder / "a.bvh", "--preset", "auto:3", "-o", path)[0] == 0
    assert JointGroups.from_toml(path) == expected
    assert run("index", folder / "a.bvh", "-o", tmp_path / "lib", "--groups", "auto:3")[0] == 0
    assert Library.open(tmp_path / "lib").groups == expected
    code, out, _ = run(
        "graft", folder / "a.bvh", "--groups", "auto:3", "-o", tmp_path / "x.bvh", "--json"
    )
    assert code == 0
    (made,) = json.loads(out)["grafts"]
    assert set(made["groups"]) >= set(expected.names) - {expected.base}
    command = ["candidates", folder / "a.bvh", "--segment", 3, "--groups", "auto:3", "--json"]
    code, out, _ = run(*command)
    assert code == 0
    assert json.loads(out)["group"] == expected.names[1]


def test_automatic_groups_of_folder_use_all_files(run, folder, tmp_path):
    path = tmp_path / "groups.toml"
    assert run("groups", folder, "--preset", "auto", "-o", path)[0] == 0
    assert JointGroups.from_toml(path) == mg.discover_groups(folder).groups


@pytest.mark.parametrize("number", ["x", "1", ""])
def test_automatic_groups_invalid_number_is_usage_error(usage_error, folder, tmp_path, number):
    name = f"auto:{number}"
    message = usage_error("graft", folder / "a.bvh", "--groups", name, "-o", tmp_path / "x.bvh")
    assert (
        f"--groups: must be auto or auto:N with a whole number N of at least 2, got '{name}'"
        in (message)
    )
    message = usage_error("groups", folder / "a.bvh", "--preset", name)
    assert "--preset: must be auto or auto:N" in message


def test_automatic_groups_too_many_fails_with_one_line(run, folder, tmp_path):
    code, _, err = run("graft", folder / "a.bvh", "--groups", "auto:9", "-o", tmp_path / "x.bvh")
    assert code == 1
    assert err.splitlines() == [
        "error: `n` must be a number of groups from 2 to 4 for these clips, got 9: groups consist "
        "of whole chains of joints between branchings of the hierarchy"
    ]
