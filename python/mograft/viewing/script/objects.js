// Obstacles and targets of constraints.
import { actorOf, poseActor } from "./actors.js";
import { ink } from "./colours.js";
import { nodePlace } from "./poses.js";
import { clamp, first, scene, state } from "./scene.js";

const MIN_TARGET = 5; // Radius of the mark of a target in pixels, at least.

const isActive = ({ frames }) => !frames || (state.frame >= frames[0] && state.frame <= frames[1]);
const colourOf = ({ kind }) => ({ target: ink.accent, figure: ink.character })[kind] || ink.obstacle;

// The shape of an object about its centre, without rotation.
const SHAPES = {
  sphere: ({ radius }) => new THREE.SphereGeometry(radius, 32, 20),
  capsule: ({ radius, length }) => new THREE.CapsuleGeometry(radius, length, 8, 24),
  box: ({ half }) => new THREE.BoxGeometry(...half.map((value) => 2 * value)),
  plane: () => new THREE.PlaneGeometry(2.4 * scene.height, 2.4 * scene.height, 8, 8),
};

const shapes = [];

export function addObjects(world) {
  for (const object of scene.objects) {
    if (object.kind === "target") continue;
    if (object.kind === "figure") {
      const actor = actorOf(object.clip);
      actor.isObject = true;
      shapes.push({ object, actor });
      world.add(actor.root);
      continue;
    }
    const geometry = SHAPES[object.kind](object);
    const material = new THREE.MeshBasicMaterial({ transparent: true, depthWrite: false, side: THREE.DoubleSide });
    const outline = object.kind === "plane" ? new THREE.WireframeGeometry(geometry) : new THREE.EdgesGeometry(geometry, 20);
    const lines = new THREE.LineSegments(outline, new THREE.LineBasicMaterial({ transparent: true }));
    const shape = new THREE.Mesh(geometry, material);
    shape.add(lines);
    shape.position.fromArray(object.center);
    if (object.turn) shape.quaternion.fromArray(object.turn);
    shapes.push({ object, shape, lines });
    world.add(shape);
  }
}

// Place the objects for a view: planes are drawn near the figure.
export function poseObjects({ target }) {
  for (const { object, shape, lines, actor } of shapes) {
    const strength = isActive(object) ? 1 : 0.35;
    if (actor) {
      const { clip } = actor;
      const moved = Math.round((state.frame * first.dt - object.delay) / clip.dt);
      poseActor(actor, clamp(moved, 0, clip.frames - 1), { alpha: 0.6 * strength, colour: ink.character });
      continue;
    }
    for (const { material } of [shape, lines]) material.color.set(colourOf(object));
    shape.material.opacity = 0.3 * strength;
    lines.material.opacity = 0.8 * strength;
    if (object.kind !== "plane") continue;
    const normal = new THREE.Vector3(0, 0, 1).applyQuaternion(shape.quaternion);
    const point = new THREE.Vector3().fromArray(object.center);
    shape.position.copy(target).addScaledVector(normal, -target.clone().sub(point).dot(normal));
  }
}

export function strokeLine(pen, points) {
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(x, y);
  pen.stroke();
}

function drawTarget(pen, object, view) {
  const center = view.point(object.center);
  const [x, y, depth] = center;
  if (depth > 1) return;
  const radius = Math.max(object.radius * view.scale, MIN_TARGET);
  pen.lineWidth = 2;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  for (const side of [-radius, radius]) {
    pen.moveTo(x + 0.5 * side, y);
    pen.lineTo(x + 1.6 * side, y);
    pen.moveTo(x, y + 0.5 * side);
    pen.lineTo(x, y + 1.6 * side);
  }
  pen.stroke();
  const { clip } = view;
  if (!isActive(object) || object.joint < 0 || object.joint >= clip.parents.length) return;
  const joint = view.point(nodePlace(clip, clip.now, object.joint));
  if (joint[2] > 1) return;
  pen.setLineDash([4, 4]);
  pen.lineWidth = 1.5;
  strokeLine(pen, [joint, center]);
  pen.setLineDash([]);
}

// The marks of targets, and the labels of objects that apply in this frame.
export function drawLabels(pen, view) {
  const [left, top, width, height] = view.tile;
  for (const object of scene.objects) {
    pen.strokeStyle = pen.fillStyle = colourOf(object);
    pen.globalAlpha = isActive(object) ? 1 : 0.35;
    if (object.kind === "target") drawTarget(pen, object, view);
    pen.globalAlpha = 1;
    if (!isActive(object) || !object.label || !object.center) continue;
    const [x, y, depth] = view.point(object.center);
    const size = object.radius || Math.max(...(object.half || [0]));
    const above = y - Math.max(size * view.scale, 1.6 * MIN_TARGET) - 5;
    if (depth > 1 || x < left || x > left + width || above < top || above > top + height) continue;
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.lineWidth = 3;
    pen.lineJoin = "round";
    pen.strokeStyle = ink.paper;
    const half = pen.measureText(object.label).width / 2 + 4;
    const middle = clamp(x, left + half, Math.max(left + width - half, left + half));
    pen.strokeText(object.label, middle, above);
    pen.fillText(object.label, middle, above);
  }
}

// The frames in which constraints apply, as marks at the lower edge of the overview.
export function drawObjectFrames(pen, toPlace, height) {
  for (const object of scene.objects.filter(({ frames }) => frames)) {
    const [a, b] = object.frames.map(toPlace);
    pen.fillStyle = colourOf(object);
    pen.fillRect(a - 1, height - 6, Math.max(b - a, 0) + 2, 4);
  }
}
