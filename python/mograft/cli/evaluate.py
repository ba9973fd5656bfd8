"""``mograft evaluate``: how rich, how natural, how balanced and how smooth grafts are."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli._common import (
    above_zero,
    add_making,
    at_least_one,
    check_free,
    expanded,
    library_folder,
    print_json,
    progress,
    say,
    write_text,
)
from mograft.cli.graft import chosen_config, chosen_groups, opened

if TYPE_CHECKING:
    from mograft.library.library import Library

TOPICS = ("enrichment", "balance", "naturalness", "quality")
LABEL = "label"


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    evaluate = commands.add_parser(
        "evaluate",
        help="measure how rich, natural, balanced and smooth grafts are",
        description="Measure grafts of some files beside chance and other rules. "
        f"Words among FILE that are no files choose what: {', '.join(TOPICS)} (default all), or "
        f"{LABEL}, which writes a page on which a person labels pieces as natural or not.",
    )
    evaluate.add_argument(
        "files", nargs="+", metavar="LIB|FILE", help="a library or BVH files, and what to measure"
    )
    evaluate.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help=f"folder for evaluation.json and index.html; with {LABEL} the page to write",
    )
    evaluate.add_argument("--groups", metavar="NAME|FILE", help="default: lower_upper")
    evaluate.add_argument("--preset", choices=("default", "paper"))
    evaluate.add_argument("--sigma-scale", type=above_zero, metavar="X", help="see mograft graft")
    evaluate.add_argument(
        "--rate", type=above_zero, metavar="FPS", help="resample all files to this rate first"
    )
    evaluate.add_argument(
        "--runs", type=at_least_one, default=10, help="motions on each base and way (default 10)"
    )
    evaluate.add_argument(
        "--bases", type=at_least_one, default=4, help="clips that they are made on (default 4)"
    )
    evaluate.add_argument(
        "--labels", type=Path, metavar="CSV", help="labels.csv that a person has given"
    )
    evaluate.add_argument(
        "-n",
        "--count",
        type=at_least_one,
        default=500,
        help=f"with {LABEL}: pieces to judge (default 500, as in the paper)",
    )
    evaluate.add_argument("--json", action="store_true", help="the numbers as one JSON document")
    add_making(evaluate)
    evaluate.set_defaults(run=run, usage=evaluate.error)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    words = (*TOPICS, "all", LABEL)
    asked = [own for own in options.files if own in words and not Path(own).exists()]
    options.files = [own for own in options.files if own not in asked]
    if not options.files:
        options.usage("a library or at least one BVH file must be given")
    for own in options.files:
        if own.isalpha() and not Path(own).exists():
            options.usage(f"{own} is no file, and what to measure must be {', '.join(words)}")
    if LABEL in asked:
        if len(asked) > 1:
            options.usage(f"{LABEL} must be asked for alone")
        return _label(options)
    from mograft.evaluation import evaluate, evaluation_page, read_labels
    from mograft.evaluation.report import reading

    topics = TOPICS if not asked or "all" in asked else tuple(dict.fromkeys(asked))
    folder: Path | None = options.output
    written = [] if folder is None else [folder / "evaluation.json", folder / "index.html"]
    check_free(written, force=options.force)
    if folder is not None:
        _need_plots()
    library = _library(options)
    labels = None if options.labels is None else read_labels(options.labels, library)
    try:
        with progress() as tell:
            found = evaluate(
                library,
                topics,
                runs=options.runs,
                bases=options.bases,
                labels=labels,
                seed=options.seed,
                progress=tell,
            )
    except ImportError as error:
        raise ValueError(str(error)) from error
    document = found.as_dict()
    if folder is not None:
        page = evaluation_page(found)
        folder.mkdir(parents=True, exist_ok=True)
        write_text(written[0], json.dumps(document, indent=1, allow_nan=False) + "\n")
        page.save(written[1], force=True)
    if options.json:
        print_json(document)
    else:
        for sentence in reading(found):
            say(sentence)
        if folder is None:
            say("-o DIR writes all numbers and a page")
        for path in written:
            print(path)
    return 0


def _need_plots() -> None:
    try:
        import matplotlib as mpl  # noqa: F401
    except ImportError as error:
        raise ValueError("the page needs matplotlib: pip install 'mograft[evaluate]'") from error


def _library(options: argparse.Namespace) -> "Library":
    from mograft.io.bvh import read_bvh
    from mograft.library.library import Library

    folder = library_folder(options)
    if folder is not None:
        if options.rate is not None:
            options.usage("--rate is settled when a library is made: mograft index --rate")
        return opened(folder, options)
    options.groups = options.groups or "lower_upper"
    groups, config = chosen_groups(options), chosen_config(options)
    files = expanded(options.files)
    with progress() as tell:
        if options.rate is None:
            return Library.build(files, groups, config, progress=tell)
        clips = [read_bvh(file).resample(options.rate) for file in files]
        return Library.build(clips, groups, config, progress=tell)


def _label(options: argparse.Namespace) -> int:
    from mograft.evaluation import label_items, label_page

    if options.output is None or options.output.suffix.lower() != ".html":
        options.usage(f"-o must be the page to write with {LABEL}: a .html file")
    check_free([options.output], force=options.force)
    library = _library(options)
    items = label_items(library, options.count, seed=options.seed)
    page = label_page(library, items)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(options.output, force=True)
    say(
        f"{len(items)} pieces: open the page, press F or J for each, save the labels, and give "
        "them to mograft evaluate --labels labels.csv with the same files and options"
    )
    if options.json:
        print_json({"schema": "mograft.label/1", "file": str(path), "pieces": len(items)})
    else:
        print(path)
    return 0
