// Curves of a joint of the base and the graft: its angle, height or speed in each frame.
import { makePose, setPose } from "/viewer/poses.js";
import { find } from "/viewer/scene.js";
import { jointNames } from "./constraints.js";
import { mainFigure, nFrames, player } from "./player.js";
import { baseFigure, frameIn } from "./stage.js";
import { on, selected } from "./store.js";
import { timelineParts } from "./timeline.js";
import { make, selectInput } from "./ui.js";

const MAX_POINTS = 400;
const HEIGHT = 100; // Of the drawing, in its own unit.

const MEASURES = {
  angle: ["angle", "°"],
  height: ["height", "heights"],
  speed: ["speed", "heights/s"],
};

const parts = {};
let shown = "";
let curves = [];

export function startCurves() {
  parts.joint = selectInput([["", "no joint"]], "", { "aria-label": "Joint of the curves", onchange: write });
  parts.measure = selectInput(Object.entries(MEASURES).map(([key, [text]]) => [key, text]), "angle", { "aria-label": "Curve", onchange: write });
  parts.values = make("output", { class: "faint values" });
  const picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  picture.setAttribute("viewBox", `0 0 1 ${HEIGHT}`);
  picture.setAttribute("preserveAspectRatio", "none");
  picture.setAttribute("role", "img");
  parts.picture = picture;
  parts.box = make("div", { class: "curves", hidden: true }, picture);
  timelineParts.extra.after(parts.box);
  parts.name = make("div", { class: "name curve-name", hidden: true }, make("span", { text: "graft ——" }), make("span", { class: "faint", text: "base - - -" }));
  timelineParts.names.after(parts.name);
  find("selection").after(make("span", { class: "set" }, make("label", { class: "set" }, "curve of", parts.joint), parts.measure, parts.values));
  on("project selected figure", write);
  on("frame", writeValues);
}

// The values of a joint in frames of a figure.
function valuesOf(clip, joint, measure, frames) {
  const pose = makePose(clip);
  const values = [];
  let before = null;
  for (const frame of frames) {
    setPose(clip, frame, pose);
    const bone = pose.bones[joint];
    if (measure === "angle") {
      values.push((2 * Math.acos(Math.min(1, Math.abs(bone.quaternion.w))) * 180) / Math.PI);
      continue;
    }
    const place = new THREE.Vector3().setFromMatrixPosition(bone.matrixWorld);
    if (measure === "height") values.push((place.y - clip.floor) / clip.height);
    else values.push(before ? place.distanceTo(before.place) / clip.height / (Math.max(frame - before.frame, 1) * clip.dt) : 0);
    before = { place, frame };
  }
  if (measure === "speed" && values.length > 1) values[0] = values[1];
  return values;
}

function write() {
  const names = jointNames();
  if (parts.joint.options.length !== names.length + 1) {
    const chosen = parts.joint.value;
    parts.joint.replaceChildren(make("option", { value: "", text: "no joint" }), ...names.map((name) => make("option", { value: name, text: name })));
    parts.joint.value = names.includes(chosen) ? chosen : "";
  }
  const clip = mainFigure();
  const base = baseFigure();
  const joint = names.indexOf(parts.joint.value);
  const isShown = joint >= 0 && clip !== null;
  parts.box.hidden = parts.name.hidden = !isShown;
  if (!isShown) {
    parts.values.textContent = shown = "";
    curves = [];
    return;
  }
  const measure = parts.measure.value;
  const key = [clip.key, clip.hash, base?.key, joint, measure, selected()?.hash].join();
  if (key === shown) return;
  shown = key;
  const count = Math.min(nFrames(), MAX_POINTS);
  const frames = Array.from({ length: count }, (_, i) => Math.round((i / Math.max(count - 1, 1)) * (nFrames() - 1)));
  curves = [
    ["graft", clip],
    ["base", base],
  ]
    .filter(([, own]) => own)
    .map(([name, own]) => ({ name, frames, values: valuesOf(own, joint, measure, frames.map((frame) => frameIn(own, frame))) }));
  draw();
  const title = `${parts.joint.value}: ${MEASURES[measure][0]} of graft and base`;
  parts.picture.setAttribute("aria-label", title);
  writeValues();
}

function draw() {
  const all = curves.flatMap(({ values }) => values);
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const lines = curves.toReversed().map(({ name, frames, values }) => {
    const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
    const last = Math.max(nFrames() - 1, 1);
    const y = (value) => 4 + (HEIGHT - 8) * (1 - (value - low) / Math.max(high - low, 1e-9));
    line.setAttribute("points", values.map((value, i) => `${(frames[i] / last).toFixed(5)},${y(value).toFixed(2)}`).join(" "));
    line.setAttribute("class", name);
    return line;
  });
  parts.picture.replaceChildren(...lines);
}

function writeValues() {
  if (!curves.length) return;
  const unit = MEASURES[parts.measure.value][1];
  const texts = curves.map(({ name, frames, values }) => {
    const index = frames.findLastIndex((frame) => frame <= player.frame);
    return `${name} ${values[Math.max(index, 0)].toFixed(unit === "°" ? 0 : 2)}`;
  });
  parts.values.textContent = `${texts.join(", ")} ${unit}`;
}
