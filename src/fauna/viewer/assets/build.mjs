// Bundles viewer.js and the parts of three.js it uses into viewer.min.js. See README.md.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { build } from "esbuild";

const { devDependencies } = JSON.parse(readFileSync("package.json"));
const digest = createHash("sha256").update(readFileSync("viewer.js")).digest("hex");
await build({
  entryPoints: ["viewer.js"],
  outfile: "viewer.min.js",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none",
  banner: { js: `/* three.js ${devDependencies.three}, MIT, (c) three.js authors; viewer.js sha256 ${digest} */` },
});
