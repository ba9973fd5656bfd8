// Curves of a joint of the base and the graft: its angle, height or speed in each frame.
import { makePose, setPose } from "/viewer/poses.js";
import { jointNames } from "./constraints.js";
import { mainFigure, nFrames, player } from "./player.js";
import { baseFigure, frameIn } from "./stage.js";
import { on, selected } from "./store.js";
import { fill, parts } from "./ui.js";

const MAX_POINTS = 400;
const HEIGHT = 100; // Of the drawing, in its own unit.

const UNITS = { angle: "°", height: " heights", speed: " heights/s" };

let shown = "";
let curves = [];

export function startCurves() {
  for (const own of [parts.curveJoint, parts.curveMeasure]) own.addEventListener("change", write);
  parts.curveJoint.addEventListener("change", () => parts.curves.scrollIntoView({ block: "nearest" }));
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
  const chosen = parts.curveJoint.value;
  fill(parts.curveJoint, [["", "no joint"], ...names], names.includes(chosen) ? chosen : "");
  const clip = mainFigure();
  const base = baseFigure();
  const joint = names.indexOf(parts.curveJoint.value);
  const isShown = joint >= 0 && clip !== null;
  parts.curves.hidden = parts.curveName.hidden = !isShown;
  if (!isShown) {
    parts.curveValues.textContent = shown = "";
    curves = [];
    return;
  }
  const measure = parts.curveMeasure.value;
  const key = [clip.key, clip.hash, base?.key, joint, measure, selected()?.hash].join();
  if (key === shown) return;
  shown = key;
  const count = Math.min(nFrames(), MAX_POINTS);
  const frames = Array.from({ length: count }, (_, i) => Math.round((i / Math.max(count - 1, 1)) * (nFrames() - 1)));
  const inOwn = (own) => frames.map((frame) => frameIn(own, frame));
  const curveOf = (name, own) => ({ name, frames, values: valuesOf(own, joint, measure, inOwn(own)) });
  curves = [curveOf("graft", clip), ...(base ? [curveOf("base", base)] : [])];
  draw();
  const title = `${parts.curveJoint.value}: ${measure} of graft and base`;
  parts.curvePicture.setAttribute("aria-label", title);
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
  parts.curvePicture.replaceChildren(...lines);
}

function writeValues() {
  if (!curves.length) return;
  const unit = UNITS[parts.curveMeasure.value];
  const texts = curves.map(({ name, frames, values }) => {
    const index = frames.findLastIndex((frame) => frame <= player.frame);
    return `${name} ${values[Math.max(index, 0)].toFixed(unit === "°" ? 0 : 2)}${unit}`;
  });
  parts.curveValues.textContent = parts.curveValues.title = `${parts.curveJoint.value}: ${texts.join(", ")}`;
}
