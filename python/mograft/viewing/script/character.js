// The skinned mesh of a character: geometry, materials and textures that the page contains.
import { inflate } from "./poses.js";
import { scene } from "./scene.js";

const TYPES = { f4: Float32Array, u2: Uint16Array, u4: Uint32Array, u1: Uint8Array };

// Decode the arrays and textures of the characters of the page.
export async function loadCharacters() {
  for (const character of scene.characters) {
    const data = character.data ? JSON.parse(document.getElementById(character.data).textContent) : character;
    character.textures = await Promise.all(data.textures.map(decodeTexture));
    for (const part of character.parts) {
      part.arrays = {};
      for (const [name, { type, width, key }] of Object.entries(part.attributes)) {
        const bytes = await inflate(data.arrays[key]);
        part.arrays[name] = new THREE.BufferAttribute(new TYPES[type](bytes.buffer, bytes.byteOffset), width);
      }
    }
  }
}

// A texture that is no image is left out.
async function decodeTexture({ type, data, wrap }) {
  try {
    const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], { type }), { colorSpaceConversion: "none" });
    const texture = new THREE.Texture(image);
    const modes = { 33071: THREE.ClampToEdgeWrapping, 33648: THREE.MirroredRepeatWrapping, 10497: THREE.RepeatWrapping };
    const [wrapS, wrapT] = wrap.map((mode) => modes[mode]);
    return Object.assign(texture, { wrapS, wrapT, flipY: false, colorSpace: THREE.SRGBColorSpace, needsUpdate: true });
  } catch {
    return null;
  }
}

function makeMaterial(own, textures) {
  return new THREE.MeshStandardMaterial({
    color: new THREE.Color(...own.color.slice(0, 3)),
    opacity: own.color[3],
    map: own.texture === null ? null : textures[own.texture],
    metalness: own.metalness,
    roughness: own.roughness,
    emissive: new THREE.Color(...own.emissive),
    side: own.isDouble ? THREE.DoubleSide : THREE.FrontSide,
    transparent: own.mode === "BLEND",
    alphaTest: own.mode === "MASK" ? own.cutoff : 0,
  });
}

// The meshes of a figure's character, bound to its bones. Rigid parts are in the axes of their joint.
export function characterMeshes(clip, bones, bind) {
  const character = scene.characters[clip.character];
  if (!character) return [];
  const inverses = character.inverses.map((values) => new THREE.Matrix4().fromArray(values));
  return character.parts.map(({ arrays, material, isRigid }) => {
    const geometry = new THREE.BufferGeometry();
    for (const [name, attribute] of Object.entries(arrays)) {
      if (name === "index") geometry.setIndex(attribute);
      else geometry.setAttribute(name, attribute);
    }
    const { count } = geometry.attributes.position;
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    if (!geometry.attributes.normal) geometry.computeVertexNormals();
    const mesh = new THREE.SkinnedMesh(geometry, makeMaterial(material, character.textures));
    mesh.userData = { isRigid, plain: mesh.material, tinted: new THREE.MeshLambertMaterial({ vertexColors: true }) };
    return bind(mesh, bones, isRigid ? undefined : inverses);
  });
}
