// Constraints on the stage: their shapes, and gizmos that move, rotate and scale the chosen one.
import { ink } from "/viewer/colours.js";
import { makePose, nodePlace } from "/viewer/poses.js";
import { jointNames, setConstraint } from "./constraints.js";
import { figureOf } from "./figures.js";
import { frameTime, mainFigure, player } from "./player.js";
import { framesText, obstacleOf, titleOf, upOf } from "./records.js";
import { chooseConstraint } from "./ranges.js";
import { label, onFigures, onGizmo, onMarks, onObjects, onPointer, redrawStage, stage } from "./stage.js";
import { emit, on, selected, store } from "./store.js";
import { parts } from "./ui.js";
import { addToWorld } from "./view.js";

const MAX_SOLVING = 2; // Requests of one drag that are answered at the same time.
const MIN_MILLISECONDS = 50; // Between two of them.
const FORWARD = [0, 0, 1];

const space = new THREE.Group(); // The axes of the file.
const shapes = new Map(); // Number of a constraint -> its shape.
let controls = null;
let written = "";
let drag = null; // The record while a gizmo moves, and what is being solved.

export function startGizmo() {
  space.userData.isOnStage = true;
  addToWorld(space);
  onObjects((clip) => {
    if (store.mode === "draw") return []; // A path is drawn on an empty floor.
    space.quaternion.fromArray(clip.turn);
    tint();
    return controls?.object ? [space, controls.getHelper()] : [space];
  });
  onFigures(characterFigures);
  onMarks(drawLabels);
  onGizmo(() => Boolean(controls?.axis || controls?.dragging));
  onPointer("view", { click: pick });
  on("project selected figure", write);
  on("constraint mode", attach);
  on("selected", () => {
    store.constraint = null;
    attach();
  });
  for (const own of parts.gizmo.querySelectorAll("[data-mode]")) own.addEventListener("click", () => setMode(own.dataset.mode));
  parts.gizmoDone.addEventListener("click", () => choose(null));
}

function choose(number) {
  store.constraint = number;
  emit("constraint");
}

// The controls need the camera of the stage, so they are made when they are first used.
function makeControls() {
  controls = new THREE.TransformControls(stage.graft.camera, parts.graftTile);
  controls.setSize(0.9);
  const helper = controls.getHelper();
  helper.userData.isOnStage = true;
  addToWorld(helper);
  controls.addEventListener("change", redrawStage);
  controls.addEventListener("mouseDown", () => {
    const own = shapes.get(store.constraint);
    drag = { motion: selected(), number: store.constraint, record: own.record, wanted: null, solving: 0, sent: 0 };
  });
  controls.addEventListener("objectChange", () => {
    if (!drag) return;
    drag.wanted = recordOf(shapes.get(drag.number));
    solve();
  });
  controls.addEventListener("mouseUp", finish);
}

export function setMode(mode) {
  if ((store.constraint ?? null) === null || !controls) return;
  controls.setMode(mode);
  for (const own of parts.gizmo.querySelectorAll("[data-mode]")) own.setAttribute("aria-pressed", own.dataset.mode === mode);
  redrawStage();
}

// Solve for the latest place of a drag: newer ones replace those that wait.
function solve() {
  if (!drag?.wanted || drag.solving >= MAX_SOLVING) return;
  const own = drag;
  const wait = own.sent + MIN_MILLISECONDS - performance.now();
  if (wait > 0) {
    own.timer ||= setTimeout(() => {
      own.timer = 0;
      if (drag === own) solve();
    }, wait);
    return;
  }
  const { motion, number, wanted } = own;
  Object.assign(own, { wanted: null, sent: performance.now() });
  own.solving++;
  setConstraint(motion, number, wanted, true).finally(() => {
    own.solving--;
    if (drag === own) solve();
  });
}

async function finish() {
  const own = drag;
  drag = null;
  if (!own || !(own.wanted || own.sent)) return;
  const record = recordOf(shapes.get(own.number));
  while (own.solving) await new Promise((resolve) => setTimeout(resolve, 20));
  await setConstraint(own.motion, own.number, record);
  written = "";
  write();
}

// The record of a shape after a gizmo changed its place, orientation or scale.
export function recordOf({ record, mesh, scale }) {
  const round = (value) => Number(value.toPrecision(6));
  const place = mesh.position.toArray().map(round);
  // The axis that was scaled most sets sizes that have only one number.
  const factors = mesh.scale.toArray().map((value, i) => Math.abs(value / scale[i]));
  const factor = factors.reduce((most, own) => (Math.abs(Math.log(own)) > Math.abs(Math.log(most)) ? own : most), 1);
  if (record.kind === "Reach") return { ...record, target: place, tolerance: round(record.tolerance * factor || 0.03) };
  if (record.kind === "Face") return { ...record, target: place };
  const old = obstacleOf(record);
  const own = { ...old };
  if (old.kind === "Sphere") Object.assign(own, { center: place, radius: round(old.radius * factor) });
  else if (old.kind === "Box") {
    const half = old.half.map((value, i) => round(value * factors[i]));
    Object.assign(own, { center: place, half, rotation: mesh.quaternion.clone().normalize().toArray() });
  } else if (old.kind === "Capsule") {
    const half = new THREE.Vector3(0, (lengthOf(old) / 2) * factors[1], 0).applyQuaternion(mesh.quaternion);
    own.start = mesh.position.clone().sub(half).toArray().map(round);
    own.stop = mesh.position.clone().add(half).toArray().map(round);
    own.radius = round(old.radius * Math.max(factors[0], factors[2]));
  } else if (old.kind === "HalfSpace") {
    const normal = new THREE.Vector3(...FORWARD).applyQuaternion(mesh.quaternion);
    Object.assign(own, { point: place, normal: normal.toArray().map(round) });
  } else if (old.kind === "Character") {
    const up = upOf(mainFigure());
    const { x, y, z, w } = mesh.quaternion;
    Object.assign(own, { offset: place, yaw: round(2 * Math.atan2(new THREE.Vector3(x, y, z).dot(up), w)) });
  }
  return record.obstacle ? { ...record, obstacle: own } : { ...record, region: own };
}

const lengthOf = ({ start, stop }) => new THREE.Vector3(...start).distanceTo(new THREE.Vector3(...stop));

// A mesh in the axes of the file.
export function makeMesh(record, clip) {
  const own = obstacleOf(record);
  const tall = clip.height;
  const mesh = new THREE.Mesh();
  const set = (geometry, place) => {
    mesh.geometry = geometry;
    mesh.position.fromArray(place);
  };
  if (!own) {
    const radius = record.kind === "Reach" ? record.tolerance * tall : 0.02 * tall;
    set(new THREE.SphereGeometry(Math.max(radius, 0.008 * tall), 20, 12), record.target);
  } else if (own.kind === "Sphere") set(new THREE.SphereGeometry(own.radius, 32, 20), own.center);
  else if (own.kind === "Box") {
    set(new THREE.BoxGeometry(...own.half.map((value) => 2 * value)), own.center);
    mesh.quaternion.fromArray(own.rotation || [0, 0, 0, 1]);
  } else if (own.kind === "Capsule") {
    const [start, stop] = [new THREE.Vector3(...own.start), new THREE.Vector3(...own.stop)];
    set(new THREE.CapsuleGeometry(own.radius, lengthOf(own), 8, 24), start.clone().add(stop).multiplyScalar(0.5).toArray());
    mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), stop.sub(start).normalize());
  } else if (own.kind === "HalfSpace") {
    set(new THREE.PlaneGeometry(2.4 * tall, 2.4 * tall, 8, 8), own.point);
    mesh.quaternion.setFromUnitVectors(new THREE.Vector3(...FORWARD), new THREE.Vector3(...own.normal).normalize());
  } else if (own.kind === "Character") {
    set(new THREE.BoxGeometry(0.02 * tall, 0.02 * tall, 0.02 * tall), own.offset || [0, 0, 0]);
    mesh.quaternion.setFromAxisAngle(upOf(clip), own.yaw || 0);
  }
  return mesh;
}

const isDrawn = ({ kind, target }) =>
  kind === "Avoid" || kind === "KeepOut" || ((kind === "Reach" || kind === "Face") && Array.isArray(target));

function write() {
  const [motion, clip] = [selected(), mainFigure()];
  if (drag) return;
  const all = (motion && clip?.now && motion.constraints.filter(({ record }) => isDrawn(record))) || [];
  const key = JSON.stringify([motion?.id, clip?.key, all]);
  if (key === written) return;
  written = key;
  controls?.detach();
  for (const { mesh, outline } of shapes.values()) {
    mesh.removeFromParent();
    mesh.geometry.dispose();
    outline.geometry.dispose();
  }
  shapes.clear();
  for (const { number, record } of all) {
    const mesh = makeMesh(record, clip);
    mesh.material = new THREE.MeshBasicMaterial({ transparent: true, depthWrite: false, side: THREE.DoubleSide });
    const isWall = obstacleOf(record)?.kind === "HalfSpace";
    const edges = isWall ? new THREE.WireframeGeometry(mesh.geometry) : new THREE.EdgesGeometry(mesh.geometry, 20);
    const outline = new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ transparent: true }));
    mesh.add(outline);
    space.add(mesh);
    shapes.set(number, { number, record, mesh, outline, scale: mesh.scale.toArray() });
  }
  attach();
}

function attach() {
  const own = store.mode === "view" ? shapes.get(store.constraint) : null;
  parts.gizmo.hidden = !own;
  if (own && !controls) makeControls();
  if (own) {
    controls.attach(own.mesh);
    setMode(controls.mode);
  } else controls?.detach();
  redrawStage();
}

const isActive = ({ frames }) => !frames || (player.frame >= frames[0] && player.frame <= frames[1]);

function tint() {
  for (const { number, record, mesh, outline } of shapes.values()) {
    const isTarget = !obstacleOf(record);
    const colour = isTarget ? ink.accent : ink.obstacle;
    const strength = isActive(record) || number === store.constraint ? 1 : 0.35;
    for (const { material } of [mesh, outline]) material.color.set(colour);
    mesh.material.opacity = (isTarget ? 0.6 : 0.28) * strength;
    outline.material.opacity = 0.85 * strength;
  }
}

// Other characters, placed as their constraints say.
const doubles = new Map();
function characterFigures(clip) {
  const figures = [];
  if (store.mode === "draw") return figures;
  for (const { number, record, mesh } of shapes.values()) {
    const own = obstacleOf(record);
    if (own?.kind !== "Character") continue;
    const source = figureOf("clip", own.motion?.name);
    if (!source) continue;
    if (doubles.get(number)?.source !== source)
      doubles.set(number, { source, figure: Object.create(source, { now: { value: makePose(source) } }) });
    const { figure } = doubles.get(number);
    const turn = new THREE.Quaternion(...clip.turn);
    figure.now.base.quaternion.copy(turn).multiply(mesh.quaternion);
    figure.now.base.position.copy(mesh.position).applyQuaternion(turn);
    const at = Math.round((player.frame * frameTime() - (own.delay || 0)) / source.dt);
    figures.push({ clip: figure, frame: Math.max(0, Math.min(at, source.frames - 1)), alpha: 0.6, colour: ink.character });
  }
  return figures;
}

function drawLabels(pen, view) {
  if (store.mode === "draw") return;
  const joints = jointNames();
  const motion = selected();
  for (const { number, record, mesh } of shapes.values()) {
    const [x, y, depth] = view.point(mesh.getWorldPosition(new THREE.Vector3()).toArray());
    if (depth > 1) continue;
    const isStrong = isActive(record) || number === store.constraint;
    pen.globalAlpha = isStrong ? 1 : 0.4;
    pen.fillStyle = pen.strokeStyle = obstacleOf(record) ? ink.obstacle : ink.accent;
    const index = joints.indexOf(record.joint);
    if (!obstacleOf(record) && index >= 0 && isActive(record)) {
      const [jx, jy] = view.point(nodePlace(view.clip, view.clip.now, index));
      pen.setLineDash([4, 4]);
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.moveTo(jx, jy);
      pen.lineTo(x, y);
      pen.stroke();
      pen.setLineDash([]);
    }
    if (isStrong) label(`${titleOf(motion, number)}${record.frames ? `, ${framesText(record)}` : ""}`, x, y - 14, view);
    pen.globalAlpha = 1;
  }
}

// A click on a shape chooses its constraint.
function pick([x, y], view) {
  if (!view || !shapes.size) return;
  const ray = new THREE.Raycaster();
  ray.setFromCamera(new THREE.Vector2((2 * x) / view.width - 1, 1 - (2 * y) / view.height), view.camera);
  const all = [...shapes.values()];
  const [hit] = ray.intersectObjects(all.map(({ mesh }) => mesh), false);
  const found = hit && all.find(({ mesh }) => mesh === hit.object);
  if (found) chooseConstraint(found.number);
  else choose(null);
}
