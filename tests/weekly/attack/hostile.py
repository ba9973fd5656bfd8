"""Experiments with damaged files that the program reads; each yields the defects of every trial."""

import hashlib
import json
import random
import shutil
from importlib.util import find_spec

from tests.fuzz import change_bytes
from tests.weekly.attack.commands import complaint, run
from tests.weekly.attack.crash import make_inputs

_BATCH = 25  # files that one command checks


_WORDS = [b"1e308", b"-9" * 40, b"nan", b"[" * 300, b"\xff" * 8, b"{", b'"', b"\0" * 4]


def _mutated(data, rng):
    """Return data with one to six random changes."""
    for _ in range(rng.randint(1, 6)):
        data = change_bytes(data, rng, _WORDS)
    return data


def damaged_files(folder, count):
    """Check damaged files of each format, many with one command, alone after a failure."""
    rng = random.Random(0)
    make_inputs(folder)
    kinds = ["bvh", "glb", "npz", *(["usda", "usdc"] if find_spec("pxr") else [])]
    for number in range(-(-count // _BATCH)):
        kind = kinds[number % len(kinds)]
        valid = folder / f"valid.{kind}"
        if not valid.exists():
            code, _, err = run(f"export in/a.bvh -o {valid} --frames 0-9", folder)
            assert code == 0, err
        files = [folder / f"{n}.{kind}" for n in range(_BATCH)]
        for file in files:
            file.write_bytes(_mutated(valid.read_bytes(), rng))
        problem = complaint(*run("check " + " ".join(map(str, files)), folder))
        for file in files:
            alone = problem and complaint(*run(f"check {file}", folder, seconds=20))
            yield f"batch {number}, {file.name}: {alone}" if alone else ""


_TOML = 'seed = 7\n[graft]\nvariety = 0.3\n[set]\nchoice = "viterbi"\nmax_candidates = 8\n'


def _hostile(text, rng):
    """Return a text with a deep value, a number of many digits, or random changes."""
    deep, digits = rng.choice([50, 500, 5_000, 50_000]), rng.choice([20, 400, 5_000])
    kind = rng.randrange(5)
    if kind == 0:
        return text + f"\nx = {'[' * deep}{']' * deep}\n"
    if kind == 1:
        return f"{'.'.join('a' * deep)} = 1\n" + text
    if kind == 2:
        return text.replace("8", "9" * digits).replace("0.3", "3" * digits)
    if kind == 3:
        return text.replace("8", '{"a": ' * deep + "}" * deep)
    return _mutated(text.encode(), rng).decode("utf-8", "replace")


def hostile_texts(folder, count):
    """Read hostile settings, joint groups and provenance."""
    rng, place = random.Random(0), folder / "hostile"
    make_inputs(folder)
    code, groups, err = run("groups in/a.bvh", folder)
    assert code == 0, err
    cases = {
        "mograft.toml": (_TOML, "config show graft"),
        "groups.toml": (groups, "candidates ../in/a.bvh --segment 1 --groups groups.toml"),
        "g.json": ((folder / "made/g.json").read_text(), "graft --from g.json -o g.bvh --force"),
    }
    for number in range(count):
        name, (text, words) = list(cases.items())[number % len(cases)]
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        (place / name).write_text(_hostile(text, rng), encoding="utf-8")
        problem = complaint(*run(words, place, seconds=20))
        yield f"{name} {number}: {problem}" if problem else ""


def damaged_libraries(folder, count):
    """Open libraries with damaged files, and with values that were changed and sealed again."""
    rng, place = random.Random(0), folder / "damaged"
    make_inputs(folder)
    for number in range(-(-count // 2)):
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(folder / "made/l", place)
        if number % 2:
            _seal_changed(place / "manifest.json", rng)
        else:
            files = sorted(own for own in place.rglob("*") if own.is_file() and own.stat().st_size)
            file = rng.choice(files)
            file.write_bytes(_mutated(file.read_bytes(), rng))
        for words in ("lib verify damaged", "graft damaged -o again --force"):
            problem = complaint(*run(words, folder, seconds=30))
            yield f"library {number}, {words}: {problem}" if problem else ""


def _seal_changed(manifest, rng):
    """Change one value of a manifest, and write the checksum of the changed manifest."""
    document = json.loads(manifest.read_text())
    containers = [own for own in document.values() if isinstance(own, dict) and own]
    container = rng.choice([document, *containers])
    key = rng.choice(list(container))
    container[key] = rng.choice([None, -1, 10**400, 1e300, "x", [], {}, True, [[1]], 2**63])
    document.pop("checksum", None)
    text = json.dumps(document, sort_keys=True)
    document["checksum"] = hashlib.sha256(text.encode()).hexdigest()
    manifest.write_text(json.dumps(document))
