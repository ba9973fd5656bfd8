// The stage: one drawing by three.js, with a view for each shown figure, and marks above it.
import { actorOf, allActors, poseActor, sizeOf } from "./actors.js";
import { groupColour, ink } from "./colours.js";
import { bonePlace, makePose, nodePlace, setPose } from "./poses.js";
import { addObjects, drawLabels, poseObjects, strokeLine } from "./objects.js";
import { clipFrame, find, marks, scene, shownClips, size, stage, state } from "./scene.js";

const pen = marks.getContext("2d");
const world = new THREE.Scene();
const camera = new THREE.PerspectiveCamera();
const sun = new THREE.DirectionalLight(0xffffff, 2.3);
const tall = scene.height;
let renderer = null;
let floor = null;

// Fog of the colour of the page hides the edge of the floor.
function makeFloor() {
  const lines = new THREE.GridHelper(24, 24);
  const shadow = new THREE.Mesh(
    new THREE.PlaneGeometry(24, 24).rotateX(-Math.PI / 2),
    new THREE.ShadowMaterial({ opacity: 0.2 }),
  );
  for (const { material } of [lines, shadow]) Object.assign(material, { vertexColors: false, depthWrite: false });
  shadow.receiveShadow = true;
  floor = new THREE.Group().add(lines, shadow);
  floor.scale.setScalar(tall / 3);
  floor.userData = { lines };
  return floor;
}

// Start three.js; without WebGL, the stage shows still figures and the reason.
export function startStage() {
  const context = stage.getContext("webgl2", { antialias: true });
  find("reason").hidden = context !== null;
  if (!context) return;
  renderer = new THREE.WebGLRenderer({ canvas: stage, context, alpha: true, antialias: true });
  renderer.autoClear = false;
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFSoftShadowMap;
  sun.castShadow = true;
  sun.shadow.mapSize.set(512, 512);
  sun.shadow.radius = 5;
  sun.shadow.bias = -0.002;
  Object.assign(sun.shadow.camera, { left: -tall, right: tall, top: tall, bottom: -tall, near: 0.1 * tall, far: 6 * tall });
  world.add(new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.9), sun, sun.target, makeFloor());
  addObjects(world);
}

// The rectangle of each shown figure: left, top, width, height.
export function tiles() {
  const { width, height } = size;
  if (state.overlay) return [[0, 0, width, height]];
  const count = state.shown.length;
  const room = (columns) => Math.min(width / columns, (height / Math.ceil(count / columns)) * 0.8);
  let columns = 1;
  for (let more = 2; more <= count; more++) if (room(more) > room(columns) * 1.001) columns = more;
  const lines = Math.ceil(count / columns);
  return state.shown.map((_, i) => [
    ((i % columns) * width) / columns,
    (Math.floor(i / columns) * height) / lines,
    width / columns,
    height / lines,
  ]);
}

// Aim the camera at a figure; return the middle of the view and the projection to the canvas.
function aim(clip, [left, top, width, height], grown) {
  // A camera that does not follow stays where it was when following was switched off.
  const seen = clipFrame(clip, state.follow ? state.frame : state.stand);
  const k = Math.min(Math.round(seen / clip.step), clip.kept - 1) * 3;
  const target = new THREE.Vector3(clip.cameraPath[k], scene.floor + 0.5 * tall * grown, clip.cameraPath[k + 2]);
  const distance = ((state.follow ? 3.4 : 5) * tall * grown) / state.zoom;
  // The figure fills two thirds of the height, and most of the width of a narrow view.
  const focus = 2.25 * Math.min(1.25 * width, height);
  camera.fov = (360 / Math.PI) * Math.atan(height / 2 / focus);
  camera.aspect = width / height;
  Object.assign(camera, { near: 0.05 * distance, far: distance + 12 * tall });
  camera.position.setFromSphericalCoords(distance, Math.PI / 2 - state.pitch, state.yaw).add(target);
  camera.lookAt(target);
  camera.translateX(-state.pan[0] * tall).translateY(-state.pan[1] * tall);
  camera.setViewOffset(width, height, 0, -0.05 * height, width, height);
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  const point = (place) => {
    const { x, y, z } = new THREE.Vector3(...place).project(camera);
    return [left + ((x + 1) * width) / 2, top + ((1 - y) * height) / 2, z];
  };
  const scale = focus / distance; // Pixels per unit of length at the figure.
  return { clip, target, point, scale, tile: [left, top, width, height] };
}

function drawTrails(clip, frame, view) {
  const back = Math.round(1.5 / clip.dt);
  const step = Math.max(1, clip.step, Math.round(1 / 30 / clip.dt));
  const pose = makePose(clip);
  const trails = clip.tips.map(() => []);
  for (let f = Math.max(0, frame - back); f <= frame; f += step) {
    setPose(clip, f, pose);
    clip.tips.forEach((tip, i) => trails[i].push(view.point(nodePlace(clip, pose, tip))));
  }
  pen.lineWidth = 1.6;
  trails.forEach((trail, i) => {
    const joint = clip.tips[i] < clip.parents.length ? clip.tips[i] : clip.ends[clip.tips[i] - clip.parents.length][0];
    pen.strokeStyle = groupColour(clip.groups[clip.group[joint]]);
    for (let k = 1; k < trail.length; k++) {
      pen.globalAlpha = (0.75 * k) / trail.length;
      strokeLine(pen, [trail[k - 1], trail[k]]);
    }
  });
  pen.globalAlpha = 1;
}

// Without WebGL: the bones of the figure as lines, in this frame and paler in later ones.
function drawStrip(clip, view) {
  const pose = makePose(clip);
  const gap = Math.max(1, Math.round(0.4 / clip.dt));
  pen.lineCap = "round";
  for (let still = 4; still >= 0; still--) {
    setPose(clip, Math.min(clipFrame(clip, state.frame) + still * gap, clip.frames - 1), pose);
    const shift = ((still - 2) * view.tile[2]) / 6;
    pen.globalAlpha = still ? 0.35 : 1;
    for (const [joint, x, y, z, radius] of clip.bones) {
      const places = [nodePlace(clip, pose, joint), bonePlace(pose.bones[joint], [x, y, z])];
      pen.strokeStyle = groupColour(clip.groups[clip.group[joint]]);
      pen.lineWidth = Math.max(1.5, radius * view.scale);
      const ends = places.map(view.point);
      strokeLine(pen, ends.map(([px, py]) => [px + shift, py]));
    }
  }
  pen.globalAlpha = 1;
}

function render({ clip, target, tile: [left, top, width, height] }, actors) {
  const roots = new Set(actors.map(({ root }) => root));
  for (const actor of allActors()) actor.root.visible = actor.isObject || roots.has(actor.root);
  const step = tall / 3;
  floor.visible = state.floor;
  floor.position.set(Math.round(target.x / step) * step, scene.floor, Math.round(target.z / step) * step);
  floor.userData.lines.material.color.set(ink.line);
  world.fog = new THREE.Fog(ink.paper, camera.far - 11.5 * tall, camera.far - 8 * tall);
  const [x, , z] = nodePlace(clip, clip.now, clip.root);
  sun.target.position.set(x, scene.floor + 0.4 * tall, z);
  sun.position.set(x + 0.7 * tall, scene.floor + 3 * tall, z + 0.9 * tall);
  renderer.setViewport(left, size.height - top - height, width, height);
  renderer.setScissor(left, size.height - top - height, width, height);
  renderer.render(world, camera);
}

export function drawStage() {
  const { width, height, ratio } = size;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const shown = shownClips();
  const places = tiles();
  if (renderer) {
    if (stage.width !== Math.floor(width * ratio) || stage.height !== Math.floor(height * ratio)) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height, false);
    }
    renderer.setScissorTest(false);
    renderer.clear();
    renderer.setScissorTest(true);
  }
  // In the overlay, all figures are seen by the camera of the first.
  const actors = shown.map((clip, i) => {
    if (!renderer) return null;
    const actor = actorOf(clip);
    world.add(actor.root);
    poseActor(actor, clipFrame(clip, state.frame), { alpha: state.overlay && i ? 0.45 : 1 });
    return actor;
  });
  const grown = renderer ? Math.max(...actors.map(sizeOf)) : 1;
  places.forEach((tile, i) => {
    const view = aim(shown[i], tile, grown);
    const seen = state.overlay ? shown : [shown[i]];
    pen.save();
    pen.beginPath();
    pen.rect(...tile);
    pen.clip();
    if (renderer) {
      poseObjects(view);
      render(view, state.overlay ? actors : [actors[i]]);
      drawLabels(pen, view);
    } else for (const clip of seen) drawStrip(clip, view);
    if (state.trails) for (const clip of seen) drawTrails(clip, clipFrame(clip, state.frame), view);
    pen.restore();
  });
}
