// Joint rotations of the figures, decoded when a figure is shown for the first time, and their
// world poses.
import { clips, scene, state } from "./scene.js";

export async function inflate(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Inverse of mograft.viewing.encoding.quantize: second differences in time, mapped to unsigned
// integers of 24 bits; all low bytes before all middle bytes before all high bytes.
function unpack(bytes, { kept, tracks, units }) {
  const count = kept * tracks;
  const values = new Float32Array(count);
  for (let track = 0; track < tracks; track++) {
    const unit = units[track];
    let value = 0;
    let step = 0;
    for (let k = 0; k < kept; k++) {
      const at = track * kept + k;
      const folded = bytes[at] | (bytes[count + at] << 8) | (bytes[2 * count + at] << 16);
      step = ((step + ((folded >>> 1) ^ -(folded & 1))) << 8) >> 8;
      value = ((value + step) << 8) >> 8;
      values[k * tracks + track] = value * unit;
    }
  }
  return values;
}

async function decode(clip) {
  const { pose, units } = JSON.parse(document.getElementById(clip.data).textContent);
  const turns = 4 * clip.turning.length;
  clip.tracks = turns + 3 * clip.moving.length;
  const layout = { ...clip, units: Array.from({ length: clip.tracks }, (_, i) => units[i < turns ? 0 : 1]) };
  clip.values = unpack(await inflate(pose), layout);
  if (!clip.parents) return; // A window of donors, which has no skeleton of its own.
  clip.now = makePose(clip);
  clip.cameraPath = smooth(clip, Math.round(0.4 / (clip.dt * clip.step)));
}

export function load(clip) {
  clip.loading ||= decode(clip);
  return clip.loading;
}

// World rotations and positions of the joints, four and three numbers each.
export function makePose({ parents, offsets }) {
  const turns = new Float32Array(4 * parents.length);
  for (let i = 3; i < turns.length; i += 4) turns[i] = 1;
  return { local: turns, offsets: Float32Array.from(offsets), turns: turns.slice(), places: new Float32Array(offsets.length) };
}

// The path of the camera: a moving average of the root, without the sway of single steps.
function smooth(clip, radius) {
  const { kept, parents, root } = clip;
  const line = [];
  for (let joint = root; joint >= 0; joint = parents[joint]) line.unshift(joint);
  const pose = makePose(clip);
  const sums = new Float64Array(3 * kept + 3);
  for (let k = 0; k < kept; k++) {
    setPose(clip, k * clip.step, pose, line);
    for (let axis = 0; axis < 3; axis++) sums[3 * k + 3 + axis] = sums[3 * k + axis] + pose.places[3 * root + axis];
  }
  return Float32Array.from({ length: 3 * kept }, (_, i) => {
    const k = Math.floor(i / 3);
    const reach = Math.min(radius, k, kept - 1 - k);
    return (sums[3 * (k + reach + 1) + (i % 3)] - sums[3 * (k - reach) + (i % 3)]) / (2 * reach + 1);
  });
}

// Copy values of a frame, interpolated between the stored frames; rotations are normalized.
function copyTrack(source, at, from, width, out, to) {
  const low = Math.min(Math.floor(at), source.kept - 1);
  const high = Math.min(low + 1, source.kept - 1);
  const part = at - low;
  let square = 0;
  for (let i = 0; i < width; i++) {
    const a = source.values[low * source.tracks + from + i];
    const value = a + part * (source.values[high * source.tracks + from + i] - a);
    out[to + i] = value;
    square += value * value;
  }
  if (width === 4) for (let i = 0; i < 4; i++) out[to + i] /= Math.sqrt(square);
}

// out = a * b for quaternions at offsets of arrays, and the rotation of a vector.
function multiply(a, i, b, k, out, to) {
  const [ax, ay, az, aw] = [a[i], a[i + 1], a[i + 2], a[i + 3]];
  const [bx, by, bz, bw] = [b[k], b[k + 1], b[k + 2], b[k + 3]];
  out[to] = aw * bx + ax * bw + ay * bz - az * by;
  out[to + 1] = aw * by - ax * bz + ay * bw + az * bx;
  out[to + 2] = aw * bz + ax * by - ay * bx + az * bw;
  out[to + 3] = aw * bw - ax * bx - ay * by - az * bz;
}
export function rotate(turns, i, [x, y, z]) {
  const [qx, qy, qz, qw] = [turns[i], turns[i + 1], turns[i + 2], turns[i + 3]];
  const [tx, ty, tz] = [2 * (qy * z - qz * y), 2 * (qz * x - qx * z), 2 * (qx * y - qy * x)];
  return [x + qw * tx + qy * tz - qz * ty, y + qw * ty + qz * tx - qx * tz, z + qw * tz + qx * ty - qy * tx];
}

// Compute the world pose of a frame, of all joints or of a list that contains their ancestors.
export function setPose(clip, frame, pose, joints = clip.parents.keys()) {
  const at = Math.min(frame / clip.step, clip.kept - 1);
  clip.turning.forEach((joint, i) => copyTrack(clip, at, 4 * i, 4, pose.local, 4 * joint));
  const first = 4 * clip.turning.length;
  clip.moving.forEach((joint, i) => copyTrack(clip, at, first + 3 * i, 3, pose.offsets, 3 * joint));
  if (state.preview?.clip === clip) applyDonor(state.preview, frame, pose);
  const { turns, places, local, offsets } = pose;
  for (const joint of joints) {
    const parent = clip.parents[joint];
    const [above, index] = parent < 0 ? [clip.turn, 0] : [turns, 4 * parent];
    multiply(above, index, local, 4 * joint, turns, 4 * joint);
    const moved = rotate(above, index, offsets.subarray(3 * joint, 3 * joint + 3));
    for (let i = 0; i < 3; i++) places[3 * joint + i] = moved[i] + (parent < 0 ? clip.place[i] : places[3 * parent + i]);
  }
  return pose;
}

export function nodePlace(clip, pose, node) {
  const n = clip.parents.length;
  if (node < n) return Array.from(pose.places.subarray(3 * node, 3 * node + 3));
  const [joint, ...offset] = clip.ends[node - n];
  return rotate(pose.turns, 4 * joint, offset).map((value, i) => value + pose.places[3 * joint + i]);
}

// Frames of a donor: those of a figure of the page, or a window of frames; null without any.
export function donorFrames(name, from, to) {
  const clip = clips.find((own) => own.name === name && !own.isGraft);
  if (clip) return { source: clip, shift: 0 };
  const source = scene.windows[name];
  const index = source ? source.start.findIndex((start, i) => start <= from && to <= source.stop[i]) : -1;
  if (index < 0) return null;
  let shift = -source.start[index];
  for (let i = 0; i < index; i++) shift += source.stop[i] - source.start[i] + 1;
  return { source, shift };
}

function applyDonor({ joints, start, stop, first, last, frames: { source, shift } }, frame, pose) {
  if (frame < start || frame > stop || !source.values) return;
  const share = (frame - start) / Math.max(stop - start, 1);
  const at = (first + share * (last - first) + shift) / source.step;
  for (const joint of joints) {
    const index = source.turning.indexOf(joint);
    if (index >= 0) copyTrack(source, at, 4 * index, 4, pose.local, 4 * joint);
    else pose.local.set([0, 0, 0, 1], 4 * joint);
  }
}
