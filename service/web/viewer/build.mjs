// Bundle the viewer: `npm ci --ignore-scripts && node build.mjs`. The bundle names the sources that it was made of.

import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const out = "../static";
const sources = readdirSync(".").filter((name) => name.endsWith(".js")).sort();
const hash = createHash("sha256");
for (const name of [...sources, "viewer.css"]) hash.update(name).update("\0").update(readFileSync(name)).update("\0");

await build({
  entryPoints: ["main.js"],
  outfile: `${out}/viewer.js`,
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  legalComments: "none", // the whole texts stand in viewer.LICENSES.txt
  banner: { js: `/* Tieline viewer, made of sources ${hash.digest("hex")}; licences: viewer.LICENSES.txt */` },
});
await build({ entryPoints: ["viewer.css"], outfile: `${out}/viewer.css`, minify: true });

const three = JSON.parse(readFileSync("node_modules/three/package.json"));
writeFileSync(
  `${out}/viewer.LICENSES.txt`,
  `viewer.js contains three.js ${three.version} (https://threejs.org), under this licence:\n\n${readFileSync("node_modules/three/LICENSE", "utf8")}`,
);
