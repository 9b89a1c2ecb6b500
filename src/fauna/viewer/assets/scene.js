// What is drawn: the animal, its skeleton, light and ground, seen by a camera that can be moved.
import {
  AnimationMixer, Box3, CanvasTexture, Color, DirectionalLight, DoubleSide, Group, HemisphereLight, Mesh,
  MeshBasicMaterial, MeshStandardMaterial, PerspectiveCamera, PlaneGeometry, Points, PointsMaterial, BufferAttribute, BufferGeometry,
  Scene, SkeletonHelper, SRGBColorSpace, Timer, Vector3, WebGLRenderTarget,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const FIELD_OF_VIEW = 30; // degrees, vertical
const FIRST_VIEW = new Vector3(0.85, 0.38, 1); // from where the animal is seen first: in front of it, to its left, a little above
const FILLED = 0.8; // share of the window that the animal fills at first, in its tighter direction
const BONE_COLOR = 0xff7a1a;
const COVERAGE_SIZE = 64; // pixels of the small picture that tells whether anything is drawn

export class Viewer {
  constructor(renderer, gltf) {
    this.renderer = renderer;
    this.model = gltf.scene;
    this.clips = gltf.animations;
    this.scene = new Scene();
    this.mixer = new AnimationMixer(this.model);
    this.timer = new Timer();
    this.playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
    this.controls = new OrbitControls(this.camera, renderer.domElement);
    this.controls.enableDamping = true;
    this.controls.addEventListener("change", () => this.redraw());
    this.controls.addEventListener("start", () => {
      this.untouched = false;
    });
    this.meshes = [];
    this.model.traverse((node) => {
      if (!node.isMesh) return;
      node.frustumCulled = false; // bounds of the rest pose do not hold for a clip
      this.meshes.push({ node, painted: node.material, clay: clayFor(node) });
    });
    this.unpainted = this.meshes.every(({ painted }) => isPlain(painted));
    if (!this.meshes.length) throw new Error("the model has no surface");
    this.scene.add(this.model, ...lights());
    this.frame();
    this.addSkeleton();
  }

  // Put camera, controls and ground where the whole animal is seen.
  frame() {
    this.model.updateMatrixWorld(true);
    this.box = new Box3().setFromObject(this.model, true);
    this.home = this.box.getCenter(new Vector3());
    this.radius = this.box.getSize(new Vector3()).length() / 2 || 1;
    this.camera.near = this.radius / 50;
    this.camera.far = this.radius * 50;
    this.controls.minDistance = this.radius * 0.4;
    this.controls.maxDistance = this.radius * 20;
    this.scene.add(ground(this.box, this.radius));
    this.untouched = true; // until then the view follows the window
    this.resize();
    this.resetView();
  }

  resetView() {
    this.controls.target.copy(this.home);
    this.camera.position.copy(this.home).add(FIRST_VIEW);
    this.camera.lookAt(this.home);
    const slope = Math.tan((FIELD_OF_VIEW * Math.PI) / 360) * FILLED; // half the filled part of the window, at distance 1
    const toCamera = this.camera.quaternion.clone().invert();
    let distance = 0;
    for (const { node } of this.meshes) {
      for (let vertex = 0; vertex < node.geometry.attributes.position.count; vertex += 1) {
        const at = node.getVertexPosition(vertex, new Vector3()).applyMatrix4(node.matrixWorld).sub(this.home).applyQuaternion(toCamera);
        distance = Math.max(distance, at.z + Math.max(Math.abs(at.x) / this.camera.aspect, Math.abs(at.y)) / slope);
      }
    }
    this.camera.position.copy(FIRST_VIEW).setLength(distance).add(this.home);
    this.controls.update();
    this.redraw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.renderer.domElement.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.untouched) this.resetView();
    this.redraw();
  }

  addSkeleton() {
    const lines = new SkeletonHelper(this.model);
    this.hasSkeleton = lines.bones.length > 0;
    if (!this.hasSkeleton) return;
    lines.setColors(new Color(BONE_COLOR), new Color(BONE_COLOR));
    const places = new BufferAttribute(new Float32Array(3 * lines.bones.length), 3);
    const style = { color: BONE_COLOR, size: 6, sizeAttenuation: false, depthTest: false, transparent: true, toneMapped: false };
    const joints = new Points(new BufferGeometry().setAttribute("position", places), new PointsMaterial(style));
    const place = new Vector3();
    joints.onBeforeRender = () => {
      lines.bones.forEach((bone, index) => places.setXYZ(index, ...place.setFromMatrixPosition(bone.matrixWorld)));
      places.needsUpdate = true;
    };
    lines.frustumCulled = joints.frustumCulled = false;
    this.skeleton = new Group().add(lines, joints);
    this.skeleton.renderOrder = 1;
    this.skeleton.visible = false;
    this.scene.add(this.skeleton);
  }

  showSkeleton(shown) {
    this.skeleton.visible = shown;
    for (const { painted, clay } of this.meshes) {
      for (const material of [painted, clay].flat()) {
        material.transparent = shown;
        material.opacity = shown ? 0.55 : 1;
        material.needsUpdate = true;
      }
    }
    this.redraw();
  }

  showWires(shown) {
    for (const { painted, clay } of this.meshes) for (const material of [painted, clay].flat()) material.wireframe = shown;
    this.redraw();
  }

  showClay(shown) {
    for (const mesh of this.meshes) mesh.node.material = shown ? mesh.clay : mesh.painted;
    this.redraw();
  }

  // Play the clip of this number; -1 is the pose that the file stores.
  chooseClip(index) {
    this.mixer.stopAllAction();
    if (index >= 0) this.mixer.clipAction(this.clips[index]).reset().play();
    this.mixer.update(0);
    this.redraw();
  }

  redraw() {
    this.stale = true;
  }

  // One picture, when something moved.
  tick(time) {
    this.timer.update(time);
    const seconds = Math.min(this.timer.getDelta(), 0.1);
    if (this.playing && this.mixer.stats.actions.inUse > 0) {
      this.mixer.update(seconds);
      this.stale = true;
    }
    this.controls.update();
    if (!this.stale) return;
    this.stale = false;
    this.renderer.render(this.scene, this.camera);
  }

  // Share of a small picture that the animal covers.
  coverage() {
    const target = new WebGLRenderTarget(COVERAGE_SIZE, COVERAGE_SIZE);
    const alone = new Scene().add(this.model);
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.renderer.render(alone, this.camera);
    const pixels = new Uint8Array(4 * COVERAGE_SIZE ** 2);
    this.renderer.readRenderTargetPixels(target, 0, 0, COVERAGE_SIZE, COVERAGE_SIZE, pixels);
    this.renderer.setRenderTarget(null);
    this.scene.add(this.model);
    target.dispose();
    return pixels.filter((value, index) => index % 4 === 3 && value > 0).length / COVERAGE_SIZE ** 2;
  }
}

function clayFor(node) {
  if (!node.geometry.attributes.normal) node.geometry.computeVertexNormals();
  return new MeshStandardMaterial({ color: 0xb9b2a6, roughness: 0.85, metalness: 0, side: DoubleSide });
}

// A white material that was never given a colour.
function isPlain(material) {
  return !Array.isArray(material) && !material.map && !material.vertexColors && material.color?.getHex() === 0xffffff;
}

function lights() {
  const key = new DirectionalLight(0xfff4e6, 1.8);
  key.position.set(1.5, 3, 2);
  const rim = new DirectionalLight(0xdfe9ff, 0.9);
  rim.position.set(-2, 1.5, -2);
  return [new HemisphereLight(0xffffff, 0xa39c90, 2.0), key, rim];
}

// A soft dark spot under the feet; cheaper than a shadow and still right when the animal walks on the spot.
function ground(box, radius) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 128;
  const context = canvas.getContext("2d");
  const fade = context.createRadialGradient(64, 64, 4, 64, 64, 64);
  fade.addColorStop(0, "rgba(20, 28, 24, 0.42)");
  fade.addColorStop(0.6, "rgba(20, 28, 24, 0.16)");
  fade.addColorStop(1, "rgba(20, 28, 24, 0)");
  context.fillStyle = fade;
  context.fillRect(0, 0, 128, 128);
  const map = new CanvasTexture(canvas);
  map.colorSpace = SRGBColorSpace;
  const material = new MeshBasicMaterial({ map, transparent: true, depthWrite: false, toneMapped: false });
  const spot = new Mesh(new PlaneGeometry(1, 1), material);
  const size = box.getSize(new Vector3());
  spot.rotation.x = -Math.PI / 2;
  spot.scale.set(1.3 * size.x + 0.5 * radius, 1.3 * size.z + 0.3 * radius, 1);
  box.getCenter(spot.position).setY(box.min.y);
  return spot;
}
