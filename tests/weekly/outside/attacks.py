"""The attacks: each yields the name of what was attacked, and what went wrong or ""."""

import errno
import hashlib
import itertools
import json
import os
import random
import shutil
import signal
import struct
import subprocess
import tempfile
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from tests.weekly.outside.commands import (
    COMMANDS,
    complaint,
    differences,
    make_inputs,
    prepare,
    run,
    start,
    state,
)

CALLS = {
    "open": (errno.EACCES, errno.EMFILE, errno.EROFS),
    "write": (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EINTR, 0),  # 0: half of the bytes
    "sync": (errno.EIO,),
    "close": (errno.EIO,),
    "rename": (errno.EACCES, errno.EIO),
    "mkdir": (errno.ENOSPC,),
}
_CODE_OF_SIGNAL = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -9}
_START_SECONDS = 0.25


def compile_faults(folder):
    """Compile the preloaded library; return its path."""
    target = folder / "faults.so"
    source = Path(__file__).with_name("faults.c")
    words = ["cc", "-shared", "-fPIC", "-O1", "-o", target, source, "-ldl"]
    subprocess.run(words, check=True)
    return target


def failing_calls(folder, scale, rng) -> Iterator[tuple[str, str]]:
    """Fail each call by which each command writes, once for each error."""
    library, counts = compile_faults(folder), folder / "counts"

    def attack(command, call, at, error):
        counts.write_bytes(bytes(8 * (1 + len(CALLS))))
        variables = {
            "LD_PRELOAD": str(library),
            "OUTSIDE_ROOT": str(folder / "work"),
            "OUTSIDE_STATE": str(counts),
            "OUTSIDE_CALL": call,
            "OUTSIDE_AT": str(at),
            "OUTSIDE_ERROR": str(error),
        }
        end = run(command.words, folder, variables)
        return end, struct.unpack(f"q{len(CALLS)}q", counts.read_bytes())

    for command in COMMANDS:
        old = prepare(command, folder)
        code, _, err = run(command.words, folder)
        assert code == 0, err
        new = state(folder)
        prepare(command, folder)
        _, (_, *numbers) = attack(command, "none", 0, 0)
        cases = [
            (call, at, error)
            for (call, errors), number in zip(CALLS.items(), numbers, strict=True)
            for at in range(1, number + 1)
            for error in errors
        ]
        for call, at, error in rng.sample(cases, max(3, round(scale * len(cases)))):
            prepare(command, folder)
            (code, _, err), (n_faults, *_) = attack(command, call, at, error)
            problems = [complaint(code, "", err)] if n_faults or code else []
            found = state(folder)
            problems += [] if command.resumes else differences(found, old, new)
            if code == 0 and found != new:
                problems.append("exit code 0, but not the new state")
            if code and found != new:  # curate does not replace a folder, even if it is its own
                code, _, err = run(command.again(folder), folder)
                found = state(folder)
                if code or (found != new if command.resumes else found.keys() != new.keys()):
                    problems.append(f"next start: exit code {code}: {err[-200:]}")
            place = f"{call} {at} fails with {errno.errorcode.get(error, 'half')}"
            problems = [own for own in problems if own]
            yield command.name, f"{place}: {'; '.join(problems)}" if problems else ""


def random_signals(folder, scale, rng) -> Iterator[tuple[str, str]]:
    """End commands by signals at random moments, 10 % of them during start-up."""
    for command in COMMANDS:
        old = prepare(command, folder)
        begin = time.monotonic()
        code, _, err = run(command.words, folder)
        seconds = time.monotonic() - begin
        assert code == 0, err
        new = state(folder)
        for _ in range(max(1, round(20 * scale))):
            prepare(command, folder)
            number = rng.choice(list(_CODE_OF_SIGNAL))
            is_early = rng.random() < 0.1
            moment = rng.uniform(0.03, _START_SECONDS) if is_early else rng.uniform(0.1, seconds)
            to_group = rng.random() < 0.5
            process = start(command.words, folder)
            time.sleep(moment)
            (os.killpg if to_group else os.kill)(process.pid, number)
            _, err = process.communicate()
            problems = []
            if process.returncode not in (0, _CODE_OF_SIGNAL[number]):
                problems.append(f"exit code {process.returncode}: {err[-300:]}")
            if "Traceback" in err or "Exception ignored" in err:
                problems.append(f"prints {err[-300:]!r}")
            if command.resumes:
                code, _, err = run(command.again(folder), folder)
                problems += [f"next start: {code}: {err[-200:]}"] if code else []
            found = state(folder)
            if number == signal.SIGKILL:
                found = {k: v for k, v in found.items() if k[0] != "." and "/." not in k}
            problems += differences(found, new if command.resumes else old, new)
            place = f"{number.name} after {moment:.2f} s, group {to_group}"
            yield command.name, f"{place}: {'; '.join(problems)}" if problems else ""


def _mutated(data, rng):
    """Return data with one to six random changes."""
    data = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(data) + 1)
        change = rng.randrange(5)
        if change == 0:
            data[at : at + rng.choice([1, 2, 4, 8])] = rng.randbytes(rng.choice([1, 2, 4, 8]))
        elif change == 1:
            del data[at : at + rng.choice([1, 7, 100, len(data)])]
        elif change == 2:
            data[at:at] = data[at : at + rng.choice([1, 20, 300])] * rng.choice([1, 2, 50])
        elif change == 3:
            words = [b"1e308", b"-9" * 40, b"nan", b"[" * 300, b"\xff" * 8, b"{", b'"', b"\0" * 4]
            data[at : at + rng.randrange(9)] = rng.choice(words)
        elif at < len(data):
            data[at] ^= 1 << rng.randrange(8)
    return bytes(data)


_FORMATS = ("bvh", "glb", "npz", *(("usda", "usdc") if find_spec("pxr") else ()))


def mutated_files(folder, scale, rng) -> Iterator[tuple[str, str]]:
    """Check damaged files of each format, many with one command, alone after a failure."""
    for kind in _FORMATS:
        valid = folder / f"valid.{kind}"
        code, _, err = run(f"export in/a.bvh -o {valid} --frames 0-9 --force", folder)
        assert code == 0, err
        data = valid.read_bytes()
        for _ in range(max(1, round(40 * scale))):
            with tempfile.TemporaryDirectory(dir=folder) as batch:
                files = [Path(batch) / f"{number}.{kind}" for number in range(25)]
                for file in files:
                    file.write_bytes(_mutated(data, rng))
                problem = complaint(*run("check " + " ".join(map(str, files)), folder))
                for file in files:
                    alone = problem and complaint(*run(f"check {file}", folder, seconds=20))
                    if alone:
                        shutil.copy(file, folder.parent / f"failed-{file.parent.name}-{file.name}")
                    yield f"files {kind}", alone


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


def hostile_texts(folder, scale, rng) -> Iterator[tuple[str, str]]:
    """Read hostile settings, joint groups, offsets and provenance."""
    code, groups, err = run("groups in/a.bvh", folder)
    assert code == 0, err
    record = (folder / "in" / "g.json").read_text()
    place = folder / "hostile"
    cases = {
        "mograft.toml": (_TOML, "config show graft"),
        "groups.toml": (groups, "candidates ../in/a.bvh --segment 1 --groups groups.toml"),
        "offsets.json": (
            '{"left_hip": [1.0, 0.3, 8], "right_hip": [0.3, 8, 1]}',
            "info ../in/a.bvh --skeleton offsets.json",
        ),
        "g.json": (record, "graft --from g.json -o g.bvh --force"),
    }
    for name, (text, words) in cases.items():
        for _ in range(max(1, round(60 * scale))):
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            (place / name).write_text(_hostile(text, rng), encoding="utf-8")
            yield name, complaint(*run(words, place, seconds=20))


def damaged_libraries(folder, scale, rng) -> Iterator[tuple[str, str]]:
    """Open libraries with damaged files, and with values that were changed and sealed again."""
    place = folder / "damaged"
    for number in range(n_trials := max(2, round(200 * scale))):
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(folder / "in" / "l", place)
        manifest = place / "manifest.json"
        document = json.loads(manifest.read_text())
        is_sealed = 2 * number >= n_trials
        if is_sealed:
            containers = [own for own in document.values() if isinstance(own, dict) and own]
            container = rng.choice([document, *containers])
            key = rng.choice(list(container))
            container[key] = rng.choice([None, -1, 10**400, 1e300, "x", [], {}, True, [[1]], 2**63])
            document.pop("checksum", None)
            text = json.dumps(document, sort_keys=True)
            document["checksum"] = hashlib.sha256(text.encode()).hexdigest()
            manifest.write_text(json.dumps(document))
        else:
            files = sorted(own for own in place.rglob("*") if own.is_file() and own.stat().st_size)
            file = rng.choice(files)
            file.write_bytes(_mutated(file.read_bytes(), rng))
        for words in ("lib verify damaged", "graft damaged -o again --force"):
            end = complaint(*run(words, folder, seconds=30))
            yield (
                f"library, {'sealed' if is_sealed else 'damaged'}",
                f"{words}: {end}" if end else "",
            )


ATTACKS = (failing_calls, random_signals, mutated_files, hostile_texts, damaged_libraries)


def attack(name, scale, seed):
    """Run an attack; yield what was attacked, the number of trials, and the failures."""
    rng = random.Random(f"{name} {seed}")
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent).resolve() / "attack"
        folder.mkdir()
        make_inputs(folder)
        function = next(own for own in ATTACKS if own.__name__ == name)
        for subject, trials in itertools.groupby(function(folder, scale, rng), lambda own: own[0]):
            problems = [problem for _, problem in trials]
            yield subject, len(problems), [own for own in problems if own]
