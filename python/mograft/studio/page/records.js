// Constraints as records: their names, their fields, and new ones near a figure.
import { nodePlace } from "/viewer/poses.js";
import { poseNow } from "./player.js";
import { range } from "./ui.js";

const SHAPES = { Sphere: "Sphere", Box: "Box", Capsule: "Capsule", HalfSpace: "Wall", Character: "Other character" };

export const obstacleOf = (record) => record.obstacle || record.region || null;

export function nameOf(record) {
  const obstacle = obstacleOf(record);
  if (record.kind === "Avoid") return SHAPES[obstacle?.kind] || "Obstacle";
  if (record.kind === "KeepOut")
    return `${record.joint} stays ${record.inside ? "in" : "out of"} the ${(SHAPES[obstacle?.kind] || "region").toLowerCase()}`;
  if (record.kind === "Reach") return `${record.joint} reaches the target`;
  if (record.kind === "Face") return `${record.joint || "Head"} faces the target`;
  if (record.kind === "AvoidSelf") return "No limb through the body";
  const who = record.group || "all groups";
  if (record.kind === "KeepOriginal") return `${who}: captured motion stays`;
  if (record.kind === "Use" || record.kind === "Ban") {
    const [clip, from, to] = [record.donor].flat();
    const verb = record.kind === "Ban" ? "banned part" : "chosen part";
    return `${who}: ${verb} ${clip ?? ""}${from === undefined ? "" : ` ${range(from, to)}`}`;
  }
  return record.kind;
}

// The name of a constraint of a motion, numbered if others have the same one.
export function titleOf({ constraints }, number) {
  const names = constraints.map(({ record }) => nameOf(record));
  const index = constraints.findIndex((own) => own.number === number);
  const count = (list) => list.filter((name) => name === names[index]).length;
  return count(names) > 1 ? `${names[index]} ${count(names.slice(0, index + 1))}` : (names[index] ?? "Constraint");
}

// A violation as people read it, and the frame of its largest error.
const ofHeight = (share) => `${(100 * share).toFixed(1)} % of the body height`;
export const violationText = ({ text }) =>
  text
    .replace(/^\w+ is v/, "V")
    .replace(/(\d+) to (\d+)/, "$1–$2")
    .replace(/ by (.+): penetration depth/, ": $1 is in it by")
    .replace(/self-collision (\S+) heights/, "limbs are in each other by $1 heights")
    .replace(/([\d.]+) heights(?: \([^)]*\))?/, (_, share) => ofHeight(share))
    .replace(/, tolerance ([\d.]+)(°?)/, (_, limit, sign) => `; allowed: ${sign ? `${limit}°` : ofHeight(limit)}`);
export const worstOf = ({ first, text }) => Number(/worst at (\d+)/.exec(text)?.[1] ?? first);
export const countViolated = ({ violations }) => new Set(violations.map(({ number }) => number)).size;

export const framesText = ({ frames }) => (frames ? `${frames[0] === frames[1] ? "frame" : "frames"} ${range(...frames)}` : "all frames");

// The fields of each kind: name in the record, kind of the field, and another name for people.
const TEXTS = {
  Sphere: "center vector centre, radius length",
  Box: "center vector centre, half sizes half size, rotation yaw turn",
  Capsule: "start vector, stop vector end, radius length",
  HalfSpace: "point vector, normal vector open side",
  Character: "motion clip clip, offset vector place, yaw angle turn, delay seconds",
  Reach: "joint joint, target vector, tolerance heights accept within",
  Face: "joint joint?, target vector, tolerance angle accept within",
  KeepOut: "joint joint, inside flag stay inside",
  Avoid: "margin heights keep away by",
  AvoidSelf: "tolerance heights allowed depth",
};
const fieldOf = (text) => {
  const [name, kind, ...words] = text.split(" ");
  return [name, words.join(" ") || name, kind];
};
export const FIELDS = Object.fromEntries(Object.entries(TEXTS).map(([kind, text]) => [kind, text.split(", ").map(fieldOf)]));

export const DEFAULTS = { tolerance: 0.03, margin: 0, inside: false, yaw: 0, delay: 0, rotation: [0, 0, 0, 1], joint: "" };

const round = (value) => Number(value.toPrecision(6));
const numbers = (vector) => vector.toArray().map(round);

// From the axes of the file to those of the page, and back.
export const toFile = (vector, clip) => vector.applyQuaternion(new THREE.Quaternion(...clip.turn).invert());
export const upOf = (clip) => toFile(new THREE.Vector3(0, 1, 0), clip);

// A joint whose name has one of some parts, or the last one.
export function findJoint(joints, words) {
  const lower = joints.map((name) => name.toLowerCase());
  for (const word of words) {
    const index = lower.findIndex((name) => name.includes(word));
    if (index >= 0) return joints[index];
  }
  return joints.at(-1);
}

const avoid = (obstacle) => ({ kind: "Avoid", obstacle });

// New records, by the names of what they add; see `newRecord` for what they are made of.
export const NEW = {
  "Sphere to avoid": ({ near, long }) => avoid({ kind: "Sphere", center: near(0.65, 0.35), radius: long(0.12) }),
  "Box to avoid": ({ near, long }) =>
    avoid({ kind: "Box", center: near(0.3, 0.5), half: Array(3).fill(long(0.15)), rotation: [0, 0, 0, 1] }),
  "Capsule to avoid": ({ near, long }) =>
    avoid({ kind: "Capsule", start: near(0.1, 0.4, 0.2), stop: near(1, 0.4, 0.2), radius: long(0.06) }),
  "Wall to avoid": ({ near, along, aside }) => avoid({ kind: "HalfSpace", point: near(0.5, 0.6 + aside), normal: along(0, 0, -1) }),
  "Other character to avoid": ({ along, tall, aside, clipName: name }) =>
    avoid({ kind: "Character", motion: { name }, offset: along((0.8 + aside) * tall, 0, 0), yaw: 0, delay: 0, radius: 1 }),
  "Hand or foot reaches a target": ({ near, hand, frame }) =>
    ({ kind: "Reach", joint: hand, target: near(0.7, 0.25), frames: [frame, frame] }),
  "Head faces a target": ({ near, frames }) => ({ kind: "Face", target: near(0.9, 1), frames }),
  "Joint stays out of a region": ({ near, long, hand }) =>
    ({ kind: "KeepOut", joint: hand, region: { kind: "Sphere", center: near(0.5, 0.2), radius: long(0.15) } }),
  "No limb through the body": () => ({ kind: "AvoidSelf" }),
};

const placeOf = (record, own = obstacleOf(record) || record) => own.center || own.start || own.point || own.offset || own.target;

// A new record at a figure, beside those that are there.
export function newRecord(name, clip, known, given) {
  for (let aside = 0; ; aside += 0.3) {
    const made = recordAt(name, clip, { ...given, aside });
    const isFar = (place) => Math.hypot(...placeOf(made).map((value, i) => value - place[i])) > 0.1 * clip.height;
    if (!placeOf(made) || known.every(({ record }) => !Array.isArray(placeOf(record)) || isFar(placeOf(record)))) return made;
  }
}

// `near` is a place: a share of the height above the floor, ahead and beside.
function recordAt(name, clip, { joints, frame, frames, clipName, aside }) {
  const tall = clip.height;
  const [x, , z] = nodePlace(clip, poseNow(clip), clip.root);
  const along = (...vector) => numbers(toFile(new THREE.Vector3(...vector), clip));
  const near = (high, ahead, beside = 0) => along(x + (beside + aside) * tall, clip.floor + high * tall, z + ahead * tall);
  const hand = findJoint(joints, ["righthand", "hand_r", "hand.r", "hand", "wrist"]);
  const made = NEW[name]({ near, along, long: (share) => round(share * tall), tall, aside, hand, frame, frames, clipName });
  return frames && !made.frames ? { ...made, frames } : made;
}
