// Builds ../assets: `npm ci && npm run build`. Reproducible: `.ci/web` compares the bytes.
import { cp, mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import { build } from "esbuild";

const SOURCES = new URL("src/", import.meta.url).pathname;
const ASSETS = new URL("../assets/", import.meta.url).pathname;
const PAGES = (await readdir(SOURCES)).filter((name) => name.endsWith(".html")).map((name) => name.slice(0, -5));

await rm(ASSETS, { recursive: true, force: true });
await mkdir(ASSETS);
const { metafile } = await build({
  entryPoints: PAGES.flatMap((page) => [`${SOURCES}${page}.js`, `${SOURCES}${page}.css`]),
  outdir: ASSETS, bundle: true, minify: true, format: "esm", target: ["es2022"], charset: "utf8", legalComments: "none", metafile: true,
});
for (const file of [...PAGES.map((page) => `${page}.html`), "icon.svg"]) await cp(SOURCES + file, ASSETS + file);
await writeFile(`${ASSETS}LIBRARIES.md`, await libraries(Object.keys(metafile.inputs)));

// Licence, version and origin of each package with code in the bundles.
async function libraries(inputs) {
  const names = [...new Set(inputs.map((path) => path.match(/node_modules\/((?:@[^/]+\/)?[^/]+)\//)?.[1]).filter(Boolean))].sort();
  const lock = JSON.parse(await readFile(new URL("package-lock.json", import.meta.url), "utf8"));
  const parts = ["# Libraries in these files", "",
    "Written by `npm run build` in `view/web`; the page's own code is Equipoise's. Built with esbuild " +
    `${lock.packages["node_modules/esbuild"].version} (MIT), of which nothing is shipped.`, "",
    "| library | version | licence | origin | integrity of the npm package |", "|---|---|---|---|---|"];
  const texts = [];
  for (const name of names) {
    const root = new URL(`node_modules/${name}/`, import.meta.url);
    const about = JSON.parse(await readFile(new URL("package.json", root), "utf8"));
    const origin = (about.repository?.url ?? about.repository).replace(/^git\+|^git:\/\/|\.git$/g, "").replace(/^(?!https)/, "https://");
    parts.push(`| ${name} | ${about.version} | ${about.license} | ${origin} | \`${lock.packages[`node_modules/${name}`].integrity}\` |`);
    const file = (await readdir(root)).find((one) => /^licen[cs]e/i.test(one));
    texts.push("", `## ${name}`, "", "```text", (await readFile(new URL(file, root), "utf8")).trim(), "```");
  }
  return [...parts, ...texts, ""].join("\n");
}
