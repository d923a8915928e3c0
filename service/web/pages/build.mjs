// Bundles the scripts of the pages into ../static, with the licences of all that goes into them.
import { createHash } from "node:crypto";
import { copyFileSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const out = "../static";
const hash = createHash("sha256");
for (const name of readdirSync("src").sort()) hash.update(name).update("\0").update(readFileSync(`src/${name}`)).update("\0");
const banner = { js: `/* Tieline pages, made of sources ${hash.digest("hex")}; licences: LICENCES.txt */` };
const common = { banner, bundle: true, minify: true, format: "iife", target: "es2022", legalComments: "none", metafile: true };
const results = [
  await build({ ...common, entryPoints: ["src/pages.js"], outfile: `${out}/pages.js` }),
  await build({ ...common, entryPoints: ["src/docs.js"], outfile: `${out}/docs.js` }),
];
copyFileSync("node_modules/swagger-ui-dist/swagger-ui.css", `${out}/swagger-ui.css`);
const style = readFileSync(`${out}/swagger-ui.css`, "utf8").replace(/\n?\/\*# sourceMappingURL=.*?\*\//, "");
writeFileSync(`${out}/swagger-ui.css`, style);

const packages = new Set(["swagger-ui-dist"]);
for (const { metafile } of results)
  for (const input of Object.keys(metafile.inputs)) {
    const found = input.match(/.*node_modules\/((?:@[^/]+\/)?[^/]+)/);
    if (found) packages.add(found[1]);
  }
const parts = [...packages].sort().map((name) => {
  const folder = `node_modules/${name}`;
  const about = JSON.parse(readFileSync(`${folder}/package.json`, "utf8"));
  const files = readdirSync(folder).filter((file) => /^(licen[cs]e|notice|.*\.LICENSE\.txt)/i.test(file) || file === "swagger-ui-bundle.js.LICENSE.txt");
  const texts = files.map((file) => readFileSync(`${folder}/${file}`, "utf8").trim());
  return [`${name} ${about.version} (${about.license})`, ...(texts.length ? texts : ["(its package has no file with the licence's text)"])].join("\n\n");
});
writeFileSync(`${out}/LICENCES.txt`, `What pages.js, docs.js and swagger-ui.css are made of.\n\n${parts.join(`\n\n${"-".repeat(80)}\n\n`)}\n`);
