// Node positions of the figures, decoded when a figure is shown for the first time.
async function inflate(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Inverse of mograft.viewing.encoding.quantize: second differences in time, mapped to unsigned
// integers, all low bytes before all high bytes.
function unpack(bytes, path, clip) {
  const { kept, nodes, unit } = clip;
  const count = kept * nodes * 3;
  const positions = new Float32Array(count);
  for (let track = 0; track < nodes * 3; track++) {
    let value = 0;
    let step = 0;
    for (let k = 0; k < kept; k++) {
      const at = track * kept + k;
      const folded = bytes[at] | (bytes[count + at] << 8);
      step = ((step + ((folded >>> 1) ^ -(folded & 1))) << 16) >> 16;
      value = ((value + step) << 16) >> 16;
      positions[k * nodes * 3 + track] = value * unit + path[k * 3 + (track % 3)];
    }
  }
  return positions;
}

// The path of the camera: a moving average of the root, without the sway of single steps.
function smooth(path, kept, radius) {
  const out = new Float32Array(path.length);
  for (let axis = 0; axis < 3; axis++) {
    const sums = new Float64Array(kept + 1);
    for (let k = 0; k < kept; k++) sums[k + 1] = sums[k] + path[k * 3 + axis];
    for (let k = 0; k < kept; k++) {
      const reach = Math.min(radius, k, kept - 1 - k);
      out[k * 3 + axis] = (sums[k + reach + 1] - sums[k - reach]) / (2 * reach + 1);
    }
  }
  return out;
}

async function decode(clip) {
  const data = JSON.parse(document.getElementById(clip.data).textContent);
  const [pose, root] = await Promise.all([inflate(data.pose), inflate(data.path)]);
  const path = new Float32Array(root.buffer, root.byteOffset, clip.kept * 3);
  clip.cameraPath = smooth(path, clip.kept, Math.round(0.4 / (clip.dt * clip.step)));
  clip.now = new Float32Array(clip.nodes * 3);
  clip.positions = unpack(pose, path, clip);
}

export function load(clip) {
  clip.loading ||= decode(clip);
  return clip.loading;
}

// Positions of the nodes in a frame, interpolated linearly between the stored frames.
export function pose(clip, frame, out) {
  const at = Math.min(frame / clip.step, clip.kept - 1);
  const low = Math.floor(at);
  const high = Math.min(low + 1, clip.kept - 1);
  const part = at - low;
  const count = clip.nodes * 3;
  for (let i = 0; i < count; i++) {
    const a = clip.positions[low * count + i];
    out[i] = part ? a + part * (clip.positions[high * count + i] - a) : a;
  }
  return out;
}
