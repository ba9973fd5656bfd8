// Constraints as records: their names, their fields, and new ones near a figure.
import { nodePlace } from "/viewer/poses.js";
import { poseNow } from "./player.js";
import { range } from "./ui.js";

const SHAPES = { Sphere: "Sphere", Box: "Box", Capsule: "Capsule", HalfSpace: "Wall", Character: "Character" };

export const obstacleOf = (record) => record.obstacle || record.region || null;

export function nameOf(record) {
  const obstacle = obstacleOf(record);
  if (record.kind === "Avoid") return SHAPES[obstacle?.kind] || "Obstacle";
  if (record.kind === "KeepOut") return `${record.joint} ${record.inside ? "inside" : "outside"} ${(SHAPES[obstacle?.kind] || "region").toLowerCase()}`;
  if (record.kind === "Reach") return `${record.joint} to target`;
  if (record.kind === "Face") return `${record.joint || "Head"} looks at`;
  if (record.kind === "AvoidSelf") return "Own body";
  const where = record.group ? `${record.group}: ` : "";
  if (record.kind === "KeepOriginal") return `${where}captured`;
  if (record.kind === "Use" || record.kind === "Ban") {
    const [clip, from, to] = [record.donor].flat();
    return `${where}${record.kind === "Ban" ? "not " : ""}${clip}${from === undefined ? "" : ` ${range(from, to)}`}`;
  }
  return record.kind;
}

export const framesText = ({ frames }) => (frames ? `frames ${range(...frames)}` : "all frames");

// The fields of each kind: name in the record, text, kind of the field, unit.
export const FIELDS = {
  Sphere: [["center", "centre", "vector"], ["radius", "radius", "length"]],
  Box: [["center", "centre", "vector"], ["half", "half size", "sizes"], ["rotation", "yaw", "yaw"]],
  Capsule: [["start", "start", "vector"], ["stop", "end", "vector"], ["radius", "radius", "length"]],
  HalfSpace: [["point", "point", "vector"], ["normal", "free side", "vector"]],
  Character: [["offset", "place", "vector"], ["yaw", "yaw", "angle"], ["delay", "delay", "seconds"]],
  Reach: [["joint", "joint", "joint"], ["target", "target", "vector"], ["tolerance", "within", "heights"]],
  Face: [["joint", "joint", "joint?"], ["target", "target", "vector"], ["tolerance", "within", "angle"]],
  KeepOut: [["joint", "joint", "joint"], ["inside", "stay inside", "flag"]],
  Avoid: [["margin", "margin", "heights"]],
  AvoidSelf: [["tolerance", "tolerance", "heights"]],
};

export const DEFAULTS = { tolerance: 0.03, margin: 0, inside: false, yaw: 0, delay: 0, rotation: [0, 0, 0, 1], joint: "" };

const round = (value) => Number(value.toPrecision(6));
const numbers = (vector) => vector.toArray().map(round);

// From the axes of the file to those of the page, and back.
export const toFile = (vector, clip) => vector.applyQuaternion(new THREE.Quaternion(...clip.turn).invert());
export const upOf = (clip) => toFile(new THREE.Vector3(0, 1, 0), clip);

// A place at the figure: a share of its height above the floor, and ahead of it or beside it in heights.
function near(clip, high, ahead, beside = 0) {
  const [x, , z] = nodePlace(clip, poseNow(clip), clip.root);
  const tall = clip.height;
  return toFile(new THREE.Vector3(x + beside * tall, clip.floor + high * tall, z + ahead * tall), clip);
}

// A joint whose name has one of some parts, or the last one.
export function findJoint(joints, words) {
  const lower = joints.map((name) => name.toLowerCase());
  for (const word of words) {
    const index = lower.findIndex((name) => name.includes(word));
    if (index >= 0) return joints[index];
  }
  return joints.at(-1);
}

// New records: [name of the button, what it makes].
export const NEW = {
  Sphere: (clip) => ({ kind: "Avoid", obstacle: { kind: "Sphere", center: numbers(near(clip, 0.65, 0.35)), radius: round(0.12 * clip.height) } }),
  Box: (clip) => ({ kind: "Avoid", obstacle: { kind: "Box", center: numbers(near(clip, 0.3, 0.5)), half: [0.15, 0.15, 0.15].map((share) => round(share * clip.height)), rotation: [0, 0, 0, 1] } }),
  Capsule: (clip) => ({ kind: "Avoid", obstacle: { kind: "Capsule", start: numbers(near(clip, 0.1, 0.4, 0.2)), stop: numbers(near(clip, 1, 0.4, 0.2)), radius: round(0.06 * clip.height) } }),
  Wall: (clip) => ({ kind: "Avoid", obstacle: { kind: "HalfSpace", point: numbers(near(clip, 0.5, 0.6)), normal: numbers(toFile(new THREE.Vector3(0, 0, -1), clip)) } }),
  Character: (clip, { clipName }) => ({ kind: "Avoid", obstacle: { kind: "Character", motion: { name: clipName }, offset: numbers(toFile(new THREE.Vector3(0.8 * clip.height, 0, 0), clip)), yaw: 0, delay: 0, radius: 1 } }),
  "Hand or foot target": (clip, { joints, frame }) => ({ kind: "Reach", joint: findJoint(joints, ["righthand", "hand_r", "r_hand", "hand", "wrist"]), target: numbers(near(clip, 0.7, 0.25)), frames: [frame, frame] }),
  "Gaze target": (clip, { frames }) => ({ kind: "Face", target: numbers(near(clip, 0.9, 1)), frames }),
  "Region of a joint": (clip, { joints }) => ({ kind: "KeepOut", joint: findJoint(joints, ["lefthand", "hand_l", "hand", "wrist"]), region: { kind: "Sphere", center: numbers(near(clip, 0.5, 0.2)), radius: round(0.15 * clip.height) } }),
  "Own body": () => ({ kind: "AvoidSelf" }),
};
