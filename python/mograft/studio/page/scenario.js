// Scenarios: a path drawn on the floor, a tempo, a duration; motions are made along them.
import { ink } from "/viewer/colours.js";
import { floorPoint, label, onMarks, onPointer, redrawStage, setStageMode } from "./stage.js";
import { entries } from "./constraints.js";
import { mainFigure } from "./player.js";
import { act, on, select, store } from "./store.js";
import { button, counted, parts, showTab } from "./ui.js";

const MIN_STEP = 0.08; // Distance of points of a path while it is drawn, in heights.
const MAX_TAPS = 8;
const TAP_SECONDS = 2; // A longer pause begins a new tempo.

let points = []; // In axes of the page: [x, z].
let taps = [];

export function startScenario() {
  parts.scenarioForm.addEventListener("submit", makeMotions);
  parts.drawPath.addEventListener("click", () => setDrawing(store.mode !== "draw"));
  parts.clearPath.addEventListener("click", () => setPoints([]));
  for (const own of parts.scenarioForm.querySelectorAll("[data-path]"))
    own.addEventListener("click", () => {
      setDrawing(false);
      setPoints(SHAPES[own.dataset.path]());
    });
  parts.addPoint.addEventListener("click", () => setPoints([...points, nextPoint()]));
  parts.tap.addEventListener("click", tap);
  parts.scenarioCount.addEventListener("input", writeMake);
  onPointer("draw", { down: (at, view) => add(at, view, true), drag: (at, view) => add(at, view) });
  onMarks(drawPath);
  on("project", () => (parts.makeScenario.disabled = store.project.library?.status !== "ready"));
  on("mode", () => parts.drawPath.setAttribute("aria-pressed", store.mode === "draw"));
  parts.leftTabs.addEventListener("click", ({ target }) => target.id !== "tab-scenario" && setDrawing(false));
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
  if (isOn) setStageMode("draw", "Draw a path on the floor, seen from above. Esc ends.");
  else if (store.mode === "draw") setStageMode("view");
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
  parts.clearPath.disabled = !points.length;
  const length = points.slice(1).reduce((sum, [x, z], i) => sum + Math.hypot(x - points[i][0], z - points[i][1]), 0);
  writeMake();
  parts.pathLength.textContent = points.length
    ? `${points.length} points, ${(length / height()).toFixed(1)} heights long`
    : "No path: the motions go where their parts lead.";
  parts.points.replaceChildren(...points.map(pointRow));
  redrawStage();
}

function writeMake() {
  const text = `Make ${counted(Number(parts.scenarioCount.value) || 1, "motion")}`;
  parts.makeScenario.textContent = points.length ? `${text} along this path` : text;
}

function pointRow(point, index) {
  const save = (next) => setPoints(points.map((own, k) => (k === index ? next : own)));
  const row = entries(`${index + 1}`, point, save, { key: `point/${index}`, names: "xz" });
  const remove = () => setPoints(points.filter((_, k) => k !== index));
  row.append(button("Remove", "Remove this point", remove, { "aria-label": `Remove point ${index + 1}` }));
  return row;
}

function drawPath(pen, view) {
  if (!points.length || document.getElementById("pane-scenario").hidden) return;
  pen.strokeStyle = pen.fillStyle = ink.accent;
  pen.lineWidth = 3;
  pen.beginPath();
  const places = points.map(([x, z]) => view.point([x, view.clip.floor, z])).filter(([, , depth]) => depth <= 1);
  places.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
  const ends = { start: places[0], end: places.length > 1 ? places.at(-1) : null };
  for (const [text, at] of Object.entries(ends).filter(([, own]) => own)) {
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

async function makeMotions(event) {
  event.preventDefault();
  setDrawing(false);
  const reply = await act({
    action: "scenario",
    points,
    ...(parts.duration.value && { duration: Number(parts.duration.value) }),
    ...(parts.tempo.value && { tempo: Number(parts.tempo.value) }),
    loop: parts.scenarioLoop.checked,
    count: Number(parts.scenarioCount.value) || 1,
  });
  if (!reply?.motions.length) return;
  select(reply.motions[0]);
  showTab(document.getElementById("tab-motions"));
}
