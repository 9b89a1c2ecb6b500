// The script of the viewer page: shows the GLB that the page carries. viewer.min.js is made of it, see README.md.
import { NeutralToneMapping, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { carriedBytes, connect, part } from "./controls.js";
import { Viewer } from "./scene.js";

const page = document.documentElement;

function fail(reason) {
  page.dataset.status = "failed";
  part("missing").hidden = false;
  part("missing-reason").textContent = reason;
  part("controls").hidden = true;
  part("canvas").hidden = true;
  part("facts")?.removeAttribute("open");
}

async function start() {
  let renderer;
  try {
    renderer = new WebGLRenderer({ canvas: part("canvas"), antialias: true, alpha: true });
  } catch {
    fail("This browser cannot draw in 3D here: WebGL is switched off or missing.");
    return;
  }
  renderer.toneMapping = NeutralToneMapping; // keeps the colours of the texture
  try {
    const viewer = new Viewer(renderer, await new GLTFLoader().parseAsync(carriedBytes().buffer, ""));
    connect(viewer);
    viewer.tick(performance.now());
    page.dataset.coverage = viewer.coverage().toFixed(3);
    viewer.redraw();
    renderer.setAnimationLoop((time) => viewer.tick(time));
    page.dataset.status = "ready";
  } catch (error) {
    fail(`The model in this page cannot be read (${error.message}).`);
  }
}

start();
