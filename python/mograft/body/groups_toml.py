"""The TOML form of joint groups."""

import json
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mograft.body.group_entries import Entry, Subtree, is_joint, subtree


def groups_to_toml(groups: Mapping[str, tuple[Entry, ...]], base: str) -> str:
    """Return joint groups as TOML text; see `JointGroups.to_toml`."""
    lines = [f"base = {_toml_value(base)}", "", "[groups]"]
    for name, entries in groups.items():
        values = [f"    {_toml_value(entry)}," for entry in entries]
        lines += [f"{_toml_value(name)} = [", *values, "]"]
    return "\n".join(lines) + "\n"


def read_groups(source: str | os.PathLike[str]) -> tuple[dict[str, tuple[Entry, ...]], Any, str]:
    """Read groups and base from TOML, and name the source for messages; see `from_toml`.

    The type of the base is not checked.
    """
    text, place = str(source), "groups"
    if not isinstance(source, str) or "\n" not in source:
        place = str(source)
        try:
            text = Path(source).read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise ValueError(f"{place}: not UTF-8: {error}") from error
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{place}: not valid TOML: {error}") from error
    unknown = sorted(set(table) - {"base", "groups"})
    if unknown or not isinstance(table.get("groups"), dict):
        got = ", ".join(table) or "nothing"
        raise ValueError(f"{place}: must contain a table [groups] and optionally base, got {got}")
    groups = {}
    for name, entries in table["groups"].items():
        if not isinstance(entries, list):
            raise ValueError(f"{place}: group {name!r} must be a list, got {entries!r}")
        groups[name] = tuple(_read_entry(place, name, entry) for entry in entries)
    return groups, table.get("base", "lower"), place


def _toml_value(value: Entry) -> str:
    """Return an entry in TOML syntax: strings are escaped as in JSON, and DEL in addition."""
    if isinstance(value, Subtree):
        return f"{{subtree = {_toml_value(value.joint)}}}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _read_entry(place: str, group: str, entry: object) -> Entry:
    if isinstance(entry, dict) and set(entry) == {"subtree"}:
        entry = entry["subtree"]
        if is_joint(entry):
            return subtree(entry)
    elif is_joint(entry):
        return entry
    raise ValueError(
        f'{place}: group {group!r} must contain names, indices or {{subtree = "name"}}, '
        f"got {entry!r}"
    )
