"""Print start-up times: help, the demo, viewer pages, a step of their scrub, and films.

Run as ``python benches/view.py``. The demo runs in a process without compiled Python files, as
after a fresh installation. Headless Chromium opens its page, a page of two figures of 31 joints
over 1000 frames, and one of a minute of 60 joints. The times of pages include the frame that the
browser draws. With ``--character FILE.glb``, two figures with its mesh and four of capsules are
drawn as often as possible, and play for ``--minutes``, after which memory is measured again. With
``--only-drawing``, nothing else is measured.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import resident_bytes, run
from mograft.dancer import dance
from tests import strategies
from tests.browser import chromium, open_page

SCRUB = """async () => {
  const times = [];
  for (let i = 0; i < 200; i++) {
    const start = performance.now();
    mograft.seek((i * 37) % mograft.frames);
    await new Promise(requestAnimationFrame);
    times.push(performance.now() - start);
  }
  times.sort((a, b) => a - b);
  return [times[100], times[190]];
}"""


DRAW = """async (seconds) => {
  const start = performance.now();
  let count = 0;
  for (; performance.now() - start < 1000 * seconds; count++) {
    mograft.seek(count % mograft.frames);
    await new Promise(requestAnimationFrame);
  }
  return (1000 * count) / (performance.now() - start);
}"""


def random_motions(n_joints=31, n_frames=1000):
    """Yield two motions of one random skeleton."""
    rng = np.random.default_rng(0)
    skeleton = strategies.skeletons(rng, n_joints)
    for name in ("one", "two"):
        quats = strategies.smooth_rotations(rng, n_frames, n_joints, speed=0.05)
        positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
        positions[:, 0] += np.cumsum(rng.normal(size=(n_frames, 3)), axis=0)
        yield mg.Motion(skeleton, 1 / 120, quats, positions, name=name)


def run_python(words, **environment):
    """Return the seconds that a new Python process takes."""
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, *words], check=True, capture_output=True, env=os.environ | environment
    )
    return time.perf_counter() - start


def start_up(repeats):
    cases = {
        "python -c pass": ["-c", "pass"],
        "python -c 'import numpy'": ["-c", "import numpy"],
        "mograft --help": ["-m", "mograft", "--help"],
        "mograft graft --help": ["-m", "mograft", "graft", "--help"],
    }
    for name, words in cases.items():
        times = [run_python(words) for _ in range(repeats)]
        print(f"{name:26} {1e3 * statistics.median(times):4.0f} ms")


def demo(browser, folder):
    # With an empty cache folder, Python compiles all modules again.
    environment = {"PYTHONPYCACHEPREFIX": str(folder / "cache")}
    words = ["-m", "mograft", "demo", "-o", str(folder / "demo")]
    demo_seconds = run_python(words, **environment)
    start = time.perf_counter()
    with open_page(browser, folder / "demo" / "index.html"):
        ready = time.perf_counter() - start
    print(
        f"mograft demo, nothing compiled: {demo_seconds:.1f} s; its page is ready in {ready:.1f} s"
    )


def page(browser, folder, n_frames):
    start = time.perf_counter()
    built_page = mg.view(*random_motions(n_frames=n_frames), show=False)
    built = time.perf_counter() - start
    print(f"viewer page: built in {built:.2f} s, {len(built_page.html.encode()) / 1e3:.0f} KB")
    path = built_page.save(folder / "page.html")
    for _ in range(3):
        start = time.perf_counter()
        with open_page(browser, path) as opened_page:
            ready = time.perf_counter() - start
            median, high = opened_page.evaluate(SCRUB)
        print(f"ready in {ready:.2f} s; scrub {median:.1f} ms, 95 % under {high:.1f} ms")


def minute(browser, folder, n_frames):
    """Print how long a page of one minute takes until its first picture."""
    (motion, _) = random_motions(60, n_frames)
    path = mg.view(replace(motion, frame_time=1 / 60), show=False).save(folder / "minute.html")
    for _ in range(3):
        opened = browser.new_page(viewport={"width": 1280, "height": 800})
        start, used = time.perf_counter(), processor_seconds(browser)
        opened.goto(path.as_uri())
        opened.wait_for_selector("#mograft[data-ready='1']", state="attached")
        opened.evaluate("() => new Promise(requestAnimationFrame)")
        took, used = time.perf_counter() - start, processor_seconds(browser) - used
        print(
            f"{n_frames / 60:.0f} s of 60 joints: picture in {took:.2f} s, processor {used:.2f} s"
        )
        opened.close()


def drawing(browser, folder, character, seconds, minutes):
    """Print how often six figures are drawn, and the memory of the page while they play."""
    meshes = mg.read(character)[:2]
    dances = [replace(dance(seed=seed, strides=2).motion, name=f"d{seed}") for seed in range(4)]
    path = mg.view(*meshes, *dances, show=False).save(folder / "six.html")
    with open_page(browser, path) as page:
        page.evaluate("() => mograft.show([0, 1, 2, 3, 4, 5])")
        used = processor_seconds(browser)
        rate = page.evaluate(DRAW, seconds)
        used = 1e3 * (processor_seconds(browser) - used) / (rate * seconds)
        print(
            f"2 meshes and 4 figures of capsules: {rate:.1f} frames/s, processor {used:.0f} ms each"
        )
        client = page.context.new_cdp_session(page)
        page.keyboard.press("Space")
        for part in range(4):
            client.send("HeapProfiler.collectGarbage")
            used = client.send("Runtime.getHeapUsage")["usedSize"]
            resident = renderer_bytes(browser)
            print(
                f"{part * minutes / 3:5.1f} minutes: heap {used / 1e6:.1f} MB, "
                f"renderer {resident / 1e6:.0f} MB"
            )
            if part < 3:
                page.wait_for_timeout(20_000 * minutes)


def processes(browser):
    """Return what the browser states about its processes."""
    return browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]


def processor_seconds(browser):
    """Return the processor time of all processes of the browser."""
    return sum(own["cpuTime"] for own in processes(browser))


def renderer_bytes(browser):
    """Return the resident memory of the largest renderer of the browser."""
    renderers = (own for own in processes(browser) if own["type"] == "renderer")
    return max(resident_bytes(own["id"]) or 0 for own in renderers)


def film(folder, n_frames):
    motion = dance(strides=1).motion[:n_frames]
    for ending in ("mp4", "gif"):
        start = time.perf_counter()
        mg.write_video(motion, folder / f"m.{ending}", rate=20)
        took = time.perf_counter() - start
        count = motion.resample(20).n_frames
        size = (folder / f"m.{ending}").stat().st_size
        print(
            f"{ending}: {count} pictures of 720x480, {1e3 * took / count:.0f} ms each, "
            f"{size / 1e3:.0f} KB"
        )


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--character", type=Path)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--only-drawing", action="store_true")
    run(parser, report, argv)


def report(options):
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        folder = Path(name)
        if not options.only_drawing:
            start_up(1 if options.tiny else 11)
            demo(browser, folder)
            page(browser, folder, 50 if options.tiny else 1000)
            film(folder, 4 if options.tiny else 300)
        minute(browser, folder, 60 if options.tiny else 3600)
        if options.character is not None:
            drawing(browser, folder, options.character, 10, options.minutes)


if __name__ == "__main__":
    main()
