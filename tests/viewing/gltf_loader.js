// Play a clip of a GLB by the loader of three.js, beside the page of mograft.
import * as T from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

async function open(text, name) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const gltf = await new Promise((done, fail) => new GLTFLoader().parse(bytes.buffer, "", done, fail));
  const clip = gltf.animations.find((own) => own.name === name);
  const mixer = new T.AnimationMixer(gltf.scene);
  mixer.clipAction(clip).play();
  const seek = (time) => {
    mixer.setTime(Math.min(time, clip.duration * 0.999999));
    gltf.scene.updateMatrixWorld(true);
  };
  return { root: gltf.scene, seek };
}

// The matrix of each joint from the axes of the mesh to the world, at some times.
window.play = async (text, name, times) => {
  const { root, seek } = await open(text, name);
  let mesh = null;
  root.traverse((node) => (mesh ||= node.isSkinnedMesh ? node : null));
  return times.map((time) => {
    seek(time);
    mesh.skeleton.update();
    const { bones, boneMatrices } = mesh.skeleton;
    const rows = bones.map((bone, i) => [bone.userData.name || bone.name, Array.from(boneMatrices.slice(16 * i, 16 * i + 16))]);
    return Object.fromEntries(rows);
  });
};

// Draw the character at times as cameras of the page see it: on a canvas that fills the window.
window.draw = async (text, name) => {
  const { root, seek } = await open(text, name);
  const renderer = new T.WebGLRenderer({ antialias: true, alpha: true });
  renderer.setSize(window.innerWidth, window.innerHeight);
  document.body.replaceChildren(renderer.domElement);
  document.body.style.margin = 0;
  const world = new T.Scene();
  const sun = new T.DirectionalLight(0xffffff, 2.3);
  world.add(root, new T.HemisphereLight(0xffffff, 0x8a8f98, 1.9), sun, sun.target);
  const camera = new T.PerspectiveCamera();
  camera.matrixAutoUpdate = camera.matrixWorldAutoUpdate = false;
  window.show = (time, { projection, place, light, paper }) => {
    document.body.style.background = paper;
    seek(time);
    camera.projectionMatrix.fromArray(projection);
    camera.matrixWorld.fromArray(place);
    camera.matrixWorldInverse.copy(camera.matrixWorld).invert();
    sun.position.fromArray(light[0]);
    sun.target.position.fromArray(light[1]);
    renderer.render(world, camera);
  };
};
