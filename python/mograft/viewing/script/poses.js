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
export function unpack(bytes, { kept, tracks, units }) {
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
  const { pose, units } = clip.data ? JSON.parse(document.getElementById(clip.data).textContent) : clip;
  const turns = 4 * clip.turning.length;
  clip.tracks = turns + 3 * clip.moving.length;
  const layout = { ...clip, units: Array.from({ length: clip.tracks }, (_, i) => units[i < turns ? 0 : 1]) };
  clip.values = unpack(await inflate(pose), layout);
  if (!clip.parents) return; // A window of donors, which has no skeleton of its own.
  clip.now = makePose(clip);
  clip.cameraPath = smooth(clip, Math.round(0.4 / (clip.dt * clip.step)));
}

export const load = (clip) => (clip.loading ||= decode(clip));

// The bones of a figure, which stand in the axes of the page below `base`.
export function makePose({ parents, offsets, turn, place }) {
  const base = new THREE.Group();
  base.quaternion.fromArray(turn);
  base.position.fromArray(place);
  const bones = parents.map(() => new THREE.Bone());
  bones.forEach((bone, joint) => {
    bone.position.fromArray(offsets, 3 * joint);
    (bones[parents[joint]] || base).add(bone);
  });
  return { base, bones };
}

// The path of the camera: a moving average of the root, without the sway of single steps.
export function smooth(clip, radius) {
  const { kept, root } = clip;
  const pose = makePose(clip);
  const line = new Set();
  for (let joint = root; joint >= 0; joint = clip.parents[joint]) line.add(joint);
  const place = new THREE.Vector3();
  const sums = new Float64Array(3 * kept + 3);
  for (let k = 0; k < kept; k++) {
    rotateBones(clip, k * clip.step, pose, (joint) => line.has(joint));
    pose.bones[root].getWorldPosition(place).toArray(sums, 3 * k + 3);
    for (let i = 3 * k; i < 3 * k + 3; i++) sums[i + 3] += sums[i];
  }
  return Float32Array.from({ length: 3 * kept }, (_, i) => {
    const k = Math.floor(i / 3);
    const reach = Math.min(radius, k, kept - 1 - k);
    return (sums[3 * (k + reach + 1) + (i % 3)] - sums[3 * (k - reach) + (i % 3)]) / (2 * reach + 1);
  });
}

// Set a rotation or position to that of a frame, interpolated between the stored frames.
function setTrack(source, at, from, target) {
  const { kept, tracks, values } = source;
  const low = Math.min(Math.floor(at), kept - 1);
  const [a, b] = [low, Math.min(low + 1, kept - 1)].map((k) => k * tracks + from);
  const mix = (i) => values[a + i] + (at - low) * (values[b + i] - values[a + i]);
  if (target.isQuaternion) target.set(mix(0), mix(1), mix(2), mix(3)).normalize();
  else target.set(mix(0), mix(1), mix(2));
}

function rotateBones(clip, frame, { bones }, isWanted = () => true) {
  const at = Math.min(frame / clip.step, clip.kept - 1);
  const turns = 4 * clip.turning.length;
  clip.turning.forEach((joint, i) => isWanted(joint) && setTrack(clip, at, 4 * i, bones[joint].quaternion));
  clip.moving.forEach((joint, i) => setTrack(clip, at, turns + 3 * i, bones[joint].position));
  if (state.preview?.clip === clip) applyDonor(state.preview, frame, bones);
}

// Set the bones to a frame, and compute their world transforms.
export function setPose(clip, frame, pose) {
  rotateBones(clip, frame, pose);
  pose.base.updateMatrixWorld(true);
  return pose;
}

// The world position of a joint, or of an end of a bone that is no joint.
export function nodePlace(clip, { bones }, node) {
  const [joint, ...offset] = clip.ends[node - bones.length] || [node, 0, 0, 0];
  return bonePlace(bones[joint], offset);
}
export const bonePlace = (bone, offset) => new THREE.Vector3(...offset).applyMatrix4(bone.matrixWorld).toArray();

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

function applyDonor({ joints, start, stop, first, last, frames: { source, shift } }, frame, bones) {
  if (frame < start || frame > stop || !source.values) return;
  const share = (frame - start) / Math.max(stop - start, 1);
  const at = (first + share * (last - first) + shift) / source.step;
  for (const joint of joints) {
    const index = source.turning.indexOf(joint);
    if (index >= 0) setTrack(source, at, 4 * index, bones[joint].quaternion);
    else bones[joint].quaternion.identity();
  }
}
