// Plays one piece of motion after the other and takes a key for each. No library, no network;
// what was said is kept in the browser and saved as a table when it is asked for.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("mograft-data").textContent);
  const root = document.getElementById("mograft");
  const find = (name) => root.querySelector(`[data-part="${name}"]`);
  const canvas = find("stage");
  const pen = canvas.getContext("2d");
  const memory = `mograft-labels-${data.key}`;
  const answers = recall();
  let at = firstOpen();
  let started = performance.now();
  let shown = performance.now();
  let speed = 1;
  let yaw = 0;

  function recall() {
    try {
      const kept = JSON.parse(localStorage.getItem(memory) || "[]");
      return Array.isArray(kept) && kept.length <= data.items.length ? kept : [];
    } catch {
      return []; // a browser that keeps nothing still takes labels until it is closed
    }
  }

  function keep() {
    try {
      localStorage.setItem(memory, JSON.stringify(answers));
    } catch {
      // as above
    }
  }

  function firstOpen() {
    for (let i = 0; i < data.items.length; i++) if (!answers[i]) return i;
    return data.items.length;
  }

  function places(item) {
    if (!item.places) {
      const bytes = Uint8Array.from(atob(item.pos), (c) => c.charCodeAt(0));
      item.places = new Int16Array(bytes.buffer);
    }
    return item.places;
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    if (at >= data.items.length) return;
    const item = data.items[at];
    const where = places(item);
    const nodes = data.parents.length;
    const span = (item.frames - 1) * data.dt;
    const pause = 0.35;
    const time = (((performance.now() - started) / 1000) * speed) % (span + pause);
    const frame = Math.min(Math.round(time / data.dt), item.frames - 1);
    const inside = frame >= item.first && frame <= item.last;
    const style = getComputedStyle(document.documentElement);
    const scale = Math.min(height / 1.45, width / 2.2) * data.unit;
    const put = (node) => {
      const o = 3 * (frame * nodes + node);
      const [x, y, z] = [where[o], where[o + 1], where[o + 2]];
      const across = x * Math.cos(yaw) + z * Math.sin(yaw);
      const depth = z * Math.cos(yaw) - x * Math.sin(yaw);
      return [width / 2 + across * scale, height * 0.86 - y * scale + depth * scale * 0.22];
    };
    pen.lineCap = "round";
    pen.strokeStyle = style.getPropertyValue("--line");
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(width * 0.1, height * 0.86);
    pen.lineTo(width * 0.9, height * 0.86);
    pen.stroke();
    pen.globalAlpha = inside ? 1 : 0.3;
    data.parents.forEach((parent, node) => {
      if (parent < 0) return;
      const [a, b] = [put(parent), put(node)];
      pen.strokeStyle = style.getPropertyValue(`--group${data.group[parent]}`);
      pen.lineWidth = Math.max(3, height / 90);
      pen.beginPath();
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
      pen.stroke();
    });
    pen.globalAlpha = 1;
  }

  function tell() {
    const done = answers.filter(Boolean).length;
    const over = at >= data.items.length;
    find("count").textContent = over
      ? `All ${data.items.length} are judged. Save the labels.`
      : `${at + 1} of ${data.items.length}`;
    find("bar").value = done;
    find("said").textContent = answers[at] ? `so far: ${answers[at].label}` : "";
    for (const name of ["natural", "unnatural", "skip"]) find(name).disabled = over;
    find("undo").disabled = at === 0;
    find("save").disabled = done === 0;
  }

  function answer(label) {
    if (at >= data.items.length) return;
    answers[at] = { label, seconds: (performance.now() - shown) / 1000 };
    go(at + 1);
  }

  function go(to) {
    at = Math.max(0, Math.min(to, data.items.length));
    started = shown = performance.now();
    keep();
    tell();
  }

  function table() {
    const quoted = (text) => `"${String(text).replaceAll('"', '""')}"`;
    const head = [...data.columns, "label", "seconds"].join(",");
    const rows = data.items.flatMap((item, index) =>
      answers[index] && answers[index].label !== "skipped"
        ? [[...item.row.map(quoted), answers[index].label, answers[index].seconds.toFixed(2)].join(",")]
        : [],
    );
    return `${[head, ...rows].join("\n")}\n`;
  }

  function save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([table()], { type: "text/csv" }));
    link.download = "labels.csv";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  const actions = {
    natural: () => answer("natural"),
    unnatural: () => answer("unnatural"),
    skip: () => answer("skipped"),
    undo: () => go(at - 1),
    save,
    slow: () => {
      speed = speed === 1 ? 0.5 : 1;
      find("slow").setAttribute("aria-pressed", String(speed !== 1));
    },
  };
  const keys = { j: "natural", f: "unnatural", s: "skip", u: "undo", Backspace: "undo", " ": "slow" };
  for (const name of Object.keys(actions)) find(name).addEventListener("click", actions[name]);
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      yaw += event.key === "ArrowLeft" ? -0.2 : 0.2;
    } else if (keys[event.key]) {
      actions[keys[event.key]]();
    } else {
      return;
    }
    event.preventDefault();
  });
  find("bar").max = data.items.length;
  tell();
  const loop = () => {
    draw();
    requestAnimationFrame(loop);
  };
  loop();
  root.dataset.ready = "1";
  // For those who drive the page from outside, as tests do.
  window.mograft = { table, at: () => at, answers };
})();
