"""Print start-up times: help, the demo, a viewer page, a step of its scrub, and films.

Run as ``python benches/view.py``. The demo runs in a process without compiled Python files, as
after a fresh installation. Headless Chromium opens its page, and a page of two figures of 31
joints over 1000 frames. The times of pages include the frame that the browser draws.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
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


def pair(n_joints=31, n_frames=1000):
    rng = np.random.default_rng(0)
    skeleton = strategies.skeletons(rng, n_joints)
    for name in ("one", "two"):
        quats = strategies.wander(rng, n_frames, n_joints, speed=0.05)
        places = np.tile(skeleton.offsets, (n_frames, 1, 1))
        places[:, 0] += np.cumsum(rng.normal(size=(n_frames, 3)), axis=0)
        yield mg.Motion(skeleton, 1 / 120, quats, places, name=name)


def seconds(words, **environment):
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, *words], check=True, capture_output=True, env=os.environ | environment
    )
    return time.perf_counter() - start


def start_up():
    cases = {
        "python -c pass": ["-c", "pass"],
        "python -c 'import numpy'": ["-c", "import numpy"],
        "mograft --help": ["-m", "mograft", "--help"],
        "mograft graft --help": ["-m", "mograft", "graft", "--help"],
    }
    for name, words in cases.items():
        times = [seconds(words) for _ in range(11)]
        print(f"{name:26} {1e3 * statistics.median(times):4.0f} ms")


def demo(browser, folder):
    # With an empty cache folder, Python compiles all modules again.
    environment = {"PYTHONPYCACHEPREFIX": str(folder / "cache")}
    words = ["-m", "mograft", "demo", "-o", str(folder / "demo")]
    run = seconds(words, **environment)
    start = time.perf_counter()
    with open_page(browser, folder / "demo" / "index.html"):
        ready = time.perf_counter() - start
    print(f"mograft demo, nothing compiled: {run:.1f} s; its page is ready in {ready:.1f} s")


def page(browser, folder):
    start = time.perf_counter()
    made = mg.view(*pair(), show=False)
    built = time.perf_counter() - start
    print(f"viewer page: built in {built:.2f} s, {len(made.html.encode()) / 1e3:.0f} KB")
    path = made.save(folder / "page.html")
    for _ in range(3):
        start = time.perf_counter()
        with open_page(browser, path) as shown:
            ready = time.perf_counter() - start
            middle, high = shown.evaluate(SCRUB)
        print(f"ready in {ready:.2f} s; scrub {middle:.1f} ms, 95 % under {high:.1f} ms")


def film(folder):
    motion = dance(strides=1).motion[:300]
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


def main():
    start_up()
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        folder = Path(name)
        demo(browser, folder)
        page(browser, folder)
        film(folder)


if __name__ == "__main__":
    main()
