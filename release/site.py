"""Place the documentation of one version into the site: ``python -m release.site BUILD SITE``.

With ``--push`` the site is the branch `BRANCH` of the repository, and is pushed to `origin`.

The site holds one folder per version: MAJOR.MINOR, and `dev` for unreleased ones. Patch versions
replace the pages of their minor version. The pages read `versions.json` of the site for the menu of
versions; `index.html` of the site leads to the newest release, or to `dev` before the first one.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from release.distributions import ROOT

BRANCH = "gh-pages"
DEVELOPMENT = "dev"

_RELEASE = re.compile(r"v?(\d+)\.(\d+)(?:\.\d+)?")
_REDIRECT = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>mograft</title>
<meta http-equiv="refresh" content="0; url={name}/">
<a href="{name}/">mograft {name}</a>
</html>
"""


def name_folder(version: str) -> str:
    """Return the folder of a version or a tag, such as 0.1 for ``v0.1.2``.

    Raises ValueError if it is neither a release nor `DEVELOPMENT`.
    """
    if version == DEVELOPMENT:
        return version
    match = _RELEASE.fullmatch(version)
    if match is None:
        raise ValueError(f"version must be MAJOR.MINOR.PATCH or {DEVELOPMENT}, got {version}")
    return f"{int(match[1])}.{int(match[2])}"


def list_versions(site: Path) -> list[str]:
    """Return the names of the versions in a site: `DEVELOPMENT`, then the newest release first."""
    names = [path.parent.name for path in site.glob("*/index.html")]
    releases = [name for name in names if _RELEASE.fullmatch(name)]
    releases.sort(key=lambda name: [int(word) for word in name.split(".")], reverse=True)
    return [DEVELOPMENT] * (DEVELOPMENT in names) + releases


def place(build: Path, site: Path, version: str) -> list[str]:
    """Copy a build of the documentation into the site; return the versions of the site.

    Raises ValueError if `build` has no start page or no search index.
    """
    folder = site / name_folder(version)
    for name in ("index.html", "search.html", "searchindex.js"):
        if not (build / name).exists():
            raise ValueError(f"{build} has no {name}")
    site.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(build, folder, ignore=shutil.ignore_patterns(".doctrees", ".buildinfo"))
    names = list_versions(site)
    releases = [name for name in names if name != DEVELOPMENT]
    newest = (releases or names)[0]
    versions = [{"name": name, "is_newest_release": name in releases[:1]} for name in names]
    (site / "versions.json").write_text(json.dumps(versions, indent=1) + "\n", encoding="utf-8")
    (site / "index.html").write_text(_REDIRECT.format(name=newest), encoding="utf-8")
    (site / ".nojekyll").touch()  # GitHub Pages would drop folders that begin with an underscore
    return names


def publish(repository: Path, build: Path, version: str, site: Path) -> list[str]:
    """Place a build into `BRANCH` of the remote `origin` and push; return the versions of the site.

    `site` is a folder for a copy of the branch, which is made and removed. Nothing is pushed if the
    pages are those of the branch already. Raises CalledProcessError if git fails.
    """

    def git(*words: str, folder: Path = repository) -> str:
        identity = ["-c", "user.name=mograft", "-c", "user.email=mograft@users.noreply.github.com"]
        process = subprocess.run(
            ["git", "-C", str(folder), *identity, *words],
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
        return process.stdout.strip()

    is_new = not git("ls-remote", "--heads", "origin", BRANCH)
    if is_new:
        tree = git("hash-object", "-w", "-t", "tree", os.devnull)
        start = git("commit-tree", tree, "-m", "Begin the site")
    else:
        git("fetch", "--quiet", "origin", BRANCH)
        start = git("rev-parse", "FETCH_HEAD")
    git("worktree", "add", "--quiet", "--force", "--detach", str(site), start)
    try:
        names = place(build, site, version)
        git("add", "--all", folder=site)
        if git("status", "--porcelain", folder=site):
            git("commit", "--quiet", "--message", f"Publish {name_folder(version)}", folder=site)
            git("push", "--quiet", "origin", f"HEAD:refs/heads/{BRANCH}", folder=site)
    finally:
        git("worktree", "remove", "--force", str(site))
    return names


def main(arguments: list[str]) -> int:
    """Place a build, and print the versions of the site."""
    parser = argparse.ArgumentParser(prog="python -m release.site", description=__doc__)
    parser.add_argument("build", type=Path, help="folder that the step docs has written")
    parser.add_argument("site", type=Path, help="folder of the site")
    parser.add_argument("--push", action="store_true", help=f"push the site as branch {BRANCH}")
    parser.add_argument(
        "--version", default=DEVELOPMENT, help=f"release or tag (default: {DEVELOPMENT})"
    )
    options = parser.parse_args(arguments)
    try:
        if options.push:
            print(*publish(ROOT, options.build, options.version, options.site))
        else:
            print(*place(options.build, options.site, options.version))
    except (OSError, ValueError, subprocess.CalledProcessError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
