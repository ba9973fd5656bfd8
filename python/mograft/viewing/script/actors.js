// The figures as meshes that are bound to their joints: capsules, or the skinned mesh of a character.
import { groupColour, ink } from "./colours.js";
import { characterMeshes } from "./character.js";
import { setPose } from "./poses.js";
import { clips, scene, state } from "./scene.js";

const UP = new THREE.Vector3(0, 1, 0);

// A capsule from a to b, or an ellipsoid about their middle if `width` is given; `rings` is how fine it is.
function makeLimb(rings, a, b, radius, width) {
  const along = b.clone().sub(a);
  const length = along.length();
  const shape = width
    ? new THREE.SphereGeometry(1, 4 * rings, 3 * rings).scale(width, radius, width)
    : new THREE.CapsuleGeometry(radius, length, rings, 4 * rings);
  const turn = new THREE.Quaternion().setFromUnitVectors(UP, length ? along.divideScalar(length) : UP);
  const middle = a.clone().add(b).multiplyScalar(0.5);
  return shape.applyQuaternion(turn).translate(middle.x, middle.y, middle.z);
}

// The shapes of one bone in the axes of its joint.
function boneShapes(clip, [, x, y, z, radius, kind]) {
  const start = new THREE.Vector3();
  const end = new THREE.Vector3(x, y, z);
  const length = end.length();
  const limb = (...shape) => makeLimb(clip.rings || 4, ...shape);
  if (kind === "head") {
    const high = Math.max(0.66 * length, 1.2 * radius);
    const middle = end.clone().multiplyScalar(0.5);
    return [
      limb(middle, middle.clone().add(end.clone().multiplyScalar(1e-3)), high, 0.76 * high),
      limb(start, middle, 0.6 * radius),
    ];
  }
  if (kind === "hand")
    return [limb(start, end, 0.56 * length + 0.4 * radius, Math.min(1.25 * radius, 0.5 * length + 0.4 * radius))];
  if (kind === "foot") {
    // The heel is below the ankle, at the height of the ball of the foot.
    const up = UP.clone().applyQuaternion(new THREE.Quaternion(...clip.turn).invert());
    const rise = up.clone().multiplyScalar(end.dot(up));
    const ahead = end.clone().sub(rise);
    const heel = rise.addScaledVector(ahead, -0.22);
    return [limb(start, end, radius), limb(heel, end, radius), limb(start, heel, radius)];
  }
  return [limb(start, end, radius)];
}

// One geometry of all bones; each vertex is bound to one joint.
function capsuleGeometry(clip) {
  const arrays = { position: [], normal: [], skinIndex: [], skinWeight: [] };
  const index = [];
  for (const bone of clip.bones) {
    for (const shape of boneShapes(clip, bone)) {
      const first = arrays.skinIndex.length / 4;
      for (const name of ["position", "normal"]) for (const value of shape.attributes[name].array) arrays[name].push(value);
      for (let i = 0; i < shape.attributes.position.count; i++) arrays.skinIndex.push(bone[0], 0, 0, 0);
      for (const value of shape.index.array) index.push(first + value);
    }
  }
  arrays.skinWeight = arrays.skinIndex.map((_, i) => (i % 4 ? 0 : 1));
  const geometry = new THREE.BufferGeometry();
  for (const name of ["position", "normal", "skinWeight"]) {
    geometry.setAttribute(name, new THREE.Float32BufferAttribute(arrays[name], name === "skinWeight" ? 4 : 3));
  }
  geometry.setAttribute("skinIndex", new THREE.BufferAttribute(Uint16Array.from(arrays.skinIndex), 4));
  geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(arrays.position.length), 3));
  geometry.setIndex(index);
  return geometry;
}

// Bind a mesh to bones; by default, each vertex is in the axes of its bone.
export function bind(mesh, bones, inverses = bones.map(() => new THREE.Matrix4())) {
  mesh.bind(new THREE.Skeleton(bones, inverses), new THREE.Matrix4());
  mesh.frustumCulled = false;
  mesh.castShadow = true;
  return mesh;
}

const actors = new Map();
export const allActors = () => actors.values();

export function actorOf(clip) {
  if (!actors.has(clip)) {
    const { base, bones } = clip.now;
    const material = new THREE.MeshLambertMaterial({ vertexColors: true });
    const capsules = new THREE.SkinnedMesh(capsuleGeometry(clip), material);
    const root = new THREE.Group();
    root.add(base, bind(capsules, bones));
    const actor = { clip, bones, capsules, root, meshes: characterMeshes(clip, bones, bind), version: -1 };
    for (const mesh of actor.meshes) root.add(mesh);
    actors.set(clip, actor);
  }
  return actors.get(clip);
}

// Forget the meshes of a figure that is not shown again.
export function dropActor(clip) {
  const actor = actors.get(clip);
  if (!actor) return;
  actors.delete(clip);
  actor.root.removeFromParent();
  for (const { geometry, skeleton } of [actor.capsules, ...actor.meshes]) {
    geometry.dispose();
    skeleton.dispose();
  }
}

// Colours of the vertices by joint group, or one colour for all.
function paint(actor, colour) {
  const key = [ink.version, state.colours, colour].join();
  if (actor.version === key) return;
  actor.version = key;
  const { clip } = actor;
  for (const { geometry } of [actor.capsules, ...actor.meshes]) {
    const { skinIndex, skinWeight, color } = geometry.attributes;
    const palette = clip.parents.map((_, joint) => {
      const group = clip.group ? groupColour(clip.groups[clip.group[joint]]) : ink.body;
      return new THREE.Color(colour || (state.colours ? group : ink.body));
    });
    for (let i = 0; i < color.count; i++) {
      let most = 0;
      for (let k = 1; k < 4; k++) if (skinWeight.getComponent(i, k) > skinWeight.getComponent(i, most)) most = k;
      palette[skinIndex.getComponent(i, most)].toArray(color.array, 3 * i);
    }
    color.needsUpdate = true;
  }
}

// Set the pose of a frame, and how the figure is drawn: its opacity, and a colour instead of those of groups.
export function poseActor(actor, frame, { alpha = 1, colour } = {}) {
  setPose(actor.clip, frame, actor.clip.now);
  const isMesh = actor.meshes.length > 0 && state.mesh;
  actor.capsules.visible = !isMesh;
  paint(actor, colour);
  for (const mesh of actor.meshes) {
    mesh.visible = isMesh;
    mesh.material = state.colours ? mesh.userData.tinted : mesh.userData.plain;
  }
  for (const { material } of [actor.capsules, ...actor.meshes]) {
    const own = (material.userData.own ||= { opacity: material.opacity, transparent: material.transparent });
    const opacity = alpha * own.opacity;
    if (material.opacity === opacity) continue;
    Object.assign(material, { opacity, transparent: own.transparent || opacity < 1, needsUpdate: true });
  }
}

// How much higher than its skeleton a figure is drawn, in the pose of the first view.
export function sizeOf(actor) {
  if (actor.capsules.visible) return 1;
  actor.size ||= actor.meshes.reduce((size, mesh) => {
    mesh.skeleton.update();
    mesh.computeBoundingBox();
    return Math.max(size, (mesh.boundingBox.max.y - scene.floor) / scene.height);
  }, 1);
  return Math.min(actor.size, 2);
}

export const hasMesh = () => clips.some((clip) => clip.character !== null);
