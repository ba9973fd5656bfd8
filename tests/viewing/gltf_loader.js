// Play a clip of a GLB by the loader of three.js; return the matrix of each joint from the axes of
// the mesh to the world, at some times.
import * as T from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

window.play = async (text, name, times) => {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const gltf = await new Promise((done, fail) => new GLTFLoader().parse(bytes.buffer, "", done, fail));
  const clip = gltf.animations.find((own) => own.name === name);
  const mixer = new T.AnimationMixer(gltf.scene);
  mixer.clipAction(clip).play();
  let mesh = null;
  gltf.scene.traverse((node) => (mesh ||= node.isSkinnedMesh ? node : null));
  return times.map((time) => {
    mixer.setTime(Math.min(time, clip.duration * 0.999999));
    gltf.scene.updateMatrixWorld(true);
    mesh.skeleton.update();
    const { bones, boneMatrices } = mesh.skeleton;
    const rows = bones.map((bone, i) => [bone.userData.name || bone.name, Array.from(boneMatrices.slice(16 * i, 16 * i + 16))]);
    return Object.fromEntries(rows);
  });
};
