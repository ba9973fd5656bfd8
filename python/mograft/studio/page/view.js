// One drawing by three.js for the stage and all cards: each region of the page is a part of it.
import { actorOf, allActors, poseActor, sizeOf } from "/viewer/actors.js";
import { ink } from "/viewer/colours.js";
import { nodePlace } from "/viewer/poses.js";
import { find, root, scene, state } from "/viewer/scene.js";

const world = new THREE.Scene();
const sun = new THREE.DirectionalLight(0xffffff, 2.3);
const regions = new Set();
const surfaces = []; // One for the stage, one for all cards.
let floor = null;
let lines = null;
let shade = null;
let isAsked = false;

export const addToWorld = (...objects) => world.add(...objects);

function makeFloor() {
  lines = new THREE.GridHelper(24, 24);
  shade = new THREE.Mesh(new THREE.PlaneGeometry(24, 24).rotateX(-Math.PI / 2), new THREE.ShadowMaterial({ opacity: 0.2 }));
  for (const { material } of [lines, shade]) Object.assign(material, { vertexColors: false, depthWrite: false });
  shade.receiveShadow = true;
  floor = new THREE.Group().add(lines, shade);
  return floor;
}

// Whether a processor draws in place of a graphics card: edges are not smoothed then.
function isSoftware() {
  const context = document.createElement("canvas").getContext("webgl2");
  const names = context?.getExtension("WEBGL_debug_renderer_info");
  const name = names ? context.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

// Start three.js; without WebGL, figures are not drawn, and the page says so.
export function startView() {
  world.add(new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.9), sun, sun.target, makeFloor());
  sun.castShadow = true;
  sun.shadow.mapSize.set(512, 512);
  sun.shadow.radius = 5;
  sun.shadow.bias = -0.002;
  const antialias = !isSoftware();
  const areas = { stageCanvas: find("tiles"), cardsCanvas: document.getElementById("pane-motions") };
  for (const [name, around] of Object.entries(areas)) {
    const canvas = find(name);
    const context = canvas.getContext("webgl2", { antialias, preserveDrawingBuffer: true });
    find("reason").hidden = context !== null;
    if (!context) return;
    const renderer = new THREE.WebGLRenderer({ canvas, context, alpha: true, antialias, preserveDrawingBuffer: true });
    renderer.autoClear = false;
    renderer.setClearColor(0x000000, 0);
    renderer.shadowMap.enabled = name === "stageCanvas";
    renderer.shadowMap.autoUpdate = false;
    renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    surfaces.push({ canvas, around, renderer, place: "" });
  }
  for (const kind of ["scroll", "resize", "toggle"]) window.addEventListener(kind, redrawAll, { capture: true, passive: true });
  new ResizeObserver(redrawAll).observe(root);
}

// A region draws what `prepare` returns: figures, the first of which the camera sees, and objects.
// null means that there is nothing to draw yet.
export function addRegion(element, prepare, { isStage = false } = {}) {
  const region = { element, prepare, isStage, isDirty: true, place: "", camera: new THREE.PerspectiveCamera() };
  regions.add(region);
  redraw(region);
  return region;
}
export function dropRegion(region) {
  regions.delete(region);
  redrawAll();
}

export function redraw(region) {
  region.isDirty = true;
  if (isAsked) return;
  isAsked = true;
  requestAnimationFrame(drawAll);
}
export function redrawAll() {
  for (const region of regions) redraw(region);
}

// The rectangle of a region in the window, and the part of it that scrolling leaves visible.
function placeOf(element) {
  const { left, top, right, bottom } = element.getBoundingClientRect();
  const seen = { left: Math.max(left, 0), top: Math.max(top, 0) };
  Object.assign(seen, { right: Math.min(right, window.innerWidth), bottom: Math.min(bottom, window.innerHeight) });
  for (let above = element.parentElement; above && above !== root; above = above.parentElement) {
    if (above.scrollHeight === above.clientHeight && above.scrollWidth === above.clientWidth) continue;
    if (getComputedStyle(above).overflow === "visible") continue;
    const box = above.getBoundingClientRect();
    seen.left = Math.max(seen.left, box.left);
    seen.top = Math.max(seen.top, box.top);
    seen.right = Math.min(seen.right, box.right);
    seen.bottom = Math.min(seen.bottom, box.bottom);
  }
  return { left, top, width: right - left, height: bottom - top, seen };
}
const isSeen = ({ seen, width }) => width > 1 && seen.right - seen.left > 1 && seen.bottom - seen.top > 1;
export const isVisible = (region) => isSeen(placeOf(region.element));

function drawAll() {
  isAsked = false;
  const places = new Map([...regions].map((region) => [region, placeOf(region.element)]));
  for (const surface of surfaces) drawSurface(surface, places);
  for (const region of regions) {
    if (region.isDirty && !surfaces.length) region.prepare();
    region.isDirty = false;
  }
}

// A canvas covers what is seen of its part of the page; its regions are drawn if they changed.
function drawSurface(surface, places) {
  const { canvas, around, renderer } = surface;
  const own = [...places].filter(([{ element }]) => around.contains(element));
  canvas.hidden = !own.some(([, place]) => isSeen(place));
  if (canvas.hidden || !own.some(([region]) => region.isDirty)) return;
  const { seen } = placeOf(around);
  const ratio = Math.min(window.devicePixelRatio || 1, 1.5);
  const key = JSON.stringify([seen, ratio, own.map(([, place]) => place)]);
  const isMoved = key !== surface.place;
  if (isMoved) {
    surface.place = key;
    const [width, height] = [seen.right - seen.left, seen.bottom - seen.top];
    Object.assign(canvas.style, { left: `${seen.left}px`, top: `${seen.top}px`, width: `${width}px`, height: `${height}px` });
    if (renderer.getPixelRatio() !== ratio) renderer.setPixelRatio(ratio);
    if (canvas.width !== Math.floor(width * ratio) || canvas.height !== Math.floor(height * ratio))
      renderer.setSize(width, height, false);
    renderer.setScissorTest(false);
    renderer.clear();
  }
  renderer.setScissorTest(true);
  for (const [region, place] of own) if ((isMoved || region.isDirty) && isSeen(place)) drawRegion(region, place, surface, seen);
}

function drawRegion(region, { left, top, width, height, seen }, { renderer }, whole) {
  renderer.setViewport(left - whole.left, whole.bottom - top - height, width, height);
  renderer.setScissor(seen.left - whole.left, whole.bottom - seen.bottom, seen.right - seen.left, seen.bottom - seen.top);
  renderer.clear();
  const shown = region.prepare(region);
  if (!shown?.figures.length) return;
  const actors = shown.figures.map(({ clip, frame, ...look }) => {
    const actor = actorOf(clip);
    world.add(actor.root);
    poseActor(actor, frame, look);
    // three.js updates a skeleton once in each frame, but a figure has another pose in each region.
    for (const mesh of [actor.capsules, ...actor.meshes]) if (mesh.visible) mesh.skeleton.update();
    return actor;
  });
  const { clip } = shown.figures[0];
  // The size of a character is measured against the floor and height of its figure.
  Object.assign(scene, { height: clip.height, floor: clip.floor });
  const view = aim(region, shown, grownOf(actors[0]), { width, height });
  placeWorld(view, clip, actors, region.isStage, shown.objects || []);
  renderer.shadowMap.needsUpdate = region.isStage && state.floor;
  renderer.render(world, region.camera);
  shown.after?.(view);
}

// How much higher than its skeleton a character is: that of its figure that is drawn first.
const sizes = new Map();
function grownOf(actor) {
  if (actor.capsules.visible) return 1;
  const key = scene.characters[actor.clip.character];
  if (!sizes.has(key)) sizes.set(key, sizeOf(actor));
  return sizes.get(key);
}

// Aim the camera of a region at the first figure; return the projection to pixels of the region.
function aim({ camera, isStage }, { figures, follow = true, stand = 0, look = state }, grown, { width, height }) {
  const { clip, frame } = figures[0];
  const tall = clip.height;
  const seen = follow ? frame : stand;
  const k = Math.min(Math.round(seen / clip.step), clip.kept - 1) * 3;
  const target = new THREE.Vector3(clip.cameraPath[k], clip.floor + 0.5 * tall * grown, clip.cameraPath[k + 2]);
  const distance = ((follow ? 3.4 : 5) * tall * grown) / look.zoom;
  const focus = (isStage ? 2.25 : 2.7) * Math.min(1.25 * width, height);
  camera.fov = (360 / Math.PI) * Math.atan(height / 2 / focus);
  camera.aspect = width / height;
  Object.assign(camera, { near: 0.05 * distance, far: distance + 12 * tall });
  camera.position.setFromSphericalCoords(distance, Math.PI / 2 - look.pitch, look.yaw).add(target);
  camera.lookAt(target);
  camera.translateX(-look.pan[0] * tall).translateY(-look.pan[1] * tall);
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  const point = (place) => {
    const { x, y, z } = new THREE.Vector3(...place).project(camera);
    return [((x + 1) * width) / 2, ((1 - y) * height) / 2, z];
  };
  return { clip, camera, target, point, width, height, tall, distance, scale: focus / distance };
}

function placeWorld({ clip, target, tall, distance }, first, actors, isStage, objects) {
  const roots = new Set(actors.map(({ root: own }) => own));
  for (const actor of allActors()) actor.root.visible = roots.has(actor.root);
  for (const own of world.children) if (own.userData.isOnStage) own.visible = objects.includes(own);
  const step = tall / 3;
  floor.visible = state.floor;
  shade.visible = isStage;
  floor.scale.setScalar(step);
  floor.position.set(Math.round(target.x / step) * step, clip.floor, Math.round(target.z / step) * step);
  lines.material.color.set(ink.line);
  lines.visible = isStage;
  world.fog = isStage ? new THREE.Fog(ink.paper, distance + 0.5 * tall, distance + 4 * tall) : null;
  const [x, , z] = nodePlace(first, first.now, first.root);
  sun.target.position.set(x, clip.floor + 0.4 * tall, z);
  sun.position.set(x + 0.7 * tall, clip.floor + 3 * tall, z + 0.9 * tall);
  Object.assign(sun.shadow.camera, { left: -tall, right: tall, top: tall, bottom: -tall, near: 0.1 * tall, far: 6 * tall });
  sun.shadow.camera.updateProjectionMatrix();
}
