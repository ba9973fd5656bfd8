"""``mograft doctor``, ``config`` and ``completion``: the installed program and its settings."""

import json
import os
import platform
import re
from importlib import metadata
from pathlib import Path
from typing import Any

from mograft import __version__
from mograft._util.extras import import_extra
from mograft.cli.output import print_result
from mograft.cli.syntax.arguments import Command, UsageError
from mograft.cli.syntax.commands import COMMANDS, CompletionOptions, DoctorOptions, ShowOptions
from mograft.cli.syntax.parser import Setting, build_parsers, find_config_file, find_settings
from mograft.errors import suggest_name

_REQUIRED = "numpy"
_USES_OF_PACKAGES = {
    _REQUIRED: "everything",
    "matplotlib": "mograft plot",
    "pillow": "films, mograft export -o x.gif",
    "imageio-ffmpeg": "films, mograft export -o x.mp4, unless ffmpeg is installed",
    "playwright": "films, mograft export --renderer browser",
    "usd-core": "mograft export -o x.usd",
    "mograft-fbx": "FBX files",
    "pyarrow": "mograft lib export --format parquet",
    "shtab": "mograft completion",
    "scikit-learn": "mograft evaluate",
    "scipy": "mograft evaluate",
    "starlette": "mograft studio",
    "uvicorn": "mograft studio",
}


def run_doctor(options: DoctorOptions) -> int:
    """Print the result of each check; return exit code 1 if a check found a defect, else 0."""
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    results = [
        ("mograft", "ok", __version__),
        ("python", "ok", f"{platform.python_version()} on {system}"),
        *map(_check_package, _USES_OF_PACKAGES),
        ("a graft", *_check_graft()),
    ]
    is_ok = all(state != "broken" for _, state, _ in results)
    lines = [f"{state:7} {what}: {detail}" for what, state, detail in results]
    checks = [dict(zip(("what", "state", "detail"), own, strict=True)) for own in results]
    print_result(options, "doctor/1", {"ok": is_ok, "checks": checks}, lines)
    return 0 if is_ok else 1


def _check_package(name: str) -> tuple[str, str, str]:
    try:
        return name, "ok", metadata.version(name)
    except metadata.PackageNotFoundError:
        state = "broken" if name == _REQUIRED else "absent"
        source = "./python-fbx in a checkout" if name == "mograft-fbx" else name
        return name, state, f"needed for {_USES_OF_PACKAGES[name]}: pip install {source}"


def _check_graft() -> tuple[str, str]:
    """Run all stages on a short dance."""
    try:
        from mograft.dancer import dance
        from mograft.library.library import Library
        from mograft.synthesis.graft import graft

        new = graft(Library.build(dance(strides=1).motion[:300]))
    except Exception as error:
        # Any failure, whatever its type, is the finding of this check.
        return "broken", f"{type(error).__name__}: {error}"
    return "ok", f"{new.motion.n_frames} frames created"


def run_config(options: ShowOptions) -> int:
    """Print the settings of the commands."""
    names = [command.name for command in COMMANDS]
    if options.only not in (None, *names):
        hint = suggest_name(options.only, names)
        raise UsageError(f"COMMAND must be one of {', '.join(names)}; got {options.only}{hint}")
    path, rows = find_config_file(Path.cwd()), list[dict[str, Any]]()
    lines = [f"# {path}" if path is not None else "# no mograft.toml in this folder or above"]
    for command in COMMANDS:
        settings = _find_settings(command) if options.only in (None, command.name) else []
        lines += [f"\n[{command.name}]"] if settings else []
        for name, value, origin in settings:
            line = f"# {name} =" if value is None else f"{name} = {_to_toml(value)}"
            lines.append(f"{line:32} # {origin}" if options.origin else line)
            row = {"command": command.name, "name": name, "value": value, "origin": origin}
            rows.append(row)
    document = {"file": None if path is None else str(path), "settings": rows}
    print_result(options, "config/1", document, lines)
    return 0


def _find_settings(command: Command) -> list[tuple[str, Any, str]]:
    """Return the name, value and origin of each setting of a command.

    The origin is the file or environment variable that sets the value, or ``"default"``.
    """
    found, settings = find_settings(command), list[tuple[str, Any, str]]()
    for argument in command.settings():
        own = found.get(argument.dest, Setting(argument.default, "default", argument.default))
        pairs = own.value if argument.is_repeated else ()  # such as fields of --set
        for name, value in pairs:
            key = name if re.fullmatch("[A-Za-z0-9_-]+", name) else _to_toml(name)
            settings.append((f"{argument.name}.{key}", value, own.origin))
        settings += [] if pairs else [(argument.name, own.plain, own.origin)]
    return settings


def _to_toml(value: object) -> str:
    # TOML has the syntax of JSON, but also requires an escape for the character DEL.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def run_completion(options: CompletionOptions) -> int:
    """Print the completion script of a shell."""
    shtab = import_extra("shtab", "completion needs shtab", "completion")
    parsers = build_parsers(is_completion=True)
    print(shtab.complete(parsers[()], options.shell))
    return 0
