"""``mograft evaluate``: enrichment, balance, naturalness and quality of grafts."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from mograft._util.atomic import write_text
from mograft.cli.arguments import Command, option, positional
from mograft.cli.configuration import load_library, selected_config, selected_groups
from mograft.cli.files import check_writable, expand_folders, library_folder
from mograft.cli.options import FORCE, GROUPS, JSON, PRESET, SEED, SIGMA_SCALE
from mograft.cli.output import print_json, print_remark, show_progress
from mograft.cli.values import positive_integer, positive_number

if TYPE_CHECKING:
    from mograft.evaluation.suite import Evaluation
    from mograft.library.library import Library

_TOPICS = ("enrichment", "balance", "naturalness", "quality")
_LABEL = "label"
_WORDS = (*_TOPICS, "all", _LABEL)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    words = _take_words(options)
    if _LABEL in words:
        if len(words) > 1:
            options.usage_error(f"{_LABEL} cannot be combined with {', '.join(_WORDS[:-1])}")
        return _write_label_page(options)
    from mograft.evaluation import evaluation_page
    from mograft.evaluation.report import summarize

    folder: Path | None = options.output
    paths = [] if folder is None else [folder / "evaluation.json", folder / "index.html"]
    check_writable(paths, force=options.force)
    if folder is not None:
        _require_matplotlib()
    found = _evaluate(options, _TOPICS if not words or "all" in words else words)
    document = found.as_dict()
    if folder is not None:
        page = evaluation_page(found)
        folder.mkdir(parents=True, exist_ok=True)
        write_text(paths[0], json.dumps(document, indent=1, allow_nan=False) + "\n")
        page.save(paths[1], force=True)
    if options.json:
        print_json(document)
    else:
        for sentence in summarize(found):
            print_remark(sentence)
        if folder is None:
            print_remark("-o DIR writes all numbers and a page")
        for path in paths:
            print(path)
    return 0


def _take_words(options: argparse.Namespace) -> tuple[str, ...]:
    """Remove the words that select what to measure from the files, and return them."""
    names: list[str] = options.files
    words = [name for name in names if name in _WORDS and not Path(name).exists()]
    options.files = [name for name in names if name not in words]
    if not options.files:
        options.usage_error("expected one library or at least one BVH file, got none")
    for name in options.files:
        if name.isalpha() and not Path(name).exists():
            options.usage_error(f"expected a file or one of {', '.join(_WORDS)}; got {name}")
    return tuple(dict.fromkeys(words))


def _require_matplotlib() -> None:
    try:
        import matplotlib as mpl  # noqa: F401
    except ImportError as error:
        raise ValueError("the page needs matplotlib: pip install 'mograft[evaluate]'") from error


def _evaluate(options: argparse.Namespace, topics: tuple[str, ...]) -> "Evaluation":
    from mograft.evaluation import evaluate, read_labels

    library = _load_library(options)
    labels = None if options.labels is None else read_labels(options.labels, library)
    try:
        with show_progress() as progress:
            return evaluate(
                library,
                topics,
                runs=options.runs,
                bases=options.bases,
                labels=labels,
                seed=options.seed,
                progress=progress,
            )
    except ImportError as error:
        raise ValueError(str(error)) from error


def _load_library(options: argparse.Namespace) -> "Library":
    """Open or build the library; ``--rate`` resamples the files of a new one."""
    if options.rate is None:
        return load_library(options)
    if library_folder(options) is not None:
        options.usage_error("--rate is fixed when a library is created: mograft index --rate")
    from mograft.io.bvh import read_bvh
    from mograft.library.library import Library

    groups, config = selected_groups(options), selected_config(options)
    with show_progress() as progress:
        clips = [read_bvh(file).resample(options.rate) for file in expand_folders(options.files)]
        return Library.build(clips, groups, config, progress=progress)


def _write_label_page(options: argparse.Namespace) -> int:
    from mograft.evaluation import label_items, label_page

    if options.output is None or options.output.suffix.lower() != ".html":
        options.usage_error(f"-o must be an .html file with {_LABEL}, got {options.output}")
    target: Path = options.output
    check_writable([target], force=options.force)
    library = _load_library(options)
    items = label_items(library, options.count, seed=options.seed)
    page = label_page(library, items)
    target.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(target, force=True)
    print_remark(
        f"{len(items)} pieces: open the page, press F or J for each piece, save the labels, and "
        "pass them to mograft evaluate --labels labels.csv with the same files and options"
    )
    if options.json:
        print_json({"schema": "mograft.label/1", "file": str(path), "pieces": len(items)})
    else:
        print(path)
    return 0


COMMAND = Command(
    name="evaluate",
    help="measure enrichment, balance, naturalness and quality of grafts",
    description="Measure grafts, and for comparison random motions and those of other donor rules. "
    f"Words among FILE that are not files select what to measure: {', '.join(_TOPICS)} (default: "
    f"all). The word {_LABEL} writes a page instead, on which a person labels pieces as natural "
    "or not.",
    run=run,
    arguments=(
        positional(
            "files",
            is_path=True,
            nargs="+",
            metavar="LIB|FILE",
            help="one library, or BVH files; and words that select what to measure",
        ),
        option(
            "-o",
            "--output",
            is_setting=False,
            is_path=True,
            type=Path,
            metavar="DIR",
            help=f"folder for evaluation.json and index.html; with {_LABEL} the .html file to "
            "write (default: no files)",
        ),
        GROUPS,
        PRESET,
        SIGMA_SCALE,
        option(
            "--rate",
            type=positive_number,
            metavar="FPS",
            help="frame rate to which all files are resampled, in frames per second (default: "
            "that of the files)",
        ),
        option(
            "--runs",
            type=positive_integer,
            default=10,
            help="number of motions for each base and rule (default: 10)",
        ),
        option(
            "--bases",
            type=positive_integer,
            default=4,
            help="number of clips that serve as base (default: 4)",
        ),
        option(
            "--labels",
            type=Path,
            metavar="CSV",
            help=f"labels that a person gave on the page that {_LABEL} writes (default: none)",
        ),
        option(
            "-n",
            "--count",
            is_setting=False,
            type=positive_integer,
            default=500,
            help=f"with {_LABEL}, number of pieces on the page (default: 500, as in the paper)",
        ),
        JSON,
        SEED,
        FORCE,
    ),
)
