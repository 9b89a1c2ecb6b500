// What can be pressed: the buttons and keys of the page.
const TURN = Math.PI / 24; // of an arrow key

export const part = (id) => document.getElementById(id);

// The bytes of the GLB that the page carries.
export function carriedBytes() {
  const text = atob(part("glb").textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let place = 0; place < text.length; place += 1) bytes[place] = text.charCodeAt(place);
  return bytes;
}

// "Armature|Walk" as some programs write it: what comes last.
function shortName(name) {
  return name.split("|").pop();
}

// Connect them with what is drawn.
export function connect(viewer) {
  const picker = part("clip");
  viewer.clips.forEach((clip, index) => picker.add(new Option(shortName(clip.name) || `clip ${index + 1}`, String(index))));
  const walk = viewer.clips.findIndex((clip) => /walk/i.test(clip.name));
  picker.value = String(viewer.clips.length ? Math.max(walk, 0) : -1);
  picker.addEventListener("change", () => viewer.chooseClip(Number(picker.value)));
  viewer.chooseClip(Number(picker.value));
  for (const id of ["clip-group", "play", "speed-group"]) part(id).hidden = viewer.clips.length === 0;
  part("skeleton").hidden = !viewer.hasSkeleton;

  const speed = part("speed");
  speed.addEventListener("input", () => {
    viewer.mixer.timeScale = Number(speed.value);
    part("speed-value").textContent = `${Number(speed.value)}×`;
  });
  const play = part("play");
  const showPlaying = () => {
    play.textContent = viewer.playing ? "Pause" : "Play";
  };
  showPlaying();
  play.addEventListener("click", () => {
    viewer.playing = !viewer.playing;
    showPlaying();
  });
  toggle("skeleton", (on) => viewer.showSkeleton(on));
  toggle("wires", (on) => viewer.showWires(on));
  toggle("clay", (on) => viewer.showClay(on));
  if (viewer.unpainted) part("clay").click();
  part("reset").addEventListener("click", () => viewer.resetView());
  part("save").addEventListener("click", () => save());
  const facts = part("facts");
  if (facts && innerWidth < 900) facts.open = false;
  listen(viewer);
  open(picker);
}

// What the address asks for: "#clip=trot,skeleton,paused" chooses a clip, presses a button and starts paused.
function open(picker) {
  for (const word of decodeURIComponent(location.hash.slice(1)).split(",")) {
    const [name, clip] = word.split("=");
    const wanted = [...picker.options].find((option) => option.text === clip);
    if (name === "clip" && wanted) {
      picker.value = wanted.value;
      picker.dispatchEvent(new Event("change"));
    } else if (["skeleton", "wires", "clay"].includes(name)) part(name).click();
    else if (name === "paused" && part("play").textContent === "Pause") part("play").click();
  }
}

function toggle(id, act) {
  const button = part(id);
  button.addEventListener("click", () => {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    act(on);
  });
}

function listen(viewer) {
  const presses = { " ": "play", s: "skeleton", w: "wires", t: "clay", r: "reset" };
  const moves = {
    ArrowLeft: () => viewer.controls.rotateLeft(TURN),
    ArrowRight: () => viewer.controls.rotateLeft(-TURN),
    ArrowUp: () => viewer.controls.rotateUp(TURN),
    ArrowDown: () => viewer.controls.rotateUp(-TURN),
    "+": () => viewer.controls.dollyIn(1.15),
    "=": () => viewer.controls.dollyIn(1.15),
    "-": () => viewer.controls.dollyOut(1.15),
  };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (/^(BUTTON|SELECT|INPUT|SUMMARY|A)$/.test(event.target.tagName) && !/^[a-z]$/.test(event.key)) return;
    if (event.target.tagName === "SELECT") return; // letters choose a clip there
    const button = presses[event.key] && part(presses[event.key]);
    if (button && !button.hidden) button.click();
    else if (moves[event.key]) moves[event.key]();
    else return;
    event.preventDefault();
  });
  new ResizeObserver(() => viewer.resize()).observe(viewer.renderer.domElement.parentElement);
}

function save() {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([carriedBytes()], { type: "model/gltf-binary" }));
  link.download = `${document.title.replace(/[^\p{L}\p{N}_-]+/gu, "_") || "model"}.glb`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
