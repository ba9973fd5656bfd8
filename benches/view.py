"""Print how large a viewer page is, how soon it is ready, and how long a step of a scrub takes.

Run as ``python benches/view.py``: two figures of 31 joints over 1000 frames, in headless
Chromium. The times include the frame that the browser draws.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from tests import strategies
from tests.browser import chromium, opened

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


def main():
    motions = list(pair())
    start = time.perf_counter()
    page = mg.view(*motions, show=False)
    print(f"built in {time.perf_counter() - start:.2f} s, {len(page.html.encode()) / 1e3:.0f} KB")
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        path = page.save(Path(folder) / "page.html")
        for _ in range(3):
            start = time.perf_counter()
            with opened(browser, path) as shown:
                ready = time.perf_counter() - start
                middle, high = shown.evaluate(SCRUB)
            print(f"ready in {ready:.2f} s; scrub {middle:.1f} ms, 95 % under {high:.1f} ms")


if __name__ == "__main__":
    main()
