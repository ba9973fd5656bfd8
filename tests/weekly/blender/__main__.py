"""Check the Blender extension in several versions of Blender: ``python -m tests.weekly.blender``.

Builds the wheel and the zip, installs it in an isolated user folder of each version, runs the
checks of `inside.py` there and prints a table. The exit code is 1 if a check failed.

The `bpy` of each version is installed once, about 1 GB each, into ``.clients`` or, with
``--environments``, into the folders ``bpy-VERSION`` of another folder.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from release.blender import build

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT.parent / "shared" / "data"
VERSIONS = {
    "4.2.23": ("3.11", "numpy==1.24.4"),
    "4.4.0": ("3.11", "numpy==1.26.4"),
    "5.0.1": ("3.11", "numpy==1.26.4"),
    "5.2.3": ("3.13", "numpy"),
}
"""The Python that each `bpy` needs, and NumPy as in Blender itself."""


def main():
    """Run the checks and print a table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--versions", nargs="+", choices=VERSIONS, default=["4.4.0", "5.2.3"])
    parser.add_argument("--only", nargs="+", default=[], help="names of checks")
    parser.add_argument("--wheel", type=Path, help="default: build one")
    parser.add_argument("--environments", type=Path, default=ROOT / ".clients")
    options = parser.parse_args()
    if not DATA.exists():
        print(f"error: {DATA} with the recordings is missing", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as folder:
        wheel = options.wheel or build_wheel(Path(folder))
        archive = build(wheel, Path(folder) / "zip")
        other = Path(folder) / wheel.name.replace(wheel.stem.rpartition("-")[2], "win_amd64")
        shutil.copy(wheel, other)
        os.environ["OTHER_PLATFORM"] = str(build(other, Path(folder) / "other"))
        tables = {}
        for version in options.versions:
            python = find_python(options.environments, version)
            validate(python, archive)
            tables[version] = run(python, archive, options.only, Path(folder) / version)
    names = dict.fromkeys(name for rows in tables.values() for name in rows)
    print("\n| check |", *(f"Blender {own} |" for own in tables))
    print("|---|" + "---|" * len(tables))
    missing = {"passed": False, "remark": "did not run"}
    for name in names:
        rows = [own.get(name, missing) for own in tables.values()]
        cells = [("" if own["passed"] else "**failed** ") + own["remark"] for own in rows]
        print(f"| {name} | {' | '.join(cells)} |")
    is_passed = all(
        rows and all(own["passed"] for own in rows.values()) for rows in tables.values()
    )
    return 0 if is_passed else 1


def build_wheel(folder):
    """Build the wheel of the checkout."""
    words = ["-m", "maturin", "build", "--release", "--quiet", "--out", str(folder)]
    subprocess.run([sys.executable, *words], cwd=ROOT, check=True)
    return next(folder.glob("*.whl"))


def find_python(folder, version):
    """Return the Python with a version of `bpy`, which is installed if it is missing."""
    environment = folder / f"bpy-{version}"
    python = environment / "bin" / "python"
    if not python.exists():
        wanted, numpy = VERSIONS[version]
        subprocess.run([f"python{wanted}", "-m", "venv", environment], check=True)
        words = [python, "-m", "pip", "install", "--quiet", f"bpy=={version}", numpy]
        subprocess.run(words, check=True)
    return python


def validate(python, archive):
    """Run the checks of ``blender --command extension validate``."""
    packages = python.parents[1] / "lib"
    script = next(packages.glob("python*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli"))
    words = [python, script / "blender_ext.py", "validate", archive, "--valid-tags", ""]
    process = subprocess.run(words, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    print(f"{archive.name}: valid for {packages.parent.name}", flush=True)


def run(python, archive, names, folder):
    """Run the checks in a Blender with an empty user folder, and return the result of each."""
    folder.mkdir()
    variables = {"BLENDER_USER_RESOURCES": str(folder), "HOME": str(folder), "PYTHONPATH": ""}
    script = Path(__file__).with_name("inside.py")
    words = [python, script, archive, DATA, *names]
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, text=True, env=os.environ | variables, cwd=folder
    )
    rows = {}
    for line in process.stdout:
        if line.startswith("RESULT"):
            row = json.loads(line.removeprefix("RESULT"))
            rows[row["name"]] = row
            mark = "passed" if row["passed"] else "FAILED"
            print(f"{mark} {row['name']} ({row['seconds']:.1f} s)", flush=True)
    process.wait()
    return rows


if __name__ == "__main__":
    sys.exit(main())
