// Scenarios: a path drawn on the floor, a tempo, a duration; motions are made along them.
import { ink } from "/viewer/colours.js";
import { find } from "/viewer/scene.js";
import { floorPoint, label, onMarks, onPointer, redrawStage } from "./stage.js";
import { mainFigure } from "./player.js";
import { act, emit, on, store } from "./store.js";
import { button, field, make, numberInput } from "./ui.js";

const MIN_STEP = 0.08; // Distance of points of a path while it is drawn, in heights.
const MAX_TAPS = 8;
const TAP_SECONDS = 2; // A longer pause begins a new tempo.

const parts = {};
let points = []; // In axes of the page: [x, z].
let taps = [];

export function startScenario() {
  const pane = document.getElementById("pane-scenario");
  parts.draw = button("Draw path", "Draw on the floor; click again to end", () => setDrawing(store.mode !== "draw"), { "aria-pressed": "false" });
  parts.clear = button("Clear", "Remove the path", () => setPoints([]));
  parts.shapes = ["Line", "Circle", "Eight"].map((name) => button(name, `A path: ${name.toLowerCase()}`, () => setPoints(SHAPES[name]())));
  parts.length = make("p", { class: "faint", role: "status" });
  parts.table = make("div", { class: "points" });
  parts.addPoint = button("Add point", "One step further along the path", () => setPoints([...points, nextPoint()]));
  parts.duration = numberInput("", { min: 0.5, step: 0.5, placeholder: "any" });
  parts.tempo = numberInput("", { min: 20, max: 300, step: 1, placeholder: "free" });
  parts.tap = button("Tap", "Tap the beat; four times or more", tap);
  parts.loop = make("input", { type: "checkbox" });
  parts.count = numberInput(4, { min: 1, max: 50, step: 1 });
  const form = make(
    "form",
    { class: "form", onsubmit: makeMotions },
    make("h3", { text: "Path" }),
    make("div", { class: "row" }, parts.draw, ...parts.shapes, parts.clear),
    parts.length,
    make("details", {}, make("summary", { text: "points by numbers" }), parts.table, parts.addPoint),
    make("h3", { text: "Time" }),
    field("duration", parts.duration, "s"),
    make("div", { class: "set" }, field("tempo", parts.tempo, "beats/min"), parts.tap),
    field("loop", parts.loop),
    field("number", parts.count),
    (parts.make = make("button", { type: "submit", class: "main", text: "Make along this" })),
  );
  pane.append(form);
  onPointer("draw", { down: (at, view) => add(at, view, true), drag: (at, view) => add(at, view) });
  onMarks(drawPath);
  on("project", () => (parts.make.disabled = store.project.library?.status !== "ready"));
  on("mode", () => parts.draw.setAttribute("aria-pressed", store.mode === "draw"));
  for (const tab of document.querySelectorAll('[role="tab"]')) tab.addEventListener("click", () => tab.id !== "tab-scenario" && tab.closest(".left") && setDrawing(false));
  setPoints([]);
}

const start = () => {
  const path = mainFigure()?.cameraPath;
  return path ? [path[0], path[2]] : [0, 0];
};
const height = () => mainFigure()?.height ?? 1;
const SHAPES = {
  Line: () => turnShape(20, (share) => [0, 4 * share]),
  Circle: () => turnShape(40, (share) => [1.2 - 1.2 * Math.cos(2 * Math.PI * share), 1.2 * Math.sin(2 * Math.PI * share)]),
  Eight: () => turnShape(60, (share) => [1.2 * Math.sin(4 * Math.PI * share), 1.8 * Math.sin(2 * Math.PI * share)]),
};
function turnShape(count, at) {
  const [x, z] = start();
  return Array.from({ length: count + 1 }, (_, i) => at(i / count)).map(([dx, dz]) => [x + dx * height(), z + dz * height()]);
}

export function setDrawing(isOn) {
  if (!isOn && store.mode !== "draw") return;
  store.mode = isOn ? "draw" : "view";
  emit("mode");
  emit("layout");
  find("hint").hidden = !isOn;
  find("hint").textContent = isOn ? "Draw a path on the floor, seen from above. Esc ends." : "";
}

function add(at, view, isStart = false) {
  const place = view && floorPoint(at, view);
  if (!place) return;
  const next = [place.x, place.z];
  if (isStart) return setPoints([next]);
  const last = points.at(-1);
  if (Math.hypot(next[0] - last[0], next[1] - last[1]) >= MIN_STEP * height()) setPoints([...points, next]);
}

function nextPoint() {
  if (!points.length) return start();
  const [a, b] = [points.at(-2) || [points[0][0], points[0][1] - height()], points.at(-1)];
  return [2 * b[0] - a[0], 2 * b[1] - a[1]];
}

function setPoints(next) {
  points = next;
  parts.clear.disabled = !points.length;
  const length = points.slice(1).reduce((sum, [x, z], i) => sum + Math.hypot(x - points[i][0], z - points[i][1]), 0);
  parts.length.textContent = points.length ? `${points.length} points, ${(length / height()).toFixed(1)} heights long` : "No path: the motion goes where its parts lead.";
  parts.table.replaceChildren(...points.map(pointRow));
  redrawStage();
}

function pointRow(point, index) {
  const inputs = ["x", "z"].map((name, i) =>
    numberInput(Number(point[i].toPrecision(5)), { "aria-label": `${name} of point ${index + 1}`, onchange: (event) => setPoints(points.map((own, k) => (k === index ? own.map((old, j) => (j === i ? Number(event.target.value) || 0 : old)) : own))) }),
  );
  return make("div", { class: "field vector" }, make("span", { text: `${index + 1}` }), ...inputs, button("✕", "Remove", () => setPoints(points.filter((_, k) => k !== index)), { "aria-label": `Remove point ${index + 1}` }));
}

function drawPath(pen, view) {
  if (!points.length || document.getElementById("pane-scenario").hidden) return;
  pen.strokeStyle = pen.fillStyle = ink.accent;
  pen.lineWidth = 3;
  pen.beginPath();
  const places = points.map(([x, z]) => view.point([x, view.clip.floor, z])).filter(([, , depth]) => depth <= 1);
  places.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
  for (const [index, text] of [[0, "start"], [places.length - 1, "end"]]) {
    const at = places[index];
    if (!at || (index === 0 && text === "end")) continue;
    pen.beginPath();
    pen.arc(at[0], at[1], 5, 0, 2 * Math.PI);
    pen.fill();
    label(text, at[0], at[1] - 9, view);
  }
}

function tap() {
  const now = performance.now() / 1000;
  if (taps.length && now - taps.at(-1) > TAP_SECONDS) taps = [];
  taps = [...taps, now].slice(-MAX_TAPS);
  if (taps.length > 1) parts.tempo.value = Math.round((60 * (taps.length - 1)) / (taps.at(-1) - taps[0]));
}

function makeMotions(event) {
  event.preventDefault();
  setDrawing(false);
  act({
    action: "scenario",
    points,
    ...(parts.duration.value && { duration: Number(parts.duration.value) }),
    ...(parts.tempo.value && { tempo: Number(parts.tempo.value) }),
    loop: parts.loop.checked,
    count: Number(parts.count.value) || 1,
  });
}
