// node validate.js FOLDER_OF_NODE_MODULES FILE... : one JSON line per file, what gltf-validator finds.
const fs = require("fs");
const { createRequire } = require("module");
const [modules, ...files] = process.argv.slice(2);
const validator = createRequire(require("path").join(require("path").resolve(modules), "x.js"))("gltf-validator");

(async () => {
  for (const file of files) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), { maxIssues: 20 });
    const { numErrors, numWarnings, numInfos, numHints, messages } = report.issues;
    console.log(JSON.stringify({ file, numErrors, numWarnings, numInfos, numHints, messages }));
  }
})();
