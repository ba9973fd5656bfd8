// Plays pieces of motion one by one and records a label for each. It uses no library and no
// network. The labels are stored in the browser; the button saves them as a table.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("mograft-data").textContent);
  const root = document.getElementById("mograft");
  const find = (name) => root.querySelector(`[data-part="${name}"]`);
  const canvas = find("stage");
  const pen = canvas.getContext("2d");
  const storageKey = `mograft-labels-${data.key}`;
  const answers = loadAnswers();
  let index = firstUnlabelled();
  let started = performance.now();
  let shown = performance.now();
  let speed = 1;
  let yaw = 0;

  function loadAnswers() {
    try {
      const stored = JSON.parse(localStorage.getItem(storageKey) || "[]");
      return Array.isArray(stored) && stored.length <= data.items.length ? stored : [];
    } catch {
      return []; // without storage, labels last until the page is closed
    }
  }

  function saveAnswers() {
    try {
      localStorage.setItem(storageKey, JSON.stringify(answers));
    } catch {
      // without storage, as in loadAnswers
    }
  }

  function firstUnlabelled() {
    for (let i = 0; i < data.items.length; i++) if (!answers[i]) return i;
    return data.items.length;
  }

  function positions(item) {
    if (!item.positions) {
      const bytes = Uint8Array.from(atob(item.pos), (c) => c.charCodeAt(0));
      item.positions = new Int16Array(bytes.buffer);
    }
    return item.positions;
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
    if (index >= data.items.length) return;
    const item = data.items[index];
    const coordinates = positions(item);
    const nodes = data.parents.length;
    const span = (item.frames - 1) * data.dt;
    const pause = 0.35;
    const time = (((performance.now() - started) / 1000) * speed) % (span + pause);
    const frame = Math.min(Math.round(time / data.dt), item.frames - 1);
    const isInPiece = frame >= item.first && frame <= item.last;
    const style = getComputedStyle(document.documentElement);
    const scale = Math.min(height / 1.45, width / 2.2) * data.unit;
    const project = (node) => {
      const o = 3 * (frame * nodes + node);
      const [x, y, z] = [coordinates[o], coordinates[o + 1], coordinates[o + 2]];
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
    pen.globalAlpha = isInPiece ? 1 : 0.3;
    data.parents.forEach((parent, node) => {
      if (parent < 0) return;
      const [a, b] = [project(parent), project(node)];
      pen.strokeStyle = style.getPropertyValue(`--group${data.group[parent]}`);
      pen.lineWidth = Math.max(3, height / 90);
      pen.beginPath();
      pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
      pen.stroke();
    });
    pen.globalAlpha = 1;
  }

  function updateStatus() {
    const nLabelled = answers.filter(Boolean).length;
    const isDone = index >= data.items.length;
    find("count").textContent = isDone
      ? `All ${data.items.length} pieces are labelled. Save the labels.`
      : `${index + 1} of ${data.items.length}`;
    find("bar").value = nLabelled;
    find("label").textContent = answers[index] ? `label: ${answers[index].label}` : "";
    for (const name of ["natural", "unnatural", "skip"]) find(name).disabled = isDone;
    find("undo").disabled = index === 0;
    find("save").disabled = nLabelled === 0;
  }

  function answer(label) {
    if (index >= data.items.length) return;
    answers[index] = { label, seconds: (performance.now() - shown) / 1000 };
    go(index + 1);
  }

  function go(to) {
    index = Math.max(0, Math.min(to, data.items.length));
    started = shown = performance.now();
    saveAnswers();
    updateStatus();
  }

  function table() {
    const quoted = (text) => `"${String(text).replaceAll('"', '""')}"`;
    const header = [...data.columns, "label", "seconds"].join(",");
    const rows = data.items.flatMap((item, i) =>
      answers[i] && answers[i].label !== "skipped"
        ? [[...item.row.map(quoted), answers[i].label, answers[i].seconds.toFixed(2)].join(",")]
        : [],
    );
    return `${[header, ...rows].join("\n")}\n`;
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
    undo: () => go(index - 1),
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
  updateStatus();
  const loop = () => {
    draw();
    requestAnimationFrame(loop);
  };
  loop();
  root.dataset.ready = "1";
  // For tests that control the page.
  window.mograft = { table, index: () => index, answers };
})();
