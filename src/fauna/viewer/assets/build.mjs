// Bundles viewer.js, what it imports, the parts of three.js it uses into viewer.min.js. See README.md.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { build } from "esbuild";

const { devDependencies } = JSON.parse(readFileSync("package.json"));
const sources = ["controls.js", "scene.js", "viewer.js"].map((name) => readFileSync(name));
const digest = createHash("sha256").update(Buffer.concat(sources)).digest("hex");
await build({
  entryPoints: ["viewer.js"],
  outfile: "viewer.min.js",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none",
  banner: { js: `/* three.js ${devDependencies.three}, MIT, (c) three.js authors; our sources sha256 ${digest} */` },
});
